// Direct light: what is counted while fields answer whole lights, strata and single rays, and the errors that they add.
#include "hybrid/light/direct_light.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "core/mesh/mesh_procedural.h"
#include "hybrid/compare/compare.h"
#include "hybrid/render/render.h"
#include "hybrid/render/trace_pixels.h"
#include "tests/support/random_lines.h"
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
  // Either picture errs by .42 M^-.75 about a light that is partly hidden (docs/decisions/009-cones.md), which is half
  // of what is shown; and the sum of so many squares is known to its own deviation.
  const double noise = std::sqrt(2.0) * 0.5 * 0.42 * std::pow(double(o.light_samples), -0.75);
  EXPECT_LE(std::sqrt(squares / partial), noise * (1.0 + 3.0 / std::sqrt(2.0 * partial)));
}

// The floor halves a light too narrow to be told apart from a point: half of the strata lie below the horizon of the
// floor's shading points, and nearly all others are refused.
TEST(DirectLight, StrataBelowTheHorizonAreNotRefused) {
  const Scene scene = lit_knot(0.0f, {{{-5, 0, 0}, 0.02f}});
  const Stats stats = render(scene, coarse_fields()).stats;
  EXPECT_GT(stats.strata_refused, 500u);
  EXPECT_LE(stats.strata_refused, stats.strata);
}

// The points of a lattice on the unit disk, by Shirley and Chiu's map.
std::vector<Vec2> lattice_on_disk(const LightSampleRange& lattice) {
  std::vector<Vec2> points;
  for (int k = 0; k < lattice.total; ++k) {
    const auto at = [&](int i) { return lattice.stretch * ((2.0f * float(i) + 1.0f) / float(lattice.columns) - 1.0f); };
    const float a = at(k % lattice.columns), b = at(k / lattice.columns);
    const bool is_steep = std::abs(b) > std::abs(a);
    const float radius = is_steep ? b : a,
                turn = is_steep ? 0.5f * k_pi - 0.25f * k_pi * a / b
                                : 0.25f * k_pi * b / std::max(std::abs(a), 1e-30f) * (a < 0.0f ? -1.0f : 1.0f);
    points.push_back(radius * Vec2(std::cos(turn), std::sin(turn)));
  }
  return points;
}

// RMS of what is misjudged of a round light whose points agree, over straight edges at random offsets: the part of the
// disk beyond an edge that no point lies beyond.
double misjudged(const std::vector<Vec2>& points) {
  TestRandom random(17);
  constexpr int k_edges = 4000;
  double squares = 0.0;
  for (int i = 0; i < k_edges; ++i) {
    const float angle = random.uniform(0.0f, 2.0f * k_pi), offset = random.uniform(-1.0f, 1.0f);
    const Vec2 normal(std::cos(angle), std::sin(angle));
    const auto is_hidden = [&](const Vec2& p) { return glm::dot(p, normal) > offset; };
    if (std::adjacent_find(points.begin(), points.end(), [&](const Vec2& p, const Vec2& q) {
          return is_hidden(p) != is_hidden(q);
        }) != points.end()) {
      continue;
    }
    const double half = std::acos(double(offset)), beyond = (half - std::sin(half) * std::cos(half)) / double(k_pi);
    const double error = is_hidden(points[0]) ? 1.0 - beyond : beyond;
    squares += error * error;
  }
  return std::sqrt(squares / k_edges);
}

// What points that agree overlook of an edge is little beside what as many light samples as are spared err by, .42
// M^-.75 (docs/decisions/009-cones.md): a quarter of it, in the mean over edges (docs/decisions/019-penumbrae.md).
TEST(DirectLight, EdgesBetweenTrialPointsHideLittle) {
  std::map<int, double> of_side;  // each lattice is measured once
  int tried = 0;
  for (int m = 1; m < 20000; ++m) {
    const LightSampleRange lattice = probe_rays(LightKind::disk, m, false);
    if (lattice.count == 0) continue;
    ++tried;
    ASSERT_EQ(lattice.count, lattice.total) << m;
    const auto [at, is_new] = of_side.try_emplace(lattice.columns, 0.0);
    if (is_new) {
      const std::vector<Vec2> points = lattice_on_disk(lattice);
      // The outer points lie on the rim, as good as.
      ASSERT_EQ(std::count_if(points.begin(), points.end(), [](const Vec2& p) { return glm::length(p) > 0.998f; }),
                4 * (lattice.columns - 1));
      at->second = misjudged(points);
    }
    ASSERT_LE(at->second, 0.25 * 0.42 * std::pow(double(m), -0.75)) << m;
  }
  EXPECT_GT(tried, 19000);
  EXPECT_GT(of_side.size(), 5u);
}

