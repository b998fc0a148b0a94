// The tolerance is a dial: along it rays become fewer and errors larger, in steps that a user can choose between.
#include <gtest/gtest.h>

#include <vector>

#include "core/mesh/mesh_procedural.h"
#include "hybrid/compare/compare.h"
#include "hybrid/render/render.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace {
namespace {

enum class Lit { by_sphere, by_rectangle, by_both };

// Two objects over a floor, the second one squashed and mirrored.
Scene lit_objects(Lit lit) {
  test::SceneMaker s;
  s.film(48, 48);
  s.scene.sample_count = 1;
  s.scene.camera.to_world = test::look_at({2.5f, -6, 3}, {-0.3f, 0.5f, 0.2f}, {0, 0, 1});
  s.scene.camera.fov_x_degrees = 14.0f;
  const uint32_t grey = s.bsdf(BsdfKind::diffuse, Rgb(0.5f));
  s.instance(s.mesh(make_knot({.along = 256, .around = 24})), grey, test::translation({-0.7f, 0, 1.0f}));
  Affine place = test::scaling({-0.5f, 0.5f, 0.2f});
  place[3] = {1.3f, -0.8f, 0.5f};
  s.instance(s.mesh(make_supershape({})), grey, place);
  s.instance(s.shape(ShapeKind::rectangle), grey, test::scaling(Vec3(6.0f)));
  if (lit != Lit::by_rectangle) {
    place = test::scaling(Vec3(0.8f));
    place[3] = {2, -2, 4};
    s.area_light(s.instance(s.shape(ShapeKind::sphere), grey, place), Rgb(20.0f));
  }
  if (lit != Lit::by_sphere) {
    place = test::look_at({-2, -3, 4}, {0, 0, 0.5f}, {0, 0, 1});
    for (int i = 0; i < 3; ++i) place[i] *= 0.5f;
    s.area_light(s.instance(s.shape(ShapeKind::rectangle), grey, place), Rgb(30.0f));
  }
  return s.scene;
}

TEST(Tolerance, RaysFallAndErrorsGrowAlongTheDial) {
  for (const Lit lit : {Lit::by_sphere, Lit::by_rectangle, Lit::by_both}) {
    const Scene scene = lit_objects(lit);
    RenderOptions o;
    o.spp = 16;
    o.light_samples = 32;
    o.threads = 2;
    o.directions = 32;
    o.plane = 64;
    o.leave_to_rays = false;
    o.method = Method::monte_carlo;
    o.light_samples = 128;
    const Image truth = render(scene, o).image;
    o.light_samples = 32;
    const double noise = compare_images(render(scene, o).image, truth).rmse;
    o.method = Method::hybrid;
    uint64_t last_rays = ~uint64_t(0);
    double last_error = 0.0, first_error = 0.0;
    for (const float tolerance : {0.0f, 0.01f, 0.03f, 0.06f, 0.1f, 0.2f, 0.4f, 1.0f}) {
      o.tolerance = tolerance;
      const RenderResult result = render(scene, o);
      const double error = compare_images(result.image, truth).rmse;
      EXPECT_LT(result.stats.rays_exact, last_rays) << tolerance;
      // What is filtered has less noise than samples, by which small tolerances may beat smaller ones.
      EXPECT_GT(error, last_error - 0.5 * noise) << tolerance;
      if (tolerance == 0.0f) {
        EXPECT_EQ(error, noise);
        first_error = error;
      }
      if (tolerance == 0.1f) {
        EXPECT_LT(error, noise + 0.002);
      }
      last_rays = result.stats.rays_exact;
      last_error = error;
    }
    EXPECT_EQ(last_rays, 0u);
    EXPECT_GT(last_error, 2.0 * first_error);
  }
}

// Without a request it is the default's up to 128 light samples a pixel, and less in proportion with more.
TEST(Tolerance, FallsWithTheNoiseUnlessRequested) {
  const Scene scene = lit_objects(Lit::by_sphere);
  RenderOptions o;
  o.directions = 32;
  o.plane = 64;
  o.light_estimator = LightEstimator::samples;
  o.light_samples = 16;
  for (const auto& [spp, expected] : {std::pair(2, 0.1f), {8, 0.1f}, {16, 0.05f}, {32, 0.025f}}) {
    SCOPED_TRACE(spp);
    o.spp = spp;
    o.tolerance.reset();
    const RenderResult usual = render(scene, o);
    EXPECT_FLOAT_EQ(usual.stats.tolerance, expected);
    o.tolerance = usual.stats.tolerance;
    const RenderResult requested = render(scene, o);
    EXPECT_EQ(usual.image.data, requested.image.data);
    o.tolerance = k_default_tolerance;
    const RenderResult fixed = render(scene, o);
    EXPECT_EQ(fixed.stats.tolerance, k_default_tolerance);
    EXPECT_EQ(fixed.stats.rays_exact < usual.stats.rays_exact, expected < k_default_tolerance);
  }
}

}  // namespace
}  // namespace fieldtrace
