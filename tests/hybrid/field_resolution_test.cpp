// The resolution of fields follows the angular sizes of lights, the number of rays and the cost of the bake.
#include "hybrid/fields/field_resolution.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/mesh/mesh_procedural.h"
#include "hybrid/fields/bake_estimate.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace::test {
namespace {

constexpr uint64_t k_plenty = 100'000'000;

// A ball of radius 1, far from the camera, under sphere lights of these angular diameters in degrees.
Scene lit_ball(const std::vector<float>& degrees) {
  SceneMaker maker;
  maker.scene.camera.to_world = look_at({500, 0, 0}, {0, 0, 0}, {0, 0, 1});
  const uint32_t grey = maker.bsdf(BsdfKind::diffuse, Rgb(0.5f));
  maker.instance(maker.mesh(make_sphere()), grey, Affine(1.0f));
  for (const float d : degrees) {
    const float radius = 20.0f * std::sin(0.5f * d * k_pi / 180.0f);
    const Affine at(Vec3(radius, 0, 0), Vec3(0, radius, 0), Vec3(0, 0, radius), Vec3(0, 0, 20));
    maker.area_light(maker.instance(maker.shape(ShapeKind::sphere), grey, at), Rgb(1.0f));
  }
  return maker.scene;
}

int directions_for(const Scene& scene, uint64_t rays_per_light) {
  return choose_resolution(scene, shape_traits(scene), rays_per_light).directions;
}

TEST(FieldResolution, NarrowLightsWantFineCells) {
  const Scene two_lights = lit_ball({30.0f, 4.0f});
  EXPECT_NEAR(narrowest_light_degrees(two_lights, shape_traits(two_lights)), 4.0f, 0.1f);
  EXPECT_EQ(directions_for(lit_ball({4.0f}), k_plenty), 64);
  EXPECT_EQ(directions_for(lit_ball({20.0f}), k_plenty), 32);
}

TEST(FieldResolution, FewRaysWantCoarseCells) {
  EXPECT_EQ(directions_for(lit_ball({4.0f}), k_fine_field_rays), 64);
  EXPECT_EQ(directions_for(lit_ball({4.0f}), k_fine_field_rays - 1), 32);
}

// A narrow light beside wide ones: fine cells would have to be baked for all of them.
TEST(FieldResolution, CostlyBakesWantManyRays) {
  const Scene scene = lit_ball({4.0f, 25.0f, 30.0f});
  const double fine_rays = estimated_bake_rays(scene, FieldParameters())[0];
  ASSERT_GT(fine_rays, k_costly_bake_rays);
  const auto enough = uint64_t(std::ceil(fine_rays / k_most_bake_share / double(scene.emitters.size())));
  ASSERT_GT(enough, 2 * k_fine_field_rays);
  EXPECT_EQ(directions_for(scene, enough - 2), 32);
  EXPECT_EQ(directions_for(scene, enough), 64);
}

// An object that fills the picture under many samples gets finer cells than one far away.
TEST(FieldResolution, LargeObjectsInThePictureWantFinerCells) {
  Scene scene = lit_ball({4.0f});
  scene.camera.fov_x_degrees = 40.0f;
  const auto chosen = [&](float distance, uint64_t rays_per_light) {
    scene.camera.to_world = look_at({distance, 0, 0}, {0, 0, 0}, {0, 0, 1});
    const FieldParameters p = choose_resolution(scene, shape_traits(scene), rays_per_light);
    return std::pair(p.directions, p.plane);
  };
  constexpr uint64_t k_many_rays = 12'000'000;
  EXPECT_EQ(chosen(3.0f, k_fine_field_rays), std::pair(64, 128));
  EXPECT_EQ(chosen(3.0f, 6 * k_many_rays), std::pair(64, 256));
  EXPECT_EQ(chosen(3.0f, 20 * k_many_rays), std::pair(128, 256));
  EXPECT_EQ(chosen(30.0f, 20 * k_many_rays), std::pair(64, 128));
  EXPECT_EQ(directions_for(lit_ball({}), 1000 * k_fine_field_rays), 64);  // without lights there is no bake to weigh
  scene = lit_ball({20.0f});
  scene.camera.fov_x_degrees = 40.0f;
  EXPECT_EQ(chosen(3.0f, 2 * k_many_rays), std::pair(32, 64));
  EXPECT_EQ(chosen(3.0f, 20 * k_many_rays), std::pair(64, 128));
}

TEST(FieldResolution, ProjectedShareIsThatOfTheDisc) {
  Scene scene = lit_ball({});
  const Instance& ball = scene.instances[0];
  scene.film.width = 200, scene.film.height = 100;
  scene.camera.fov_x_degrees = 90.0f;
  const float radius = std::sqrt(3.0f);  // of the ball about the bounds
  const auto share = [&](float distance) {
    scene.camera.to_world = look_at({distance, 0, 0}, {0, 0, 0}, {0, 0, 1});
    return projected_share(scene, ball);
  };
  EXPECT_NEAR(share(10.0f), k_pi * radius * radius / (100.0f - radius * radius) / 2.0f, 1e-3f);
  EXPECT_EQ(share(1.0f), 1.0f);
  EXPECT_EQ(share(2.0f), 1.0f);
  scene.camera.to_world = look_at({10, 0, 0}, {20, 0, 0}, {0, 0, 1});
  EXPECT_EQ(projected_share(scene, ball), 0.0f);
}

}  // namespace
}  // namespace fieldtrace::test
