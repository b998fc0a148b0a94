// What the answerer knows of an instance: how much its transforms lengthen vectors at most.

#include "hybrid/visibility/shadow_instance.h"

#include <gtest/gtest.h>

#include "core/mesh/mesh_procedural.h"
#include "hybrid/visibility/linear_map.h"
#include "hybrid/visibility/shadow_answerer.h"
#include "tests/support/cone_scene.h"
#include "tests/support/random_lines.h"

namespace fieldtrace {
namespace {

// The sines of lights are found with these bounds (cells_across): one that is too small takes lights for smaller than
// they are, one that is too large for larger.
TEST(ShadowInstance, StretchIsBoundedTightly) {
  TestRandom random(1);
  Scene scene;
  Shape shape;
  shape.mesh = make_sphere({.around = 16, .along = 8});
  shape.bounds = shape.mesh.bounds();
  scene.shapes.push_back(std::move(shape));
  for (int i = 0; i < 50; ++i) {
    DAffine to_world(1.0);
    for (int column = 0; column < 3; ++column) {
      for (int row = 0; row < 3; ++row) {
        to_world[column][row] = (column == row ? 1.0 : 0.0) + random.uniform(-0.9f, 0.9f);
      }
      to_world[column] *= double(std::exp2(random.uniform(-2.0f, 2.0f)));
    }
    Instance instance;
    instance.to_world = Affine(to_world);
    instance.to_object = Affine(inverse_affine(to_world));
    scene.instances = {instance};
    const ShadowInstance o = make_shadow_instance(scene, 0, {}, nullptr, nullptr, AnswererSettings{});
    const float* m = o.cone.segment.to_unit;
    const Vec3 columns[3] = {{m[0], m[1], m[2]}, {m[3], m[4], m[5]}, {m[6], m[7], m[8]}};
    // Power iteration on the transpose times the transform: the direction that is lengthened most.
    Vec3 v = random.direction();
    float largest = 0.0f;
    for (int k = 0; k < 2000; ++k) {
      const Vec3 image = columns[0] * v.x + columns[1] * v.y + columns[2] * v.z;
      largest = std::max(largest, glm::length(image));
      v = glm::normalize(Vec3(glm::dot(columns[0], image), glm::dot(columns[1], image), glm::dot(columns[2], image)));
    }
    // A thousandth is added for rounding.
    EXPECT_GE(o.cone.segment.to_unit_stretch, largest) << i;
    EXPECT_LE(o.cone.segment.to_unit_stretch, 1.002f * largest) << i;
  }
}

TEST(ShadowInstance, AreasAndAnglesOfLinearMapsAreRight) {
  TestRandom random(2);
  for (int i = 0; i < 50; ++i) {
    const Affine place = test::random_place(random, random.log_uniform(1e-3f, 1e3f), 1e4f);
    const DMat3 a{DVec3(place[0]), DVec3(place[1]), DVec3(place[2])};
    // The columns are orthogonal: their lengths are the singular values.
    const double x = glm::length(a[0]), y = glm::length(a[1]), z = glm::length(a[2]);
    const double most = std::max({x * y, y * z, z * x});
    EXPECT_GE(double(area_bound(a)), most) << i;
    EXPECT_LE(double(area_bound(a)), 1.002 * most) << i;
    EXPECT_EQ(keeps_angles(a), std::abs(y * y - x * x) <= k_stretch_slack * x * x) << i;
    // Two perpendicular directions near d, and the area that their images span as seen along d's.
    const DVec3 d(random.direction()), e = glm::normalize(glm::cross(d, DVec3(random.direction())));
    const DVec3 image = glm::normalize(a * d);
    const auto turned = [&](const DVec3& offset) {
      const DVec3 near = glm::normalize(a * (d + 1e-6 * offset)) - image;
      return near / 1e-6;
    };
    const double solid_angle = glm::length(glm::cross(turned(e), turned(glm::cross(d, e))));
    EXPECT_NEAR(angle_stretch(a, d) * angle_stretch(a, d) / solid_angle, 1.0, 0.05) << i;
  }
}

// The balls of two instances at distance `apart` along `axis`, both squashed along z.
bool overlap(const Vec3& axis, float apart, float squash) {
  Scene scene;
  Shape shape;
  shape.mesh = make_sphere({.around = 16, .along = 8});
  shape.bounds = shape.mesh.bounds();
  const float radius = field_ball(shape.bounds).radius;
  scene.shapes.push_back(std::move(shape));
  for (const float at : {0.0f, apart * radius}) {
    Instance instance;
    instance.to_world = Affine(Vec3(1, 0, 0), Vec3(0, -1, 0), Vec3(0, 0, squash), at * axis);
    instance.to_object = Affine(inverse_affine(DAffine(instance.to_world)));
    scene.instances.push_back(instance);
  }
  const ShadowInstance a = make_shadow_instance(scene, 0, {}, nullptr, nullptr, AnswererSettings{});
  return may_overlap(a, make_shadow_instance(scene, 1, {}, nullptr, nullptr, AnswererSettings{}));
}

TEST(ShadowInstance, BallsApartAreKnown) {
  for (const float squash : {1.0f, 1e-2f, 1e-4f}) {
    EXPECT_TRUE(overlap({1, 0, 0}, 0.0f, squash)) << squash;
    EXPECT_TRUE(overlap({1, 0, 0}, 1.99f, squash)) << squash;
    EXPECT_FALSE(overlap({1, 0, 0}, 2.01f, squash)) << squash;
    EXPECT_TRUE(overlap({0, 0, 1}, 1.99f * squash, squash)) << squash;
    EXPECT_FALSE(overlap({0, 0, 1}, 2.01f * squash, squash)) << squash;
  }
}

}  // namespace
}  // namespace fieldtrace