// Trying saves rays: there are fewer points than samples, the more so the more samples, and never fewer for more.
TEST(DirectLight, ProbeRaysAreFewAndGrowWithTheSquareRoot) {
  int last = 0;
  for (int m = 1; m < 20000; ++m) {
    const LightSampleRange lattice = probe_rays(LightKind::rectangle, m, false);
    const LightSampleRange of_mesh = probe_rays(LightKind::mesh, m, false);
    ASSERT_EQ(lattice.count, of_mesh.count) << m;
    ASSERT_LT(lattice.count, m) << m;
    ASSERT_GE(lattice.count, last) << m;
    last = lattice.count;
    if (lattice.count == 0) continue;
    ASSERT_EQ(lattice.columns * lattice.columns, lattice.count) << m;
    // Sixteen times the samples: twice the side, rounded.
    const LightSampleRange more = probe_rays(LightKind::rectangle, 16 * m, false);
    ASSERT_LE(std::abs(more.columns - 2 * lattice.columns), 1) << m;
    ASSERT_EQ(of_mesh.total, m);
    ASSERT_EQ(of_mesh.columns, 0);
  }
  for (const LightKind kind : {LightKind::sphere, LightKind::disk, LightKind::rectangle, LightKind::parallelogram})
    EXPECT_EQ(probe_rays(kind, 64, false).columns, 4);
  // On these lights the border of the sample square is not the rim that a shading point sees.
  for (const LightKind kind : {LightKind::sphere_inside, LightKind::ellipsoid, LightKind::cylinder, LightKind::mesh})
    EXPECT_EQ(probe_rays(kind, 64, false).columns, 0);
  // From 15 light samples on (docs/decisions/014-strata.md).
  EXPECT_EQ(probe_rays(LightKind::sphere, 14, false).count, 0);
  EXPECT_EQ(probe_rays(LightKind::sphere, 15, false).count, 9);
  EXPECT_EQ(probe_rays(LightKind::sphere, 64, false).count, 16);
}

// Coarse lattices are not believed about wide lights (docs/decisions/014-strata.md: 4 x 4 points from 27 samples on);
// finer ones are the same for all.
TEST(DirectLight, WideLightsAreTriedAtMorePointsOrNone) {
  for (int m = 1; m < 5000; ++m) {
    const LightSampleRange narrow = probe_rays(LightKind::disk, m, false);
    const LightSampleRange wide = probe_rays(LightKind::disk, m, true);
    ASSERT_EQ(wide.count > 0, m >= 27) << m;
    ASSERT_EQ(wide.count, m >= 27 ? std::max(narrow.count, 16) : 0) << m;
  }
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
    // A tenth of a per cent of the light, which umbrae under wide lights may come out too bright by (README.md).
    EXPECT_LE(std::abs(light_found / count), 0.001) << light.at.x;
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
  EXPECT_LE(knot.error, 1.005 * knot.noise);  // 1.00 times, to two digits
}

// The weight of a near light, or of a wide one, differs much over its cells: decision 020 gives a bias of .5 % and 1.02
// times Monte Carlo's error.
TEST(DirectLight, NearLightsKeepTheirMean) {
  for (const Light& light :
       {Light{{2, -3.2f, 2.5f}, 0.9f, ShapeKind::disk}, Light{{-1.8f, -1.6f, 2.4f}, 1.8f, ShapeKind::disk},
        Light{{-1.8f, -1.6f, 2.4f}, 1.5f, ShapeKind::rectangle}, Light{{-1.6f, -2, 2.6f}, 1.0f}}) {
    const CloseUp knot = close_up_of_knot(light, 32);  // coarse: many rays are undecided
    EXPECT_LE(std::abs(knot.bias), 0.005) << light.at.x << " " << int(light.shape);
    EXPECT_LE(knot.error, 1.025 * knot.noise) << light.at.x << " " << int(light.shape);
  }
}

}  // namespace
}  // namespace fieldtrace
