// Surfels stand for those beside them.

#include "hybrid/sky/surfels.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/mesh/mesh_procedural.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace {
namespace {

using test::SceneMaker;

// apart: from a surfel to what stands for it, at most.
void expect_near_representatives(const Surfels& surfels, float apart) {
  ASSERT_EQ(surfels.representative.size(), surfels.points.size());
  ASSERT_GT(surfels.points.size(), 200u);
  size_t facing = 0;
  size_t shaded = 0;
  for (uint32_t i = 0; i < surfels.points.size(); ++i) {
    const uint32_t r = surfels.representative[i];
    ASSERT_LT(r, surfels.points.size());
    EXPECT_EQ(surfels.representative[r], r);
    shaded += r == i;
    const Surfel &own = surfels.points[i], &other = surfels.points[r];
    EXPECT_LE(glm::distance(own.spot.position, other.spot.position), apart);
    facing += glm::dot(own.normal, other.normal) > 0.0f;  // the main axes of their normals are the same
  }
  // Two voxels are as wide as the knot's tube is thick: about it normals may turn by more than a right angle.
  EXPECT_GT(double(facing), 0.98 * double(surfels.points.size()));
  EXPECT_LT(double(shaded), 0.4 * double(surfels.points.size()));
}

TEST(Surfels, OfObjectsAreNearTheirRepresentatives) {
  SceneMaker s;
  const uint32_t grey = s.bsdf(BsdfKind::diffuse, Rgb(0.5f));
  s.instance(s.mesh(make_knot({.along = 192, .around = 16})), grey, Affine(1.0f));
  s.instance(s.mesh(make_sphere()), grey, test::translation({5, 0, 0}));
  const Accel accel(s.scene);
  const MappedShapes mapped = mapped_shapes(s.scene, shape_traits(s.scene));
  ASSERT_EQ(mapped.shapes.size(), 2u);
  constexpr float k_voxel = 2.0f / 16.0f;  // of the unit ball's
  for (const MappedShape& shape : mapped.shapes) {
    expect_near_representatives(make_surfels(accel, shape, 16, 32),
                                2.0f * std::sqrt(3.0f) * k_voxel * shape.ball.radius);
  }
}

TEST(Surfels, OfPlanesAreNearTheirRepresentatives) {
  SceneMaker s;
  const uint32_t square = s.shape(ShapeKind::rectangle);
  s.instance(square, s.bsdf(BsdfKind::diffuse, Rgb(0.5f)), Affine(1.0f));
  const Accel accel(s.scene);
  const Parallelogram plane = {DVec3(0.0), DMat3(1.0)};
  const PlaneWindow windows[2] = {{}, {Vec2(-0.5f), Vec2(0.25f, 0.5f)}};
  for (const bool back : {false, true}) {
    const bool sides[2] = {true, back};
    const Surfels surfels = make_plane_surfels(accel, square, plane, {0, 0, 1}, windows, 32, sides);
    expect_near_representatives(surfels, std::sqrt(2.0f) * 2.0f / 32.0f * 1.001f);
    EXPECT_EQ(surfels.points.size(), size_t(back ? 2 : 1) * (2 * 32 * 32 - 12 * 16));  // none twice
  }
}

}  // namespace
}  // namespace fieldtrace
