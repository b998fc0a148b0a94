// What the answerer knows of an instance: how much its transforms lengthen vectors at most.

#include "hybrid/visibility/shadow_instance.h"

#include <gtest/gtest.h>

#include "core/mesh/mesh_procedural.h"
#include "hybrid/visibility/shadow_answerer.h"
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

}  // namespace
}  // namespace fieldtrace
