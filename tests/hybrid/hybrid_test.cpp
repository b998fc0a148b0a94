// The hybrid method against Monte Carlo over the same samples: equal where every ray is exact, close where fields
// answer, and the same picture whatever the machine does.

#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <atomic>
#include <filesystem>
#include <set>
#include <string>

#include "core/loader/scene_xml.h"
#include "hybrid/compare/compare.h"
#include "hybrid/fields/field_set.h"
#include "hybrid/render/render.h"
#include "hybrid/survey/open_light_samples.h"
#include "tests/hybrid/survey/surveyed_scene.h"
#include "tests/support/field_checks.h"
#include "tests/support/hybrid_scenes.h"

namespace fieldtrace {
namespace {

using test::for_each_cut;
using test::hybrid_scene;
using test::hybrid_scenes;
using test::HybridScene;
using test::SurveyedScene;

RenderOptions options_for(Method method, int light_samples, uint32_t seed = 1) {
  RenderOptions o;
  o.leave_to_rays = false;  // so small a picture would pay for no field
  o.method = method;
  o.light_samples = light_samples;
  o.seed = seed;
  o.threads = 2;
  return o;
}

// The lowest resolution: the tests hold for any, and this one bakes fastest.
void use_small_fields(RenderOptions& o) {
  o.directions = 32;
  o.plane = 64;
}

// The number of values in which two pictures differ.
size_t differing(const Image& a, const Image& b) {
  if (a.data.size() != b.data.size()) return std::max(a.data.size(), b.data.size());
  size_t n = 0;
  for (size_t i = 0; i < a.data.size(); ++i) n += a.data[i] != b.data[i];
  return n;
}

double mean(const Image& image) {
  double sum = 0.0;
  for (const float v : image.data) sum += v;
  return sum / double(image.data.size());
}

struct Sampling {
  int light_samples, max_depth;
};
constexpr Sampling k_samplings[] = {{1, 5}, {3, 2}, {16, 2}, {64, 2}};

TEST(Hybrid, BakesArePaidByThePicturesLightSamples) {
  const Scene scene = hybrid_scene("object_over_floor", 32).scene;
  for (const int light_samples : {1, 16, 256, 4096}) {
    SCOPED_TRACE(light_samples);
    RenderOptions o = options_for(Method::hybrid, light_samples);
    o.max_depth = 2;
    o.leave_to_rays = true;
    o.light_estimator = LightEstimator::samples;
    const RenderResult hybrid = render(scene, o);
    const uint64_t samples = 32 * 32 * uint64_t(light_samples) * scene.emitters.size();
    EXPECT_LE(2 * hybrid.stats.bake_rays, samples);  // by estimate 4 times
    EXPECT_EQ(hybrid.stats.bake_rays > 0, light_samples >= 4096);
    if (hybrid.stats.bake_rays > 0) continue;
    o.method = Method::monte_carlo;
    EXPECT_EQ(differing(render(scene, o).image, hybrid.image), 0u);
  }
}

// What fields answer of lights without extent spares rays, too, though these have no more samples where they are
// hidden.
TEST(Hybrid, FieldsPayUnderPointLights) {
  Scene scene = hybrid_scene("object_over_floor", 64).scene;
  Emitter& light = scene.emitters.emplace_back();
  light.kind = EmitterKind::point;
  light.value = Rgb(10.0f);
  light.position = {3.0f, -2.0f, 3.5f};
  scene.emitters.erase(scene.emitters.begin());
  scene.instances.pop_back();  // the sphere that was the light
  RenderOptions o = options_for(Method::hybrid, 1);
  o.max_depth = 2;
  o.spp = 256;
  o.leave_to_rays = true;
  const Stats stats = render(scene, o).stats;
  EXPECT_GT(stats.lookups, 0u);
  EXPECT_EQ(stats.field_left_to_rays, 0u);
  o.method = Method::monte_carlo;
  EXPECT_LT(stats.rays_exact, render(scene, o).stats.rays_exact / 2);
}

// Pixels of few light samples, 4 of each camera sample here, send rays: surveys of fields would be in vain.
TEST(Hybrid, LeavesFewLightSamplesToRays) {
  const Scene scene = hybrid_scene("object_over_floor", 512).scene;
  RenderOptions o = options_for(Method::hybrid, 1);
  o.leave_to_rays = true;
  o.spp = 16;
  const int of_camera = render(scene, o).stats.open_light_samples, enough = int(k_fewest_field_samples) / of_camera;
  EXPECT_GT(of_camera, 1);
  for (const int samples : {1, enough - 1, enough}) {
    o.spp = samples;
    const Stats stats = render(scene, o).stats;
    EXPECT_EQ(stats.open_light_samples, of_camera);
    const bool many = samples * stats.open_light_samples >= k_fewest_field_samples;
    EXPECT_EQ(stats.field_objects > 0, many) << samples;
    EXPECT_EQ(stats.lookups > 0, many) << samples;
  }
}

// Nor where a survey finds that so many lights leave each camera sample one sample of each.
TEST(Hybrid, LeavesManyLightsToRaysWhereTheyGetFewSamples) {
  Scene scene = hybrid_scene("object_over_floor", 512).scene;
  RenderOptions o = options_for(Method::hybrid, 1);
  o.leave_to_rays = true;
  o.spp = 16;
  EXPECT_GT(render(scene, o).stats.field_objects, 0u);
  const Instance lamp = scene.instances[scene.emitters[0].instance];
  for (int i = 1; i < 40; ++i) {
    Emitter emitter = scene.emitters[0];
    emitter.instance = uint32_t(scene.instances.size());
    scene.instances.push_back(lamp);
    scene.instances.back().emitter = uint32_t(scene.emitters.size());
    scene.instances.back().to_world[3].x -= 0.1f * float(i);
    scene.instances.back().to_object = Affine(inverse_affine(DAffine(scene.instances.back().to_world)));
    scene.emitters.push_back(emitter);
  }
  const Stats stats = render(scene, o).stats;
  EXPECT_EQ(stats.open_light_samples, 1);
  EXPECT_EQ(stats.field_objects, 0u);
  EXPECT_EQ(stats.lookups, 0u);
}

// Point lights have no more samples than camera samples.
TEST(Hybrid, CountsOneSampleOfPointLights) {
  Scene scene = hybrid_scene("object_over_floor", 512).scene;
  scene.instances.pop_back();  // the sphere that was the light
  scene.emitters = {{.kind = EmitterKind::point, .value = Rgb(10.0f), .position = {2.0f, -1.5f, 5.0f}}};
  RenderOptions o = options_for(Method::hybrid, 1);
  o.leave_to_rays = true;
  const auto fewest = int(k_fewest_field_samples);
  for (const int samples : {fewest / 2, fewest - 1}) {
    o.spp = samples;
    EXPECT_EQ(render(scene, o).stats.field_objects, 0u) << samples;
  }
  o.spp = fewest;
  EXPECT_GT(render(scene, o).stats.field_objects, 0u);
}

// The time to an error is least.
TEST(OpenLightSamples, AreThoseThatLowerTheNoiseForTheirRays) {
  const auto best = [](double light, double rest, double rays_of_light, double rays) {
    return NoiseByLightSamples{light, rest, rays_of_light, rays}.best(1);
  };
  EXPECT_EQ(best(0.0, 1.0, 0.1, 0.0), 1);  // edges are all of the noise
  EXPECT_EQ(best(0.01, 1.0, 0.1, 0.0), 1);
  EXPECT_EQ(best(1.0, 0.0, 1e-6, 0.0), k_most_open_samples);  // rays cost nothing
  EXPECT_EQ(best(1.0, 0.0, 1e6, 0.0), 1);
  EXPECT_EQ(best(1.0, 1.0, 1e-6, 0.0), k_most_open_samples);
  // Longer paths make a camera sample dearer.
  EXPECT_LT(best(1.0, 1.0, 0.5, 0.0), best(1.0, 1.0, 0.5, 50.0));
  int last = k_most_open_samples;
  for (const double rays : {0.01, 0.1, 0.3, 1.0, 3.0, 10.0}) {
    const int samples = best(1.0, 0.1, rays, 0.0);
    EXPECT_LE(samples, last) << rays;
    last = samples;
  }
  EXPECT_EQ(last, 1);
  EXPECT_EQ((NoiseByLightSamples{1.0, 0.0, 1e-6, 0.0}).best(3), 6);
  EXPECT_EQ((NoiseByLightSamples{1.0, 0.0, 1e-6, 0.0}).best(64), 64);
  EXPECT_EQ(NoiseByLightSamples().best(1), 1);  // nothing was found
}

// Every sample of a point light, or of a directional one, sends the same ray.
TEST(OpenLightSamples, AreOneForLightsWithoutExtent) {
  SceneLoadOptions options;
  options.parameters = {{"resolution", "32"}, {"sky", "0"}};
  const Scene scene =
      load_scene(std::string(FIELDTRACE_SOURCE_DIR) + "/scenes/point_directional_constant.xml", options);
  for (const Method method : {Method::monte_carlo, Method::hybrid}) {
    RenderOptions o = options_for(method, 1);
    o.spp = 4;
    o.light_estimator = LightEstimator::samples;
    const RenderResult usual = render(scene, o);
    o.light_estimator = LightEstimator::adaptive;
    const RenderResult adaptive = render(scene, o);
    EXPECT_GT(usual.stats.rays_exact, 0u);
    EXPECT_EQ(adaptive.stats.rays_exact, usual.stats.rays_exact);
    EXPECT_EQ(differing(adaptive.image, usual.image), 0u);
  }
}

// What a survey finds is what pictures have: noise and rays.
TEST(OpenLightSamples, AreForetoldBySurveys) {
  const Scene scene = hybrid_scene("object_over_floor", 96).scene;
  RenderOptions o = options_for(Method::monte_carlo, 1);
  o.max_depth = 2;
  Stats stats;
  const NoiseByLightSamples found = noise_by_light_samples(SurveyedScene{scene, {.max_depth = 2}}.with(), stats);
  const auto noise_of = [&](int light_samples) {
    o.light_samples = light_samples;
    double squares = 0.0;
    std::vector<Image> images;
    for (const uint32_t seed : {1, 2}) {
      o.seed = seed;
      images.push_back(render(scene, o).image);
    }
    for (size_t i = 0; i < images[0].data.size(); ++i) {
      const double apart = double(images[0].data[i]) - double(images[1].data[i]);
      squares += apart * apart;
    }
    return squares;
  };
  const double ratio = noise_of(4) / noise_of(1);
  EXPECT_NEAR((0.25 * found.light + found.rest) / (found.light + found.rest), ratio, 0.15);
  o.light_samples = 1;
  const double pixels = double(scene.film.width) * double(scene.film.height);
  const double sent = double(render(scene, o).stats.rays_exact) / pixels;
  EXPECT_NEAR(found.rays_of_light, sent, 0.2 * sent + 0.01);
  EXPECT_NEAR(found.rays, 0.0, 0.01);
}

// All samples lie at pixels' centres: what noise there is is that of light.
void without_edges(Film& film) {
  film.filter = FilterKind::box;
  film.filter_radius = 1e-3f;
}

// A hundredth of the picture's samples, by 1,024 pixels, two sequences and two surveys.
TEST(OpenLightSamples, AreSurveyedInLittleTime) {
  EXPECT_EQ(few_samples_of(1.0, 1), 1u);
  EXPECT_EQ(few_samples_of(1024.0 * 1024.0, 1), 1u);
  EXPECT_EQ(few_samples_of(1024.0 * 1024.0, 3), 3u);  // eight would be a hundredth
  EXPECT_EQ(few_samples_of(1024.0 * 400.0, 4), 4u);
  EXPECT_EQ(few_samples_of(1024.0 * 100.0, 16), 4u);
  EXPECT_EQ(few_samples_of(1e9, 1 << 20), 16u);
}

// Nothing is concluded from surveys that were cut short, wherever.
TEST(OpenLightSamples, AreThoseRequestedWhereASurveyIsCut) {
  const Scene scene = hybrid_scene("object_over_floor", 32).scene;
  const SurveyedScene surveyed{scene, {.max_depth = 2}};
  Stats stats;
  int asked = 0;
  const auto survey = [&](int most) {
    asked = 0;
    return noise_by_light_samples(surveyed.with([&, most] { return ++asked <= most; }), stats);
  };
  tbb::task_arena arena(1);
  arena.execute([&] {
    EXPECT_GT(survey(1 << 30).light, 0.0);
    for_each_cut(asked, [&](int most) {
      const NoiseByLightSamples cut = survey(most);
      EXPECT_EQ(cut.light, 0.0) << most;
      EXPECT_EQ(cut.best(1), 1) << most;
    });
  });
}

// The film decides, whatever part of it is rendered, by however many threads.
TEST(OpenLightSamples, AreThoseOfTheFilm) {
  Scene scene = hybrid_scene("object_over_floor", 96).scene;
  without_edges(scene.film);
  RenderOptions o = options_for(Method::hybrid, 1);
  o.leave_to_rays = true;
  o.spp = 4;
  const Stats whole = render(scene, o).stats;
  EXPECT_GT(whole.open_light_samples, 1);
  const auto expect_same = [&] {
    const Stats stats = render(scene, o).stats;
    EXPECT_EQ(stats.open_light_samples, whole.open_light_samples);
    EXPECT_EQ(stats.survey_rays, whole.survey_rays);
  };
  o.threads = 1;
  o.seed = 77;
  expect_same();
  o.crop = Rect{0, 0, 8, 8};  // the background
  expect_same();
}

// With every kind of light and material: no bias, over pairs of pictures of the same camera samples.
TEST(OpenLightSamples, OfMonteCarloHaveItsMean) {
  constexpr int k_seeds = 12;
  std::set<std::string> of_one;
  for (HybridScene& s : hybrid_scenes(32)) {
    SCOPED_TRACE(s.name);
    without_edges(s.scene.film);
    double sum = 0.0, squares = 0.0;
    for (uint32_t seed = 0; seed < k_seeds; ++seed) {
      RenderOptions o = options_for(Method::monte_carlo, 1, seed);
      o.max_depth = 2;
      o.spp = 16;
      const double usual = mean(render(s.scene, o).image);
      o.light_estimator = LightEstimator::adaptive;
      const RenderResult adaptive = render(s.scene, o);
      if (adaptive.stats.open_light_samples == 1) {
        of_one.insert(s.name);
        EXPECT_EQ(mean(adaptive.image), usual);
      }
      const double difference = mean(adaptive.image) / usual - 1.0;
      sum += difference, squares += difference * difference;
    }
    const double average = sum / k_seeds, variance = squares / k_seeds - average * average;
    EXPECT_LE(std::abs(average), 5.0 * std::sqrt(variance / (k_seeds - 1)));
    EXPECT_LT(std::sqrt(variance), 0.02);
  }
  // Without area lights, and where other noise is more; by a little in "materials".
  of_one.erase("materials");
  EXPECT_EQ(of_one, (std::set<std::string>{"environment", "environment_map", "coatings"}));
}

// They lower the noise of both methods, and leave alone what the layers tell: the mean over light samples.
TEST(OpenLightSamples, LowerTheNoiseAndKeepTheLayers) {
  Scene scene = hybrid_scene("object_over_floor", 32).scene;
  without_edges(scene.film);
  RenderOptions o = options_for(Method::monte_carlo, 64);
  o.max_depth = 2;
  o.spp = 256;
  const Image expected = render(scene, o).image;
  enum class By { monte_carlo, rays, fields };
  for (const By by : {By::monte_carlo, By::rays, By::fields}) {
    o = options_for(by == By::monte_carlo ? Method::monte_carlo : Method::hybrid, 1, 5);
    o.leave_to_rays = by == By::rays;  // so small a picture is left to them then
    o.max_depth = 2;
    o.spp = 16;
    o.aovs = {"visibility"};
    double errors[2], visible[2];
    for (const bool adaptive : {false, true}) {
      o.light_estimator = adaptive ? LightEstimator::adaptive : LightEstimator::samples;
      const RenderResult result = render(scene, o);
      EXPECT_EQ(result.stats.lookups > 0, by == By::fields);
      EXPECT_EQ(result.stats.open_light_samples > 1, adaptive);
      const Image& image = result.image;
      double squares = 0.0, sum = 0.0;
      for (size_t pixel = 0; pixel < image.data.size() / 4; ++pixel) {
        for (size_t c = 0; c < 3; ++c) {
          const double d = double(image.data[4 * pixel + c]) - double(expected.data[3 * pixel + c]);
          squares += d * d;
        }
        sum += double(image.data[4 * pixel + 3]);
      }
      errors[adaptive] = squares;
      visible[adaptive] = sum / double(image.data.size() / 4);
    }
    // Fields leave little noise anyway.
    EXPECT_LT(errors[1], (by == By::fields ? 1.0 : 0.5) * errors[0]);
    EXPECT_NEAR(visible[1], visible[0], 0.005);
  }
}

TEST(Hybrid, ToleranceZeroIsMonteCarlo) {
  uint32_t seed = 1;
  for (const HybridScene& s : hybrid_scenes(32)) {
    for (const Sampling& sampling : k_samplings) {
      RenderOptions o = options_for(Method::monte_carlo, sampling.light_samples, seed++);
      o.max_depth = sampling.max_depth;
      const RenderResult expected = render(s.scene, o);
      EXPECT_GT(mean(expected.image), 0.05) << s.name;
      EXPECT_GT(expected.stats.rays_exact, 0u) << s.name;
      o.method = Method::hybrid;
      o.tolerance = 0.0f;
      const RenderResult r = render(s.scene, o);
      EXPECT_EQ(differing(r.image, expected.image), 0u) << s.name << " " << sampling.light_samples;
      EXPECT_EQ(r.stats.lookups, 0u) << s.name;
      EXPECT_EQ(r.stats.field_objects, 0u) << s.name;
    }
  }
}

// With every cell undecided, rays go through look-up, baking and compaction, and all are traced in the end.
TEST(Hybrid, UndecidedCellsGiveMonteCarlo) {
  uint32_t seed = 100;
  uint64_t lookups = 0;
  for (const HybridScene& s : hybrid_scenes(24)) {
    // Many samples make small groups, in which even the crowd has few enough candidates for look-ups.
    const bool all = s.name == "object_over_floor";
    const bool crowd = s.name == "crowd";
    for (const Sampling& sampling : k_samplings) {
      if (!all && &sampling != &k_samplings[crowd ? 3 : seed % 4]) continue;
      RenderOptions o = options_for(Method::monte_carlo, sampling.light_samples, seed);
      use_small_fields(o);
      o.max_depth = sampling.max_depth;
      const RenderResult expected = render(s.scene, o);
      o.method = Method::hybrid;
      o.force_undecided = true;
      if (seed % 2 == 0) o.tolerance = 1.0f;
      const RenderResult r = render(s.scene, o);
      EXPECT_EQ(differing(r.image, expected.image), 0u) << s.name << " " << sampling.light_samples;
      EXPECT_EQ(r.stats.rays_exact, expected.stats.rays_exact) << s.name;
      EXPECT_EQ(r.stats.rays_crossing, expected.stats.rays_crossing) << s.name;
      lookups += r.stats.lookups;
    }
    ++seed;
  }
  EXPECT_GT(lookups, 1000u);
}

class HybridPicture : public testing::TestWithParam<const char*> {
 protected:
  // Several tiles, with odd sizes.
  static constexpr int k_size = 40;
  const Scene scene_ = hybrid_scene(GetParam(), k_size).scene;

