// Which shapes direction maps are made of, and how instances deform them.

#include "hybrid/sky/mapped_shapes.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/mesh/mesh_procedural.h"
#include "hybrid/visibility/linear_map.h"
#include "tests/support/random_lines.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace {
namespace {

using test::SceneMaker;

// A rotation, which may mirror.
DMat3 random_turn(TestRandom& random) {
  const DVec3 x = glm::normalize(DVec3(random.direction())),
              y = glm::normalize(glm::cross(x, DVec3(random.direction())));
  return {x, y, glm::cross(x, y) * (random.index(2) ? 1.0 : -1.0)};
}

double largest(const DMat3& m) {
  double most = 0.0;
  for (int i = 0; i < 9; ++i) most = std::max(most, std::abs(m[i / 3][i % 3]));
  return most;
}

TEST(Stretch, IsWhatTurnsAndEvenScalingLeave) {
  TestRandom random(41);
  for (int trial = 0; trial < 2000; ++trial) {
    // Singular values over eight decades.
    const DVec3 values(random.log_uniform(1e-4f, 1e4f), random.log_uniform(1e-4f, 1e4f),
                       random.log_uniform(0.5f, 2.0f));
    const DMat3 turn = random_turn(random), other = random_turn(random);
    const DMat3 scaling(values.x, 0, 0, 0, values.y, 0, 0, 0, values.z);
    const DMat3 m = turn * scaling * glm::transpose(other) * double(random.log_uniform(1e-6f, 1e6f));
    const std::optional<DMat3> stretch = stretch_of(m);
    ASSERT_TRUE(stretch);
    const double size = largest(*stretch);
    EXPECT_LE(largest(*stretch - glm::transpose(*stretch)), 1e-12 * size);
    EXPECT_NEAR(glm::determinant(*stretch), 1.0, 1e-6);
    const DMat3 expected = other * scaling * glm::transpose(other) / std::cbrt(values.x * values.y * values.z);
    // Rounding grows with the ratio of the singular values.
    const double most = std::max({values.x, values.y, values.z}), least = std::min({values.x, values.y, values.z});
    EXPECT_LE(largest(*stretch - expected), (5e-14 * most / least + 1e-12) * size);
    EXPECT_TRUE(keeps_angles(m * glm::inverse(*stretch)) || largest(scaling) > 1e4);
  }
  EXPECT_FALSE(stretch_of(DMat3(0.0)));
  EXPECT_FALSE(stretch_of(DMat3(DVec3(1, 0, 0), DVec3(0, 1, 0), DVec3(1, 1, 0))));
  EXPECT_FALSE(stretch_of(DMat3(std::nan(""))));
}

TEST(MappedShapes, AreSharedByInstancesThatDifferByTurns) {
  SceneMaker maker;
  const uint32_t grey = maker.bsdf(BsdfKind::diffuse, Rgb(0.5f)),
                 mesh = maker.mesh(make_knot({.along = 32, .around = 8}));
  TestRandom random(42);
  const auto add = [&](const DMat3& m) {
    maker.instance(mesh, grey, Affine(Vec3(m[0]), Vec3(m[1]), Vec3(m[2]), random.in_ball()));
  };
  const DMat3 squash(1, 0, 0, 0, 1, 0, 0, 0, 0.25);
  add(DMat3(2.0));
  add(random_turn(random) * 0.5);
  add(squash);
  add(random_turn(random) * squash * 3.0);
  add(DMat3(1, 0, 0, 0, 1, 0, 0.5, 0, 1));  // a shear
  add(DMat3(1, 0, 0, 0, 1, 0, 0, 0, 0));    // flat
  maker.instance(maker.shape(ShapeKind::rectangle), grey, Affine(1.0f));
  const std::vector<ShapeTraits> traits = shape_traits(maker.scene);
  const MappedShapes shapes = mapped_shapes(maker.scene, traits);
  EXPECT_EQ(shapes.of_instance, (std::vector<uint32_t>{0, 0, 1, 1, 2, k_none, k_none}));
  ASSERT_EQ(shapes.shapes.size(), 3u);
  EXPECT_FALSE(shapes.shapes[0].is_deformed());
  for (const MappedShape& s : shapes.shapes) {
    for (const Vec3& p : maker.scene.shapes[mesh].mesh.positions) {
      const DVec3 from = s.stretch * DVec3(p) - DVec3(s.ball.centre);
      EXPECT_LE(glm::length(from), double(s.ball.radius));
    }
  }
}

TEST(MappedShapes, AreFewHoweverManyDeformations) {
  SceneMaker maker;
  const uint32_t grey = maker.bsdf(BsdfKind::diffuse, Rgb(0.5f)),
                 mesh = maker.mesh(make_knot({.along = 32, .around = 8}));
  for (int i = 0; i < 500; ++i) maker.instance(mesh, grey, test::scaling({1.0f, 1.0f, 1.1f + 0.01f * float(i)}));
  const MappedShapes shapes = mapped_shapes(maker.scene, shape_traits(maker.scene));
  EXPECT_EQ(shapes.shapes.size(), k_most_deformed);
}

}  // namespace
}  // namespace fieldtrace
