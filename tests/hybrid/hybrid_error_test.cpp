// The error that fields add: hybrid pictures against Monte Carlo pictures of the same samples, checked answers, and the
// counters of a render.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "core/mesh/mesh_procedural.h"
#include "core/trace/accel.h"
#include "hybrid/compare/compare.h"
#include "hybrid/render/render.h"
#include "hybrid/transport/trace_pixels.h"
#include "hybrid/visibility/shadow_answerer.h"
#include "tests/support/field_checks.h"
#include "tests/support/hybrid_scenes.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace {
namespace {

using test::hybrid_scene;
using test::hybrid_scenes;
using test::HybridScene;

RenderOptions options_for(Method method, int light_samples) {
  RenderOptions o;
  o.leave_to_rays = false;  // so small a picture would pay for no field
  o.method = method;
  o.light_samples = light_samples;
  o.seed = 11;
  o.threads = 2;
  return o;
}

// The coarsest resolution, which bakes fastest and errs most.
void use_small_fields(RenderOptions& o) {
  o.directions = 32;
  o.plane = 64;
}

// Crowds, skies and nearby lights: fields would not pay for so small a picture, but are to be tested all the same.
bool is_costly(const HybridScene& s) {
  return s.name == "crowd" || s.name == "lights_within" || s.name.starts_with("environment");
}

double mean(const Image& image) {
  double sum = 0.0;
  for (const float v : image.data) sum += v;
  return sum / double(image.data.size());
}

// Parts of lights are filtered, not sampled at Monte Carlo's points: pictures are alike when both have converged.
constexpr int k_converged_samples = 1024;

// The aims for converged pictures at the default tolerance: added error, and that of the worst 16 x 16 block.
constexpr double k_rmse = 0.002, k_block = 0.01;
// Most scenes err less: by so much of the picture's mean. Those where strata of one size blur more are named.
constexpr double k_mean_rmse = 0.004, k_mean_block = 0.02;
constexpr const char* k_blurred[] = {"object_over_floor", "crowd", "nested_balls", "coatings"};

// The aim for solid meshes (docs/decisions/003-certificates.md).
constexpr double k_wrong_share = 0.002;

// The aims for pictures under a sky, whose light is read from direction maps: those of objects, which err more than
// floors, and of the worst block, as shares of the mean.
constexpr double k_sky_rmse = 0.01, k_sky_block = 0.03;
bool has_sky(const HybridScene& s) { return s.name.starts_with("environment"); }

// At tolerance 1 a cell that does not know decides for most of its lines: it is wrong about half of them at most, and a
// picture by fields alone must err by less than half as much as one whose lights shine through everything.
constexpr double k_majority = 0.5;

constexpr const char* k_scenes[] = {"object_over_floor", "overlapping", "crowd",          "lights_within",
                                    "nested_balls",      "open_sheet",  "odd_transforms", "resized_meshes",
                                    "tiny_world",        "huge_world",  "environment",    "environment_map",
                                    "materials",         "coatings"};

// The picture without shadow rays: no object is ever found between a shading point and a light.
Image unshadowed(const Scene& scene, uint32_t seed) {
  const Accel accel(scene);
  const CameraSampler camera(scene.camera, scene.film);
  TransportSettings settings;
  settings.seed = seed;
  settings.light_samples = 64;
  settings.max_depth = scene.integrator.max_depth;
  settings.rr_depth = scene.integrator.rr_depth;
  settings.isa = resolve_isa(Isa::automatic);
  const Scene nothing;
  const ShadowAnswerer answerer(nothing, accel, {}, {}, {.isa = settings.isa});
  const TransportContext context(scene, accel, camera, answerer, settings);
  TransportWorker worker(context);
  std::vector<PixelPosition> pixels;
  for (int y = 0; y < scene.film.height; ++y) {
    for (int x = 0; x < scene.film.width; ++x) pixels.push_back({x, y});
  }
  Image image{scene.film.width, scene.film.height, {"R", "G", "B"}, {}};
  const std::vector<SampleRange> ranges(pixels.size(), {0, 1});
  trace_pixels(
      pixels, ranges, {}, 1, worker, [] { return true; },
      [&](const PixelRun&, std::span<const Rgb> values, std::span<const FirstHit>) {
        for (const Rgb& v : values) image.data.insert(image.data.end(), {v.x, v.y, v.z});
      });
  return image;
}

class HybridErrorTest : public testing::TestWithParam<const char*> {};

TEST_P(HybridErrorTest, ConvergedPicturesAreNearMonteCarlo) {
  const HybridScene s = hybrid_scene(GetParam(), 32);
  RenderOptions o = options_for(Method::monte_carlo, k_converged_samples);
  use_small_fields(o);
  o.tolerance = k_default_tolerance;  // whatever the noise
  o.leave_to_rays = !is_costly(s);
  const Image expected = render(s.scene, o).image;
  const double level = mean(expected);
  const test::TemporaryFolder folder;  // so that the second render need not bake again
  o.field_cache = folder.path();
  o.method = Method::hybrid;
  const RenderResult usual = render(s.scene, o);
  const ImageDifference d = compare_images(usual.image, expected);
  // What bundles of rays are answered by fields is an estimate; where all objects are left to rays, none is.
  if (usual.stats.samples_spared > 0) {
    EXPECT_GT(d.rmse, 0.0);
  }
  EXPECT_LE(d.rmse, has_sky(s) ? k_sky_rmse * level : k_rmse);
  EXPECT_LE(d.worst_block_rmse, has_sky(s) ? k_sky_block * level : k_block);
  if (!has_sky(s) && std::find(std::begin(k_blurred), std::end(k_blurred), s.name) == std::end(k_blurred)) {
    EXPECT_LE(d.rmse, k_mean_rmse * level);
    EXPECT_LE(d.worst_block_rmse, k_mean_block * level);
  }

  o.tolerance = 1.0f;
  const RenderResult one = render(s.scene, o);
  EXPECT_LT(one.stats.rays_exact, usual.stats.rays_exact);
  EXPECT_TRUE(!s.fields_only || one.stats.rays_exact == 0) << one.stats.rays_exact;
  const ImageDifference d1 = compare_images(one.image, expected),
                        without = compare_images(unshadowed(s.scene, *o.seed), expected);
  EXPECT_EQ(d1.not_finite, 0u);
  EXPECT_LE(d1.rmse, k_majority * without.rmse);
  EXPECT_LE(d1.worst_block_rmse, k_majority * without.worst_block_rmse);
}

// Single rays at tolerance 1: those that certified cells answer, and of the others half at most wrongly.
TEST_P(HybridErrorTest, UndecidedCellsAreWrongAboutHalfOfTheirRaysAtMost) {
  const HybridScene s = hybrid_scene(GetParam(), 32);
  RenderOptions o = options_for(Method::hybrid, 32);
  use_small_fields(o);
  o.check = true;
  o.whole_lights = false;
  o.leave_to_rays = !is_costly(s);
  if (has_sky(s)) GTEST_SKIP() << "no single rays are answered under a sky";
  const Stats usual = render(s.scene, o).stats;
  o.tolerance = 1.0f;
  const Stats one = render(s.scene, o).stats;
  EXPECT_GT(one.check_answers, usual.check_answers);
  EXPECT_LE(double(one.check_wrong),
            k_majority * double(usual.rays_exact) + k_wrong_share * double(usual.check_answers));
}

INSTANTIATE_TEST_SUITE_P(Scenes, HybridErrorTest, testing::ValuesIn(k_scenes),
                         [](const auto& tested) { return std::string(tested.param); });

// Every scene is tested above, and certified answers about solid meshes are right.
TEST(HybridError, OfSolidMeshesFewAnswersAreWrong) {
  uint64_t answers = 0, wrong = 0;
  uint64_t compared = 0;
  double differences = 0.0;
  size_t seen = 0;
  for (const HybridScene& s : hybrid_scenes(32)) {
    SCOPED_TRACE(s.name);
    EXPECT_NE(std::find(std::begin(k_scenes), std::end(k_scenes), s.name), std::end(k_scenes));
    ++seen;
    RenderOptions o = options_for(Method::hybrid, 32);
    use_small_fields(o);
    o.check = true;
    o.leave_to_rays = !is_costly(s);
    const Stats stats = render(s.scene, o).stats;
    // Of lights within objects' balls only rays from the objects themselves are looked up.
    if (has_sky(s)) {
      EXPECT_GT(stats.checked(CheckedEstimate::sky).compared, 1000u);
      EXPECT_LT(stats.checked(CheckedEstimate::sky).mean_difference(), 0.03);
      EXPECT_LT(std::abs(stats.checked(CheckedEstimate::sky).bias()), 0.005);
    } else if (s.name != "lights_within") {
      EXPECT_GT(stats.check_answers, 1000u);
    }
    const CheckedDifferences& irradiance = stats.checked(CheckedEstimate::irradiance);
    compared += irradiance.compared;
    differences += irradiance.mean_difference();
    EXPECT_LT(irradiance.mean_difference(), 0.01);
    EXPECT_LT(std::abs(irradiance.bias()), 0.005);
    if (s.solid) answers += stats.check_answers, wrong += stats.check_wrong;
  }
  EXPECT_EQ(seen, std::size(k_scenes));
  EXPECT_GT(answers, 50000u);
  EXPECT_GT(compared, 50u);
  EXPECT_GT(differences, 0.0);
  EXPECT_LE(double(wrong), k_wrong_share * double(answers));
}

// With the default resolution: both kinds of shading points and both verdicts.
TEST(HybridError, FewCheckedAnswersAreWrong) {
  RenderOptions o = options_for(Method::hybrid, 32);
  o.check = true;
  const Stats s = render(hybrid_scene("overlapping", 32).scene, o).stats;
  EXPECT_GT(s.check_answers, 10000u);
  EXPECT_LE(double(s.check_wrong), k_wrong_share * double(s.check_answers));
  uint64_t answers = 0, wrong = 0;
  for (const CheckedVerdict verdict : {CheckedVerdict::clear, CheckedVerdict::blocked}) {
    for (const Stats::CheckCount& c : s.check_by[int(verdict)]) {
      EXPECT_GT(c.answers, 50u);
      answers += c.answers;
      wrong += c.wrong;
    }
  }
  EXPECT_EQ(answers, s.check_answers);
  EXPECT_EQ(wrong, s.check_wrong);
}

// A ball in the shadow of another. Where it faces the light it does not shadow itself, so no right answer of its own
// field is "blocked", however many answers of the other ball's field are.
TEST(HybridError, SelfShadowingAnswersAreThoseOfTheRaysOwnObject) {
  test::SceneMaker maker;
  maker.film(48, 48);
  maker.scene.camera.to_world = test::look_at({0, -6, 3}, {0, 0, 0}, {0, 0, 1});
  maker.scene.camera.fov_x_degrees = 30.0f;
  const uint32_t grey = maker.bsdf(BsdfKind::diffuse, Rgb(0.5f));
  const uint32_t ball = maker.mesh(make_sphere({.around = 64, .along = 32}));
  const auto place = [&](const Vec3& at, float radius) {
    return Affine(Vec3(radius, 0, 0), Vec3(0, radius, 0), Vec3(0, 0, radius), at);
  };
  maker.instance(ball, grey, place({0, 0, 0}, 1.0f));
  maker.instance(ball, grey, place({0, -0.8f, 2.0f}, 0.6f));
  maker.area_light(maker.instance(maker.shape(ShapeKind::sphere), grey, place({0, -2.4f, 6.0f}, 0.2f)), Rgb(60.0f));
  RenderOptions o = options_for(Method::hybrid, 16);
  o.max_depth = 2;
  o.check = true;
  o.leave_to_rays = false;
  const Stats s = render(maker.scene, o).stats;
  EXPECT_GT(s.cones_blocked, 10u);  // whole lights hidden by the other ball
  const auto& blocked = s.check_by[int(CheckedVerdict::blocked)];
  EXPECT_GT(blocked[0].answers, 500u);
  EXPECT_EQ(blocked[1].answers, blocked[1].wrong);
  EXPECT_GT(s.check_by[int(CheckedVerdict::clear)][1].answers, 500u);
}

// Checking only counts: it changes neither the other counters nor the picture.
TEST(HybridError, CheckingChangesNothing) {
  const Scene scene = hybrid_scene("object_over_floor", 32).scene;
  RenderOptions o = options_for(Method::hybrid, 8);
  use_small_fields(o);
  const RenderResult plain = render(scene, o);
  o.check = true;
  RenderResult checked = render(scene, o);
  EXPECT_EQ(plain.image.data, checked.image.data);
  EXPECT_EQ(plain.stats.rays_exact, checked.stats.rays_exact);
  EXPECT_EQ(plain.stats.check_answers, 0u);
  // One object: every ray that crosses its ball is either answered by its field or traced.
  o.whole_lights = false;
  checked = render(scene, o);
  EXPECT_EQ(checked.stats.check_answers + checked.stats.rays_exact, checked.stats.rays_crossing);
}

TEST(HybridStats, CountersAgree) {
  for (const HybridScene& s : hybrid_scenes(24)) {
    SCOPED_TRACE(s.name);
    // With fewer samples all groups of the crowd, which hold 8,192 of them, see so many pixels that candidates overflow.
    RenderOptions o = options_for(Method::monte_carlo, s.name == "crowd" ? 256 : 16);
    use_small_fields(o);
    o.leave_to_rays = !is_costly(s);
    const Stats mc = render(s.scene, o).stats;
    o.method = Method::hybrid;
    o.whole_lights = false;
    const Stats hybrid = render(s.scene, o).stats;

    EXPECT_EQ(mc.method, "montecarlo");
    EXPECT_EQ(mc.lookups, 0u);
    EXPECT_EQ(mc.bake_rays, 0u);
    EXPECT_EQ(mc.rays_exact, mc.rays_crossing);
    EXPECT_EQ(mc.exact_fraction(), 1.0);

    EXPECT_EQ(hybrid.method, "hybrid");
    if (has_sky(s)) {  // of whose light samples only those in undecided cells are rays
      EXPECT_EQ(hybrid.samples, mc.samples);
      EXPECT_LE(hybrid.samples_by_strata + hybrid.rays_exact, hybrid.samples);  // some leave below the surface
      EXPECT_LT(hybrid.rays_exact, mc.rays_exact);
      EXPECT_LT(hybrid.rays_primary, mc.rays_primary);  // none that leave diffuse surfaces
      EXPECT_GT(hybrid.lookups, 0u);
      EXPECT_GT(hybrid.bake_rays, 0u);
      EXPECT_GT(hybrid.field_bytes_maps, 0u);
      EXPECT_GT(hybrid.sky_objects, 0u);
      EXPECT_EQ(hybrid.field_objects, 0u);
      continue;
    }
    EXPECT_EQ(hybrid.rays_shadow, mc.rays_shadow);
    EXPECT_EQ(hybrid.rays_primary, mc.rays_primary);
    EXPECT_EQ(hybrid.rays_crossing, mc.rays_crossing);
    EXPECT_EQ(hybrid.sphere_crossings, mc.sphere_crossings);
    EXPECT_EQ(hybrid.rays_candidate_overflow, mc.rays_candidate_overflow);
    EXPECT_LE(hybrid.rays_candidate_overflow, hybrid.rays_exact);
    EXPECT_LT(hybrid.rays_exact, hybrid.rays_crossing);
    EXPECT_GT(hybrid.exact_fraction(), 0.0);
    EXPECT_LE(hybrid.rays_crossing, hybrid.rays_shadow);
    EXPECT_GT(hybrid.lookups, 0u);
    EXPECT_GT(hybrid.field_objects, 0u);
    EXPECT_LE(hybrid.field_objects, s.scene.shapes.size());
    EXPECT_GT(hybrid.bake_rays, hybrid.field_cells_baked);
    EXPECT_LT(hybrid.field_cells_baked, hybrid.field_cells_full);
    EXPECT_GT(hybrid.field_bytes_memory, 0u);
    EXPECT_EQ(hybrid.field_directions, 32);
    EXPECT_EQ(hybrid.field_plane, 64);

    EXPECT_GE(hybrid.spheres_per_ray(), 1.0);
    EXPECT_LE(hybrid.spheres_per_ray(), double(s.scene.instances.size()));
    if (s.name == "object_over_floor") {
      EXPECT_EQ(hybrid.spheres_per_ray(), 1.0);
    } else if (s.name == "overlapping") {
      EXPECT_GT(hybrid.spheres_per_ray(), 2.0);
    }
  }
}

// More tolerance means fewer exact rays.
TEST(HybridStats, ToleranceSavesExactRays) {
  const Scene scene = hybrid_scene("object_over_floor", 32).scene;
  RenderOptions o = options_for(Method::hybrid, 16);
  use_small_fields(o);
  uint64_t last = std::numeric_limits<uint64_t>::max();
  for (const float tolerance : {0.0f, 0.05f, 0.1f, 0.3f, 1.0f}) {
    o.tolerance = tolerance;
    const Stats s = render(scene, o).stats;
    EXPECT_LT(s.rays_exact, last) << tolerance;
    last = s.rays_exact;
  }
  EXPECT_EQ(last, 0u);
}

}  // namespace
}  // namespace fieldtrace
