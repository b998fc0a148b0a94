// Direct light: what is counted while fields answer whole lights, strata and single rays, and the errors that they add.
#include "hybrid/light/direct_light.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/mesh/mesh_procedural.h"
#include "hybrid/compare/compare.h"
#include "hybrid/render/render.h"
#include "hybrid/render/trace_pixels.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace {
namespace {

struct Light {
  Vec3 at;
  float radius;
  ShapeKind shape = ShapeKind::sphere;  // other shapes face the knot
};
// A knot over a floor, or standing through it, under lights.
Scene lit_knot(float height, const std::vector<Light>& lights, bool upright = false) {
  test::SceneMaker s;
  s.film(64, 64);
  s.scene.sample_count = 1;
  s.scene.camera.to_world = test::look_at({2.5f, -6, 3}, {0, 0, 0.3f}, {0, 0, 1});
  s.scene.camera.fov_x_degrees = 35.0f;
  const uint32_t grey = s.bsdf(BsdfKind::diffuse, Rgb(0.5f));
  Affine place = test::translation({0, 0, height});
  if (upright) place[1] = {0, 0, 1}, place[2] = {0, -1, 0};
  s.instance(s.mesh(make_knot({.along = 256, .around = 24})), grey, place);
  s.instance(s.shape(ShapeKind::rectangle), grey, test::scaling(Vec3(6.0f)));
  for (const Light& light : lights) {
    place = test::scaling(Vec3(light.radius));
    place[3] = light.at;
    if (light.shape != ShapeKind::sphere) {
      const Affine turned = test::look_at(light.at, {0, 0, height}, {0, 0, 1});
      for (int i = 0; i < 3; ++i) place[i] = light.radius * turned[i];
      if (light.shape == ShapeKind::rectangle) place[0] += 0.3f * place[1];  // sampled by its area
    }
    s.area_light(s.instance(s.shape(light.shape), grey, place), Rgb(50.0f / (light.radius * light.radius)));
  }
  return s.scene;
}

// 64 light samples, and fields of the lowest resolution.
RenderOptions coarse_fields() {
  RenderOptions o;
  o.light_samples = 64;
  o.threads = 2;
  o.directions = 32;
  o.plane = 64;
  o.leave_to_rays = false;
  return o;
}

// Grids of 64 strata are preceded by 16 strata. Each light sample near the only object is spared, by an answer of its
// field or because probe rays agree, or is a ray that the field answers or leaves undecided.
TEST(DirectLight, UsesOfAFieldAreCountedOnce) {
  constexpr int k_samples = 256;
  ASSERT_LE(3 * k_first_strata, 2 * stratum_grid(k_samples).total);
  const Scene scene = lit_knot(1.0f, {{{2, -2, 4}, 0.6f}});
  const Accel accel(scene);
  Field field(field_ball(scene.shapes[0].bounds), {.directions = 32, .plane = 64});
  const ShadowAnswerer answerer(scene, accel, shape_traits(scene), {&field, nullptr, nullptr},
                                {.isa = resolve_isa(Isa::automatic), .count_uses = true});
  const CameraSampler camera(scene.camera, scene.film);
  TransportSettings settings;
  settings.light_samples = k_samples;
  settings.max_depth = 2;
  settings.isa = resolve_isa(Isa::automatic);
  const TransportContext context(scene, accel, camera, answerer, settings);
  TransportWorker worker(context);
  trace_pixels(
      tile_pixels(scene.film.crop), 1, 1, worker, [] { return true; },
      [](size_t, std::span<const Rgb>, std::span<const FirstHit>) {});
  const Stats& stats = worker.stats();
  EXPECT_GT(stats.strata, 10000u);
  EXPECT_GT(stats.rays_crossing, 1000u);
  ASSERT_FALSE(stats.field_uses.empty());
  EXPECT_GT(stats.samples_extrapolated, 0u);
  EXPECT_EQ(stats.field_uses[0].answered + stats.field_uses[0].undecided, stats.samples_spared + stats.rays_crossing);
}

// Where one light is answered by strata and another by rays, both weigh the same in the layer.
TEST(DirectLight, LightsWeighTheSameInVisibility) {
  const Scene scene = lit_knot(1.0f, {{{2, -2, 4}, 0.9f}, {{-2, -3, 5}, 0.05f}});
  RenderOptions o = coarse_fields();
  o.aovs = {"visibility"};
  o.method = Method::monte_carlo;
  const Image exact = render(scene, o).image;
  o.method = Method::hybrid;
  const RenderResult fields = render(scene, o);
  EXPECT_GT(fields.stats.strata, 10000u);
  double squares = 0.0;
  int partial = 0;
  for (int y = 0; y < exact.height; ++y) {
    for (int x = 0; x < exact.width; ++x) {
      const float visible = exact.pixel(x, y)[3];
      const double error = double(fields.image.pixel(x, y)[3]) - double(visible);
      // The first light is partly hidden, the other one seen.
      if (visible <= 0.55f || visible >= 0.95f) continue;
      squares += error * error;
      ++partial;
    }
  }
  EXPECT_GT(partial, 100);
  EXPECT_LE(std::sqrt(squares / partial), 0.03);
}

// The floor halves a light too narrow to be told apart from a point: half of the strata lie below the horizon of the
// floor's shading points, and nearly all others are refused.
TEST(DirectLight, StrataBelowTheHorizonAreNotRefused) {
  const Scene scene = lit_knot(0.0f, {{{-5, 0, 0}, 0.02f}});
  const Stats stats = render(scene, coarse_fields()).stats;
  EXPECT_GT(stats.strata_refused, 500u);
  EXPECT_LE(stats.strata_refused, stats.strata);
}

// Probe rays form a square lattice large enough to be informative, and are never so many as to cost more than they
// save.
TEST(DirectLight, ProbeRaysAreFewAndGrowWithTheSquareRoot) {
  int last = 0;
  for (int m = 1; m < 20000; ++m) {
    const LightSampleRange lattice = probe_rays(LightKind::rectangle, m, false);
    const LightSampleRange of_mesh = probe_rays(LightKind::mesh, m, false);
    ASSERT_EQ(lattice.count, of_mesh.count) << m;
    ASSERT_LE(5 * lattice.count, 3 * m) << m;
    ASSERT_GE(lattice.count, last) << m;
    last = lattice.count;
    if (lattice.count == 0) continue;
    ASSERT_EQ(lattice.columns * lattice.columns, lattice.count) << m;
    ASSERT_EQ(lattice.total, lattice.count) << m;
    ASSERT_GE(lattice.count, std::sqrt(double(m))) << m;
    ASSERT_LE(lattice.count, 2.6 * std::sqrt(double(m))) << m;
    ASSERT_EQ(of_mesh.total, m);
    ASSERT_EQ(of_mesh.columns, 0);
  }
  for (const LightKind kind : {LightKind::sphere, LightKind::disk, LightKind::rectangle, LightKind::parallelogram})
    EXPECT_EQ(probe_rays(kind, 64, false).columns, 4);
  // On these lights the border of the sample square is not the rim that a shading point sees.
  for (const LightKind kind : {LightKind::sphere_inside, LightKind::ellipsoid, LightKind::cylinder, LightKind::mesh})
    EXPECT_EQ(probe_rays(kind, 64, false).columns, 0);
  EXPECT_EQ(probe_rays(LightKind::sphere, 14, false).count, 0);
  EXPECT_EQ(probe_rays(LightKind::sphere, 16, false).count, 9);
  EXPECT_EQ(probe_rays(LightKind::sphere, 64, false).count, 16);
}

// Coarse lattices are not trusted for wide lights; finer ones are the same for all lights.
TEST(DirectLight, WideLightsAreTriedAtMorePointsOrNone) {
  for (int m = 1; m < 5000; ++m) {
    const LightSampleRange narrow = probe_rays(LightKind::disk, m, false);
    const LightSampleRange wide = probe_rays(LightKind::disk, m, true);
    ASSERT_LE(5 * wide.count, 3 * m) << m;
    if (narrow.columns >= k_least_wide_lattice) {
      ASSERT_EQ(wide.count, narrow.count) << m;
    } else {
      ASSERT_TRUE(wide.count == 0 || wide.columns == k_least_wide_lattice) << m;
    }
  }
  EXPECT_EQ(probe_rays(LightKind::sphere, 26, true).count, 0);
  EXPECT_EQ(probe_rays(LightKind::sphere, 27, true).count, 16);
}

// A light that is wide to some shading points and not to others takes two lattices. A shading point's answer must not
// depend on its group or on threads.
TEST(DirectLight, ShadingPointsOfTwoLatticesAreLitAlone) {
  Scene scene = lit_knot(1.0f, {{{1, -1, 4}, 0.7f}});
  RenderOptions o = coarse_fields();
  o.light_samples = 32;
  ASSERT_NE(probe_rays(LightKind::sphere, 32, true).count, probe_rays(LightKind::sphere, 32, false).count);
  const Image whole = render(scene, o).image;
  o.method = Method::monte_carlo;
  o.light_samples = 1024;
  const Image truth = render(scene, o).image;
  o.light_samples = 32;
  EXPECT_LE(compare_images(whole, truth).rmse, compare_images(render(scene, o).image, truth).rmse);
  o.method = Method::hybrid;
  o.threads = 1;
  o.crop = Rect{17, 21, 30, 25};
  const Image part = render(scene, o).image;
  for (int y = 0; y < part.height; ++y) {
    for (int x = 0; x < part.width; ++x) {
      for (int c = 0; c < 3; ++c) ASSERT_EQ(part.pixel(x, y)[c], whole.pixel(x + 17, y + 21)[c]) << x << " " << y;
    }
  }
}

// RMSE of the red channel over the pixels that show instance `instance`.
double error_on(uint32_t instance, const Image& image, const Image& truth) {
  double squares = 0.0;
  int count = 0;
  for (int y = 0; y < truth.height; ++y) {
    for (int x = 0; x < truth.width; ++x) {
      if (truth.pixel(x, y)[3] != float(instance + 1)) continue;
      const double error = double(image.pixel(x, y)[0]) - double(truth.pixel(x, y)[0]);
      squares += error * error;
      ++count;
    }
  }
  EXPECT_GT(count, 1000);
  return std::sqrt(squares / std::max(count, 1));
}

// Where two parts of an object, one behind the other, hide a light together, the parallel lines of a coverage map may
// pass between them although the light's rays do not.
TEST(DirectLight, UmbraeOfSeveralLayersStayDark) {
  for (const Light& light : {Light{{0.5f, 0.5f, 5}, 0.9f}, Light{{0.1f, 0.1f, 6}, 0.8f}, Light{{1, 0, 7}, 1.3f}}) {
    Scene scene = lit_knot(1.0f, {light}, true);
    scene.film.width = scene.film.height = 192;
    scene.film.crop = {0, 0, 192, 192};
    scene.camera.to_world = test::look_at({0.5f, -5, 4}, {0, 0, 0.3f}, {0, 0, 1});
    RenderOptions o = coarse_fields();
    o.directions = 64;
    o.plane = 128;
    o.aovs = {"object", "visibility"};
    const Image fields = render(scene, o).image;
    o.method = Method::monte_carlo;
    o.light_samples = 1024;
    const Image truth = render(scene, o).image;
    int count = 0;
    double light_found = 0.0;
    for (int y = 0; y < truth.height; ++y) {
      for (int x = 0; x < truth.width; ++x) {
        const float* pixel = truth.pixel(x, y);
        if (pixel[3] != 2.0f || pixel[4] > 0.25f) continue;
        ++count;
        light_found += double(fields.pixel(x, y)[4]) - double(pixel[4]);
      }
    }
    EXPECT_GT(count, 500);
    EXPECT_LE(std::abs(light_found / count), 0.0015) << light.at.x;
  }
}

struct CloseUp {
  double noise = 0.0, error = 0.0;  // RMSE of Monte Carlo, and of fields with as many samples
  double bias = 0.0;                // mean relative error of fields where the light is partly hidden
  Stats stats;                      // of the render with fields
};
// A close-up of a knot that shadows itself, under one light.
CloseUp close_up_of_knot(const Light& light, int directions = 64) {
  Scene scene = lit_knot(1.0f, {light});
  scene.film.width = scene.film.height = 160;
  scene.film.crop = {0, 0, 160, 160};
  scene.camera.fov_x_degrees = 14.0f;
  scene.camera.to_world = test::look_at({2.5f, -6, 3}, {0, 0, 1}, {0, 0, 1});
  const auto picture = [&](Method method, int light_samples) {
    RenderOptions o = coarse_fields();
    o.directions = directions;
    o.plane = 2 * directions;
    o.method = method;
    o.light_samples = light_samples;
    o.aovs = {"object", "visibility"};
    return render(scene, o);
  };
  const Image truth = picture(Method::monte_carlo, 2048).image;
  CloseUp result;
  result.noise = error_on(0, picture(Method::monte_carlo, 64).image, truth);
  const RenderResult fields = picture(Method::hybrid, 64);
  result.error = error_on(0, fields.image, truth);
  result.stats = fields.stats;
  double sum = 0.0;
  for (int y = 0; y < truth.height; ++y) {
    for (int x = 0; x < truth.width; ++x) {
      const float* pixel = truth.pixel(x, y);
      if (pixel[3] != 1.0f || pixel[4] < 0.05f || pixel[4] > 0.95f) continue;
      sum += double(pixel[0]);
      result.bias += double(fields.image.pixel(x, y)[0]) - double(pixel[0]);
    }
  }
  result.bias /= sum;
  EXPECT_GT(result.noise, 0.0);
  return result;
}

// Where fields settle a whole light or answer in a penumbra, the error they add does not show beside the noise of as
// many samples; and where one edge cuts the light, following it takes fewer rays.
TEST(DirectLight, PenumbraeOnAnObjectErrAsMonteCarloDoes) {
  for (const float radius : {0.2f, 0.8f}) {
    const CloseUp knot = close_up_of_knot({{3, -2, 4}, radius});
    EXPECT_GT(knot.stats.samples_spared, 6 * knot.stats.rays_exact) << radius;
    EXPECT_LE(knot.error, knot.noise) << radius;
  }
}

// Much of a large light is below the horizon of most surfaces that see it.
TEST(DirectLight, LightsCutByTheHorizonErrAsMonteCarloDoes) {
  const CloseUp knot = close_up_of_knot({{3.5f, -2, 1}, 1.5f});
  EXPECT_GT(knot.stats.samples_spared, 2 * knot.stats.rays_exact);
  EXPECT_LE(knot.error, 1.01 * knot.noise);
}

// The weight of a near or wide light varies much over its cells.
TEST(DirectLight, NearLightsKeepTheirMean) {
  for (const Light& light :
       {Light{{2, -3.2f, 2.5f}, 0.9f, ShapeKind::disk}, Light{{-1.8f, -1.6f, 2.4f}, 1.8f, ShapeKind::disk},
        Light{{-1.8f, -1.6f, 2.4f}, 1.5f, ShapeKind::rectangle}, Light{{-1.6f, -2, 2.6f}, 1.0f}}) {
    const CloseUp knot = close_up_of_knot(light, 32);  // coarse: many rays are undecided
    EXPECT_LE(std::abs(knot.bias), 0.005) << light.at.x << " " << int(light.shape);
    EXPECT_LE(knot.error, 1.06 * knot.noise) << light.at.x << " " << int(light.shape);
  }
}

}  // namespace
}  // namespace fieldtrace
