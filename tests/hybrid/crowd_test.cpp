// Ten thousand instances of ten meshes: splitting groups of shading points lets fields answer, and the picture stays
// right.

#include <gtest/gtest.h>

#include "core/mesh/mesh_procedural.h"
#include "hybrid/compare/compare.h"
#include "hybrid/render/render.h"
#include "tests/support/random_lines.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace {
namespace {

constexpr int k_columns = 100;

// A coarser version of the scene of tools/make_crowd.py: one object in each cell of a square grid over a floor.
Scene crowd() {
  test::SceneMaker maker;
  TestRandom random(1);
  maker.film(48, 48);
  maker.scene.camera.to_world = test::look_at({0, -60, 12}, {0, -46, 0}, {0, 0, 1});
  maker.scene.camera.fov_x_degrees = 25.0f;
  const uint32_t grey = maker.bsdf(BsdfKind::diffuse, Rgb(0.5f));
  maker.instance(maker.shape(ShapeKind::rectangle), grey, test::scaling(Vec3(80.0f)));
  std::vector<uint32_t> shapes;
  for (int i = 0; i < 10; ++i) {
    SupershapeParams p;
    p.longitude.m = 3.0 + i;
    p.around = 32;
    p.along = 16;
    shapes.push_back(maker.mesh(make_supershape(p)));
  }
  for (int n = 0; n < k_columns * k_columns; ++n) {
    const float size = random.uniform(0.25f, 0.6f);
    Affine a = test::scaling(Vec3(size));
    a[3] = {float(n % k_columns - k_columns / 2) + random.uniform(0.3f, 0.7f),
            float(n / k_columns - k_columns / 2) + random.uniform(0.3f, 0.7f), size};
    maker.instance(shapes[random.index(10)], grey, a);
  }
  Affine light = test::scaling(Vec3(4.0f));
  light[3] = {60, -40, 80};
  maker.area_light(maker.instance(maker.shape(ShapeKind::sphere), grey, light), Rgb(400.0f));
  return maker.scene;
}

RenderOptions options_for(Method method) {
  RenderOptions o;
  o.method = method;
  o.light_samples = 32;
  o.spp = 1;
  o.threads = 2;
  o.directions = 32;
  o.plane = 64;
  o.leave_to_rays = false;
  return o;
}

// A bake that would cost more rays than the picture sends is not begun; nor are fields used where a survey finds too
// few answers.
TEST(Crowd, IsLeftToRaysWhereItsFieldsCannotPay) {
  const Scene scene = crowd();
  RenderOptions o = options_for(Method::monte_carlo);
  o.light_samples = 4;
  o.light_estimator = LightEstimator::samples;
  o.directions = o.plane = 0;
  const RenderResult exact = render(scene, o);
  o.method = Method::hybrid;
  o.leave_to_rays = true;
  o.directions = o.plane = 0;
  const RenderResult left = render(scene, o);
  EXPECT_GT(left.stats.field_left_to_rays, 0u);
  EXPECT_EQ(left.stats.field_objects, 0u);
  EXPECT_EQ(left.stats.bake_rays, 0u);
  EXPECT_EQ(left.stats.survey_rays, 0u);
  EXPECT_EQ(left.image.data, exact.image.data);
  o.tolerance = 1.0f;  // every cell answers
  EXPECT_EQ(render(scene, o).stats.field_left_to_rays, 0u);
  o.tolerance = 0.1f;
  o.plane = 64;  // a resolution is requested
  EXPECT_EQ(render(scene, o).stats.field_left_to_rays, 0u);
}

TEST(Crowd, FieldsAnswerForTenThousandInstances) {
  const Scene scene = crowd();
  RenderOptions o = options_for(Method::monte_carlo);
  const RenderResult exact = render(scene, o);
  EXPECT_EQ(exact.stats.instances, 10002u);
  // Most groups have more candidates than single rays are tested against.
  EXPECT_GT(2 * exact.stats.rays_candidate_overflow, exact.stats.rays_exact);
  EXPECT_LE(exact.stats.rays_candidate_overflow, exact.stats.rays_exact);
  o.method = Method::hybrid;
  o.tolerance = 0.0f;
  const RenderResult zero = render(scene, o);
  EXPECT_EQ(zero.image.data, exact.image.data);
  EXPECT_EQ(zero.stats.rays_candidate_overflow, exact.stats.rays_candidate_overflow);
  o.tolerance = 0.1f;
  const RenderResult hybrid = render(scene, o);
  EXPECT_LT(2 * hybrid.stats.rays_exact, exact.stats.rays_exact);
  EXPECT_GT(hybrid.stats.lookups, 0u);
  o.threads = 1;
  EXPECT_EQ(render(scene, o).image.data, hybrid.image.data);

  // The error of fields stays below the noise of the samples.
  o = options_for(Method::monte_carlo);
  o.seed = 2;
  const double noise = compare_images(render(scene, o).image, exact.image).rmse;
  EXPECT_LT(compare_images(hybrid.image, exact.image).rmse, noise);
}

}  // namespace
}  // namespace fieldtrace