  // 4 light samples: the fewest that whole lights and strata are asked about for; 16: one in each stratum.
  RenderOptions options(int light_samples = 4) const {
    RenderOptions o = options_for(Method::hybrid, light_samples, 3);
    use_small_fields(o);
    o.max_depth = std::string(GetParam()) == "materials" ? 4 : 2;
    o.leave_to_rays = std::string(GetParam()) != "crowd";  // its fields do not pay for so small a picture
    o.aovs = {"visibility", "exact"};
    return o;
  }
};

TEST_P(HybridPicture, DoesNotDependOnThreads) {
  for (const int light_samples : {4, 16}) {
    RenderOptions o = options(light_samples);
    o.threads = 1;
    const RenderResult one = render(scene_, o);
    EXPECT_LE(one.stats.rays_exact, one.stats.rays_crossing);
    o.threads = 5;
    const RenderResult five = render(scene_, o);
    EXPECT_EQ(differing(one.image, five.image), 0u);
    EXPECT_EQ(one.stats.rays_exact, five.stats.rays_exact);
    // Not with 16: whole lights are looked up direction by direction until one decides, and one that another thread is
    // baking does not decide yet.
    if (light_samples == 4) {
      EXPECT_EQ(one.stats.field_cells_baked, five.stats.field_cells_baked);
    }
  }
}

TEST_P(HybridPicture, DoesNotDependOnTheInstructionSet) {
  for (const int light_samples : {4, 16}) {
    RenderOptions o = options(light_samples);
    const test::TemporaryFolder folder;  // so that fields are baked once
    o.field_cache = folder.path();
    o.isa = Isa::scalar;
    const RenderResult scalar = render(scene_, o);
    for (const Isa isa : supported_isas()) {
      o.isa = isa;
      const RenderResult r = render(scene_, o);
      EXPECT_EQ(differing(scalar.image, r.image), 0u) << isa_name(isa);
      EXPECT_EQ(scalar.stats.rays_exact, r.stats.rays_exact) << isa_name(isa);
    }
  }
}

TEST_P(HybridPicture, DoesNotDependOnTheFieldCache) {
  RenderOptions o = options();
  const RenderResult none = render(scene_, o);
  const test::TemporaryFolder folder;
  o.field_cache = folder.path();
  const RenderResult cold = render(scene_, o);
  EXPECT_EQ(differing(none.image, cold.image), 0u);
  EXPECT_EQ(cold.stats.bake_rays, none.stats.bake_rays);
  const RenderResult warm = render(scene_, o);
  EXPECT_EQ(differing(none.image, warm.image), 0u);
  EXPECT_EQ(warm.stats.bake_rays, 0u);
  EXPECT_EQ(warm.stats.rays_exact, none.stats.rays_exact);
}

// Rays alone get fewer light samples than fields leave to take, and so another tolerance: surveys of the resumed
// picture have that of the first.
TEST(Hybrid, ResumedPicturesHaveTheSameFields) {
  Scene scene = hybrid_scene("odd_transforms", 48).scene;
  RenderOptions o = options_for(Method::hybrid, 1);
  o.leave_to_rays = true;
  o.directions = 32, o.plane = 64;
  o.max_depth = 2;
  o.spp = 64;
  const RenderResult whole = render(scene, o);
  EXPECT_GT(whole.stats.lookups, 0u);
  EXPECT_LT(whole.stats.tolerance, k_default_tolerance);
  const test::TemporaryFolder folder;
  o.checkpoint = folder / "picture";
  o.checkpoint_seconds = 0.0;
  o.threads = 1;
  std::atomic<bool> stop = false;
  RenderCallbacks callbacks;
  callbacks.stop = &stop;
  callbacks.tile = [&](const Rect&, std::span<const Rgb>) { stop = true; };
  ASSERT_TRUE(render(scene, o, callbacks).interrupted);
  o.resume = o.checkpoint;
  const RenderResult resumed = render(scene, o);
  EXPECT_TRUE(resumed.stats.resumed);
  EXPECT_EQ(differing(resumed.image, whole.image), 0u);
  EXPECT_EQ(resumed.stats.tolerance, whole.stats.tolerance);
  EXPECT_EQ(resumed.stats.field_self_to_rays, whole.stats.field_self_to_rays);
}

// Not for each cell that the next picture asks for.
TEST(Hybrid, FieldFilesAreWrittenAgainOnceTheyHaveGrown) {
  namespace fs = std::filesystem;
  Scene scene = hybrid_scene("object_over_floor", 64).scene;
  const test::TemporaryFolder folder;
  RenderOptions o = options_for(Method::hybrid, 64);
  o.max_depth = 2;
  o.directions = 32, o.plane = 64;
  o.field_cache = folder.path();
  const auto kept = [&] {
    uint64_t bytes = 0;
    for (const fs::directory_entry& e : fs::directory_iterator(folder.path())) bytes += e.file_size();
    return bytes;
  };
  const uint64_t bake = render(scene, o).stats.bake_rays, bytes = kept();
  ASSERT_GT(bytes, 0u);
  o.seed = 2;
  const uint64_t few = render(scene, o).stats.bake_rays;
  EXPECT_GT(few, 0u);
  EXPECT_LT(few, bake / 16);
  EXPECT_EQ(kept(), bytes);
  EXPECT_EQ(render(scene, o).stats.bake_rays, few);  // again
  Instance& lamp = scene.instances[scene.emitters[0].instance];
  lamp.to_world[3] -= Vec3(3.0f, 1.0f, 0.0f);
  lamp.to_object = Affine(inverse_affine(DAffine(lamp.to_world)));
  EXPECT_GT(render(scene, o).stats.bake_rays, bake / 16);
  EXPECT_GT(kept(), bytes);
  EXPECT_EQ(render(scene, o).stats.bake_rays, 0u);
}

// Where cost decides as well.
TEST(Hybrid, CachesHoldWhatIsBaked) {
  for (const int film : {64, 2048}) {
    const Scene scene = hybrid_scene("object_over_floor", film).scene;
    RenderOptions o = options_for(Method::hybrid, film == 64 ? 1024 : 256);
    o.max_depth = 2;
    o.leave_to_rays = true;
    o.directions = o.plane = 0;
    o.crop = Rect{film / 2 - 16, film / 2 - 16, 32, 32};
    const test::TemporaryFolder folder;
    o.field_cache = folder.path();
    const RenderResult cold = render(scene, o), warm = render(scene, o);
    EXPECT_GT(cold.stats.bake_rays, 0u) << film;
    EXPECT_EQ(warm.stats.bake_rays, 0u) << film;
    EXPECT_EQ(differing(cold.image, warm.image), 0u);
  }
}

TEST_P(HybridPicture, CropIsThatPartOfTheWhole) {
  for (const int light_samples : {4, 16}) {
    RenderOptions o = options(light_samples);
    const Image whole = render(scene_, o).image;
    o.crop = Rect{5, 9, 33, 26};
    const Image part = render(scene_, o).image;
    size_t different = 0;
    for (int y = 0; y < part.height; ++y) {
      for (int x = 0; x < part.width; ++x) {
        for (size_t c = 0; c < part.channel_count(); ++c)
          different += part.pixel(x, y)[c] != whole.pixel(x + 5, y + 9)[c];
      }
    }
    EXPECT_EQ(different, 0u);
  }
}

INSTANTIATE_TEST_SUITE_P(Scenes, HybridPicture,
                         testing::Values("overlapping", "crowd", "nested_balls", "odd_transforms", "materials"),
                         [](const auto& instance) { return std::string(instance.param); });

// The film decides which fields there are: a pixel must not depend on the window that it is rendered in.
TEST(Hybrid, FieldsAreThoseOfTheFilmInEveryWindow) {
  Scene scene = hybrid_scene("object_over_floor", 724).scene;
  // A light of 3 degrees, which gets fine cells if there are enough rays.
  Instance& lamp = scene.instances[scene.emitters[0].instance];
  for (int axis = 0; axis < 3; ++axis) lamp.to_world[axis] *= 0.25f;
  for (int column = 0; column < 4; ++column) lamp.to_object[column] *= 4.0f;
  RenderOptions o;
  o.method = Method::hybrid;
  o.spp = 64;
  o.light_samples = 1;  // 34 million rays for the film, 16 thousand for the window
  o.crop = Rect{354, 354, 16, 16};
  EXPECT_EQ(render(scene, o).stats.field_directions, 64);
  scene.film.width = scene.film.height = 127;
  scene.film.crop = {0, 0, 127, 127};
  o.crop = Rect{61, 61, 16, 16};
  EXPECT_EQ(render(scene, o).stats.field_directions, 32);
}

}  // namespace
}  // namespace fieldtrace
