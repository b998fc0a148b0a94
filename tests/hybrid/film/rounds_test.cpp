// Pictures to an error, in a time, and from checkpoints: errors are as estimated, adaptive samples bring no bias, and
// interrupts leave no trace.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <filesystem>
#include <map>

#include "core/io/scratch_folder.h"
#include "hybrid/compare/compare.h"
#include "hybrid/render/picture.h"
#include "hybrid/render/picture_identity.h"
#include "hybrid/render/render.h"
#include "tests/support/hybrid_scenes.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace {
namespace {

constexpr int k_size = 48;

RenderOptions options_of(Method method, float target, uint32_t seed) {
  RenderOptions o;
  o.method = method;
  o.target_error = target;
  o.seed = seed;
  o.threads = 2;
  return o;
}

Image reference_of(const Scene& scene, int spp, uint32_t seed = 4711) {
  RenderOptions o;
  o.method = Method::monte_carlo;
  o.spp = spp;
  o.seed = seed;
  o.threads = 2;
  return render(scene, o).image;
}

// What the message says that refuses the picture; empty: it is rendered.
std::string refusal(const RenderOptions& options, const Scene& scene) {
  try {
    render(scene, options);
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

// Renders with a checkpoint at `path`. Returns the options that go on from there.
RenderOptions begun(RenderOptions options, const Scene& scene, const std::string& path) {
  options.checkpoint = path;
  render(scene, options);
  options.resume = path;
  return options;
}

double rmse(const Image& a, const Image& b) { return compare_images(a, b).rmse; }

class ErrorOf : public testing::TestWithParam<const char*> {};
class BiasOf : public testing::TestWithParam<const char*> {};

// Means over seeds, so that chance does not hide what is wrong: estimates of .8 to 1.25 of the error.
TEST_P(ErrorOf, RoundsIsAsEstimated) {
  const Scene scene = test::hybrid_scene(GetParam(), k_size).scene;
  Image reference = reference_of(scene, 4096);
  const Image other = reference_of(scene, 4096, 4712);
  const double own_error = 0.5 * rmse(reference, other);  // of their mean
  for (size_t i = 0; i < other.data.size(); ++i) reference.data[i] = 0.5f * (reference.data[i] + other.data[i]);
  for (const Method method : {Method::monte_carlo, Method::hybrid}) {
    for (const float target : {0.04f, 0.02f, 0.01f}) {
      double estimated = 0.0, found = 0.0;
      for (uint32_t seed = 1; seed <= 12; ++seed) {
        const RenderResult result = render(scene, options_of(method, target, seed));
        EXPECT_LE(result.stats.error_estimate, target * 1.0001);
        EXPECT_TRUE(result.stats.samples_fewest >= 2u || result.stats.samples_most == 1u);
        estimated += result.stats.error_estimate * result.stats.error_estimate;
        const double error = rmse(result.image, reference);
        found += error * error - own_error * own_error;
      }
      const double ratio = std::sqrt(estimated / found);
      EXPECT_GT(ratio, 0.8) << target << (method == Method::hybrid ? " hybrid" : " Monte Carlo");
      EXPECT_LT(ratio, 1.25) << target << (method == Method::hybrid ? " hybrid" : " Monte Carlo");
    }
  }
}

constexpr size_t k_block = 16, k_blocks = (k_size / k_block) * (k_size / k_block);

// A picture's sums in blocks, then in the whole.
std::vector<double> sums_of_blocks(const Image& image) {
  std::vector<double> sums(k_blocks + 1, 0.0);
  for (int y = 0; y < k_size; ++y) {
    for (int x = 0; x < k_size; ++x) {
      const float* const p = image.pixel(x, y);
      const double sum = double(p[0]) + double(p[1]) + double(p[2]);
      sums[size_t(y) / k_block * (k_size / k_block) + size_t(x) / k_block] += sum;
      sums[k_blocks] += sum;
    }
  }
  return sums;
}

struct MeanOfSeeds {
  double mean = 0.0, square = 0.0;  // square: of its standard error
};

MeanOfSeeds mean_of(const std::vector<std::vector<double>>& sums, size_t block) {
  MeanOfSeeds m;
  const double n = double(sums.size());
  for (const auto& s : sums) m.mean += s[block] / n;
  for (const auto& s : sums) m.square += (s[block] - m.mean) * (s[block] - m.mean) / (n * (n - 1.0));
  return m;
}

// The mean over 128 seeds agrees with that of references within their standard errors, in the whole and in blocks:
// sampling that ends where noise is low by chance would make pictures too dark.
TEST_P(BiasOf, RoundsIsNone) {
  const Scene scene = test::hybrid_scene(GetParam(), k_size).scene;
  constexpr uint32_t k_seeds = 128, k_references = 8;
  std::vector<std::vector<double>> pictures, references;
  for (uint32_t seed = 0; seed < k_references; ++seed)
    references.push_back(sums_of_blocks(reference_of(scene, 4096, 4711 + seed)));
  // An eighth of the noise of two samples: some rounds.
  RenderOptions two = options_of(Method::monte_carlo, 1e-6f, 99);
  two.spp = 2;
  const auto target = float(render(scene, two).stats.error_noise / 8.0);
  uint32_t most = 0;
  for (uint32_t seed = 1; seed <= k_seeds; ++seed) {
    const RenderResult result = render(scene, options_of(Method::monte_carlo, target, seed));
    most = std::max(most, result.stats.rounds);
    pictures.push_back(sums_of_blocks(result.image));
  }
  EXPECT_GE(most, 2u) << "nothing was adaptive";
  double chi_square = 0.0, blocks = 0.0;
  for (size_t i = 0; i <= k_blocks; ++i) {
    const MeanOfSeeds ours = mean_of(pictures, i), theirs = mean_of(references, i);
    const double square = ours.square + theirs.square;
    if (!(square > 1e-14)) continue;  // nothing but background
    const double z = (ours.mean - theirs.mean) / std::sqrt(square);
    if (i == k_blocks) {
      EXPECT_LT(std::abs(z), 3.5);
    } else {
      chi_square += z * z;
      blocks += 1.0;
    }
  }
  ASSERT_GT(blocks, 3.0);
  EXPECT_LT(chi_square, blocks + 4.0 * std::sqrt(2.0 * blocks));
}

const auto k_name = [](const auto& test) { return std::string(test.param); };
// Not where a few pixels hold most of the error (lights_within): their estimates are chance (docs/limits.md).
INSTANTIATE_TEST_SUITE_P(Scenes, ErrorOf, testing::Values("object_over_floor", "crowd", "environment_map", "coatings"),
                         k_name);
INSTANTIATE_TEST_SUITE_P(Scenes, BiasOf,
                         testing::Values("object_over_floor", "lights_within", "environment_map", "coatings",
                                         "odd_transforms"),
                         k_name);

// A render that is interrupted again and again, with other numbers of threads, ends as one that never was.
TEST(Checkpoints, InterruptsLeaveNoTrace) {
  const ScratchFolder folder(testing::TempDir(), "rounds");
  for (const char* name : {"object_over_floor", "environment_map", "crowd"}) {
    const Scene scene = test::hybrid_scene(name, 96).scene;
    for (const Method method : {Method::monte_carlo, Method::hybrid}) {
      for (const bool by_rounds : {false, true}) {
        RenderOptions o = options_of(method, by_rounds ? 0.01f : 0.0f, 3);
        o.spp = by_rounds ? 256 : 9;
        o.aovs = {"albedo", "samples", "variance", "object"};
        const Image whole = render(scene, o).image;
        o.checkpoint = folder.path() + "/picture";
        o.checkpoint_seconds = 0.0;
        std::filesystem::remove(o.checkpoint);
        int interrupts = 0;
        RenderResult result;
        do {
          o.threads = 1 + interrupts % 3;
          o.resume = std::filesystem::exists(o.checkpoint) ? o.checkpoint : "";
          std::atomic<bool> stop = false;
          RenderCallbacks callbacks;
          callbacks.stop = &stop;
          int calls = 0;
          callbacks.progress = [&](float, const char*) { stop = interrupts < 6 && ++calls > interrupts % 3; };
          result = render(scene, o, callbacks);
          ++interrupts;
        } while (result.interrupted);
        EXPECT_EQ(whole.data, result.image.data) << name << " " << int(method) << by_rounds;
      }
    }
  }
}

// Pictures under a sky whose maps were given up for rays go on by rays.
TEST(Checkpoints, MapsThatWereGivenUpStaySo) {
  const ScratchFolder folder(testing::TempDir(), "rounds");
  size_t by_rays = 0;
  for (const char* name : {"environment", "environment_map"}) {
    const Scene scene = test::hybrid_scene(name, k_size).scene;
    for (const float target : {0.05f, 0.02f, 0.005f}) {
      RenderOptions o = options_of(Method::hybrid, target, 3);
      o.checkpoint = folder.path() + "/maps";
      const RenderResult whole = render(scene, o);
      by_rays += whole.stats.sky_objects == 0;
      o.resume = o.checkpoint;
      EXPECT_EQ(render(scene, o).image.data, whole.image.data) << name << target;
    }
  }
  EXPECT_GT(by_rays, 0u);
}

TEST(Checkpoints, GoOnForMoreSamplesOrLessError) {
  const ScratchFolder folder(testing::TempDir(), "rounds");
  const Scene scene = test::hybrid_scene("object_over_floor", k_size).scene;
  const Image reference = reference_of(scene, 2048);
  RenderOptions o = options_of(Method::monte_carlo, 0.0f, 3);
  o.spp = 4;
  o.checkpoint = folder.path() + "/samples";
  const double before = rmse(render(scene, o).image, reference);
  o.resume = o.checkpoint;
  o.spp = 64;
  o.aovs = {};
  const RenderResult more = render(scene, o);
  EXPECT_TRUE(more.stats.resumed);
  EXPECT_EQ(more.stats.spp, 64);
  EXPECT_LT(rmse(more.image, reference), 0.5 * before);
  RenderOptions at_once = o;
  at_once.resume = at_once.checkpoint = "";
  // Samples go on in the same sequence; rays through edges may end otherwise in other packets.
  EXPECT_LT(rmse(more.image, render(scene, at_once).image), 1e-5);
  // Sixty of them are new.
  EXPECT_GT(more.stats.rays_primary, uint64_t(60 * k_size * k_size - 1));
  EXPECT_LT(more.stats.rays_primary, uint64_t(61 * k_size * k_size));
  o.spp = 16;
  const RenderResult fewer = render(scene, o);
  EXPECT_EQ(fewer.image.data, more.image.data) << "fewer samples than there are change nothing";
  EXPECT_EQ(fewer.stats.spp, 64);
  o.spp = 3;
  EXPECT_NE(refusal(o, scene).find("give --spp 4 or more"), std::string::npos)
      << "what was decided for 4 samples is not what 3 would have";

  RenderOptions e = options_of(Method::hybrid, 0.04f, 3);
  e = begun(e, scene, folder.path() + "/error");
  e.target_error = 0.01f;
  const RenderResult less = render(scene, e);
  EXPECT_LE(less.stats.error_estimate, 0.01);
  EXPECT_LT(rmse(less.image, reference), 0.0125);
}

// However early a resumed render is stopped, what was there is written.
TEST(Checkpoints, StoppedAtOnceKeepThePicture) {
  const ScratchFolder folder(testing::TempDir(), "rounds");
  const Scene scene = test::hybrid_scene("object_over_floor", k_size).scene;
  for (const Method method : {Method::monte_carlo, Method::hybrid}) {
    RenderOptions o = options_of(method, 0.0f, 3);
    o.spp = 4;
    o.aovs = {};
    o.checkpoint = folder.path() + "/stopped";
    const Image before = render(scene, o).image;
    o.resume = o.checkpoint;
    o.spp = 16;
    const std::atomic<bool> stop = true;
    RenderCallbacks callbacks;
    callbacks.stop = &stop;
    const RenderResult stopped = render(scene, o, callbacks);
    EXPECT_TRUE(stopped.interrupted);
    EXPECT_EQ(stopped.image.data, before.data) << int(method);
  }
}

// What answered in the first half of a picture answers in the second.
TEST(Checkpoints, OtherMemoryIsRefused) {
  const ScratchFolder folder(testing::TempDir(), "rounds");
  const Scene scene = test::hybrid_scene("object_over_floor", k_size).scene;
  RenderOptions o = options_of(Method::hybrid, 0.0f, 3);
  o.spp = 4;
  o.aovs = {};
  o = begun(o, scene, folder.path() + "/memory");
  o.spp = 8;
  const RenderCallbacks none;
  Checkpoint state = read_checkpoint(o.checkpoint, picture_identity(Picture(scene, o, none)));
  const auto maps = std::find_if(state.decided.begin(), state.decided.end(),
                                 [](const auto& decision) { return decision.first == "direction maps"; });
  ASSERT_NE(maps, state.decided.end());
  EXPECT_EQ(maps->second, "none");
  maps->second = "77 bytes";
  write_checkpoint(o.checkpoint, state);
  EXPECT_NE(refusal(o, scene).find("direction maps is none instead of 77 bytes"), std::string::npos);
}

// A pass for more samples that was stopped is begun for these, whatever the first command's were.
TEST(Checkpoints, APassIsNotCutShort) {
  const ScratchFolder folder(testing::TempDir(), "rounds");
  const Scene scene = test::hybrid_scene("object_over_floor", k_size).scene;
  RenderOptions o = options_of(Method::monte_carlo, 0.0f, 3);
  o.spp = 2;
  o.aovs = {};
  o.checkpoint_seconds = 0.0;
  o.threads = 1;
  o = begun(o, scene, folder.path() + "/pass");
  o.spp = 8;
  std::atomic<bool> stop = false;
  std::atomic<int> tiles = 0;
  RenderCallbacks callbacks;
  callbacks.stop = &stop;
  // Those of the first pass are shown before; then the pass ends amid its tiles.
  constexpr int k_tiles = ((k_size + 31) / 32) * ((k_size + 31) / 32);
  callbacks.tile = [&](const Rect&, std::span<const Rgb>) { stop = ++tiles > k_tiles; };
  EXPECT_TRUE(render(scene, o, callbacks).interrupted);
  EXPECT_EQ(tiles, k_tiles + 1);
  o.spp = 4;
  EXPECT_NE(refusal(o, scene).find("was begun for 8 samples a pixel"), std::string::npos) << refusal(o, scene);
  o.spp = 8;
  // Its last checkpoint but one: all tiles are there, and the pass is not ended.
  const std::string last = folder.path() + "/last";
  RenderCallbacks at_end;
  at_end.progress = [&](float share, const char*) {
    if (share == 1.0f)
      std::filesystem::copy_file(o.checkpoint, last, std::filesystem::copy_options::overwrite_existing);
  };
  render(scene, o, at_end);
  ASSERT_TRUE(std::filesystem::exists(last));
  o.resume = last;
  EXPECT_EQ(refusal(o, scene), "");
}

// Names and values of a command need not be UTF-8, and a parameter that is left out makes another picture.
TEST(Checkpoints, ParametersMayBeAnyBytes) {
  const ScratchFolder folder(testing::TempDir(), "rounds");
  Scene scene = test::hybrid_scene("object_over_floor", 16).scene;
  scene.parameters["caf\xe9"] = "\xff";
  RenderOptions o = options_of(Method::monte_carlo, 0.0f, 3);
  o.spp = 2;
  o.checkpoint = folder.path() + "/bytes";
  const Image whole = render(scene, o).image;
  o.resume = o.checkpoint;
  EXPECT_EQ(render(scene, o).image.data, whole.data);
  scene.parameters["caf\xe9"] = "\xfe";
  EXPECT_THROW(render(scene, o), Error);
  scene.parameters.clear();
  EXPECT_THROW(render(scene, o), Error);
}

TEST(Checkpoints, AreRefusedForOtherOptionsByName) {
  const ScratchFolder folder(testing::TempDir(), "rounds");
  const Scene scene = test::hybrid_scene("object_over_floor", 16).scene;
  RenderOptions o = options_of(Method::monte_carlo, 0.0f, 3);
  o.spp = 2;
  o = begun(o, scene, folder.path() + "/picture");
  EXPECT_EQ(refusal(o, scene), "");
  const std::map<std::string, std::function<void(RenderOptions&)>> changes = {
      {"--method", [](RenderOptions& c) { c.method = Method::hybrid; }},
      {"--seed", [](RenderOptions& c) { c.seed = 9; }},
      {"--light-samples", [](RenderOptions& c) { c.light_samples = 2; }},
      {"--light-estimator", [](RenderOptions& c) { c.light_estimator = LightEstimator::adaptive; }},
      {"--lobe-samples", [](RenderOptions& c) { c.lobe_samples = 3; }},
      {"--tolerance", [](RenderOptions& c) { c.tolerance = 0.1f; }},
      {"--directions", [](RenderOptions& c) { c.directions = 32; }},
      {"--plane", [](RenderOptions& c) { c.plane = 64; }},
      {"--field-hits", [](RenderOptions& c) { c.field_hits = FieldHits::never; }},
      {"--field-memory", [](RenderOptions& c) { c.field_memory = 1 << 30; }},
      {"--max-depth", [](RenderOptions& c) { c.max_depth = 3; }},
      {"--aov", [](RenderOptions& c) { c.aovs = {"depth"}; }},
      {"--ao-distance", [](RenderOptions& c) { c.ao_distance = 2.0f; }},
      {"the crop window",
       [](RenderOptions& c) {
         c.crop = Rect{0, 0, 8, 8};
       }},
      {"--target-error", [](RenderOptions& c) { c.target_error = 0.1f; }},
  };
  for (const auto& [name, change] : changes) {
    RenderOptions changed = o;
    change(changed);
    EXPECT_NE(refusal(changed, scene).find(name + (name == "--target-error" ? " or" : " is")), std::string::npos)
        << name << ": " << refusal(changed, scene);
  }
  EXPECT_NE(refusal(o, test::hybrid_scene("materials", 16).scene).find("the scene is"), std::string::npos);
}

// As for a picture whose first target allowed fields to err more than the next one does.
TEST(Checkpoints, EndWhereFieldsErrMoreThanTheTarget) {
  const ScratchFolder folder(testing::TempDir(), "rounds");
  const Scene scene = test::hybrid_scene("environment_map", k_size).scene;
  RenderOptions o = options_of(Method::hybrid, 0.04f, 3);
  o.checkpoint = folder.path() + "/picture";
  const Image first = render(scene, o).image;
  const RenderCallbacks none;
  Checkpoint state = read_checkpoint(o.checkpoint, picture_identity(Picture(scene, o, none)));
  state.field_mean_square = 0.02 * 0.02;
  write_checkpoint(o.checkpoint, state);
  o.resume = o.checkpoint;
  o.target_error = 0.01f;
  std::string warning;
  RenderCallbacks callbacks;
  callbacks.warning = [&](const std::string& message) { warning += message; };
  const RenderResult result = render(scene, o, callbacks);
  EXPECT_EQ(result.image.data, first.data);
  EXPECT_NEAR(result.stats.error_fields, 0.02, 1e-12);
  EXPECT_NE(warning.find("fields alone err by 0.02"), std::string::npos) << warning;
}

TEST(Rounds, TakeCoarseMapsWhereTheTargetAllowsThem) {
  const Scene scene = test::hybrid_scene("environment_map", 256).scene;
  const Stats loose = render(scene, options_of(Method::hybrid, 0.05f, 3)).stats;
  const Stats tight = render(scene, options_of(Method::hybrid, 0.002f, 3)).stats;
  EXPECT_EQ(loose.sky_directions, 16);
  EXPECT_GT(loose.lookups, 0u);
  EXPECT_EQ(tight.sky_directions, 32);
  EXPECT_GT(tight.lookups, 0u);
  EXPECT_GT(tight.error_fields, 0.0);
}

// A lamp beside a sky has fields in pictures of as many samples, but not by rounds, where maps answer for the sky.
TEST(Rounds, LeaveLampsToRaysUnderASkyOfMaps) {
  test::SceneMaker s;
  s.scene = test::hybrid_scene("environment_map", 256).scene;
  Affine at = test::scaling(Vec3(0.3f));
  at[3] = {2, -2, 4};
  s.area_light(s.instance(s.shape(ShapeKind::sphere), 0, at), Rgb(20.0f));
  const Stats stats = render(s.scene, options_of(Method::hybrid, 0.005f, 3)).stats;
  EXPECT_GT(stats.sky_objects, 0u);
  EXPECT_EQ(stats.field_objects, 0u);
}

// Then a survey tells of its noise; lower targets go on from it.
TEST(Rounds, TakeOneSampleWhereThatWillDo) {
  const ScratchFolder folder(testing::TempDir(), "rounds");
  const Scene scene = test::hybrid_scene("object_over_floor", k_size).scene;
  const Image reference = reference_of(scene, 2048);
  for (const Method method : {Method::monte_carlo, Method::hybrid}) {
    RenderOptions o = options_of(method, 0.15f, 1);
    double estimated = 0.0, found = 0.0;
    for (uint32_t seed = 1; seed <= 8; ++seed) {
      o.seed = seed;
      const RenderResult result = render(scene, o);
      EXPECT_EQ(result.stats.samples_most, 1u);
      EXPECT_LE(result.stats.error_estimate, 0.15);
      estimated += result.stats.error_estimate * result.stats.error_estimate;
      found += rmse(result.image, reference) * rmse(result.image, reference);
    }
    EXPECT_GT(std::sqrt(estimated / found), 0.8);
    EXPECT_LT(std::sqrt(estimated / found), 1.25);

    o.seed = 1;
    o.checkpoint = folder.path() + "/" + std::to_string(int(method));
    const Image one = render(scene, o).image;
    o.resume = o.checkpoint;
    EXPECT_EQ(render(scene, o).image.data, one.data);
    o.target_error = 0.01f;
    const RenderResult less = render(scene, o);
    EXPECT_GE(less.stats.samples_fewest, 2u);
    EXPECT_LE(less.stats.error_estimate, 0.01);
    EXPECT_LT(rmse(less.image, reference), 0.0125);
    o.resume = o.checkpoint = "";
    o.target_error = 0.15f;
    o.aovs = {"variance"};
    EXPECT_GE(render(scene, o).stats.samples_fewest, 2u) << "one sample tells nothing of its variance";
  }
}

TEST(Rounds, StopAtTheMostSamples) {
  const Scene scene = test::hybrid_scene("materials", k_size).scene;
  for (const int most : {2, 5, 7, 8}) {
    RenderOptions o = options_of(Method::monte_carlo, 1e-6f, 3);
    o.spp = most;
    const Stats stats = render(scene, o).stats;
    EXPECT_LE(stats.samples_most, uint32_t(most));
    EXPECT_EQ(stats.samples_most, std::bit_floor(uint32_t(most)));
    EXPECT_GT(stats.error_estimate, 1e-6);
  }
}

TEST(Rounds, EndWithTheTime) {
  const Scene scene = test::hybrid_scene("materials", k_size).scene;
  for (const Method method : {Method::monte_carlo, Method::hybrid}) {
    RenderOptions o = options_of(method, 0.0f, 3);
    o.time_limit = 0.5f;
    o.aovs = {"samples"};
    const RenderResult result = render(scene, o);
    EXPECT_FALSE(result.interrupted);
    // Those of a round that the end has cut off count, too.
    double samples = 0.0;
    for (int y = 0; y < k_size; ++y) {
      for (int x = 0; x < k_size; ++x) samples += double(result.image.pixel(x, y)[3]) / (k_size * k_size);
    }
    EXPECT_NEAR(result.stats.samples_mean, samples, 1e-6 * samples);
    // However slow the machine is: what has samples in both halves has an estimate.
    EXPECT_GT(result.stats.error_estimate, 0.0);
    EXPECT_EQ(std::isfinite(result.stats.error_estimate), result.stats.samples_fewest >= 2);
  }
}

TEST(Rounds, WithoutTimeTellNothingOfTheError) {
  const Scene scene = test::hybrid_scene("materials", k_size).scene;
  RenderOptions o = options_of(Method::monte_carlo, 0.0f, 3);
  o.time_limit = 1e-6f;
  std::vector<std::string> warnings;
  RenderCallbacks callbacks;
  callbacks.warning = [&](const std::string& line) { warnings.push_back(line); };
  const Stats stats = render(scene, o, callbacks).stats;
  EXPECT_EQ(stats.samples_fewest, 0u);
  EXPECT_TRUE(std::isinf(stats.error_estimate));
  EXPECT_NE(stats.to_json().find("\"estimate\": null"), std::string::npos) << stats.to_json();
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_NE(warnings[0].find("the rest is black"), std::string::npos);
}

// Of one pixel, too, whose own samples alone tell of its noise.
TEST(Rounds, SmallWindowsHaveSamplesToJudgeBy) {
  const Scene scene = test::hybrid_scene("object_over_floor", k_size).scene;
  RenderOptions o = options_of(Method::monte_carlo, 0.5f, 3);
  for (const int side : {1, 2, 8}) {
    o.crop = Rect{20, 24, side, side};
    EXPECT_GE(render(scene, o).stats.samples_mean * side * side, 256.0);
    o.spp = 4;
    EXPECT_LE(render(scene, o).stats.samples_most, 4u);
    o.spp = 0;
  }
}

// Direction maps would take more than the time: rays answer.
TEST(Rounds, MapsThatAreNotMadeInTimeAreGivenUp) {
  const Scene scene = test::hybrid_scene("environment_map", k_size).scene;
  RenderOptions o = options_of(Method::hybrid, 0.0f, 3);
  o.tolerance = 0.01f;  // the finest maps
  o.time_limit = 0.5f;
  EXPECT_TRUE(render(scene, o).has_samples);
}

TEST(Rounds, RefuseWhatCannotBe) {
  const Scene scene = test::hybrid_scene("object_over_floor", 16).scene;
  RenderOptions o = options_of(Method::hybrid, 0.1f, 3);
  o.spp = 1;
  EXPECT_THROW(render(scene, o), UsageError);
  o.spp = 0;
  o.chart = Chart::thesis;
  EXPECT_THROW(render(scene, o), UsageError);
  o = options_of(Method::hybrid, -1.0f, 3);
  EXPECT_THROW(render(scene, o), UsageError);
  o.target_error = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THROW(render(scene, o), UsageError);
  o = options_of(Method::hybrid, 0.0f, 3);
  o.time_limit = k_infinity;
  EXPECT_THROW(render(scene, o), UsageError);
}

}  // namespace
}  // namespace fieldtrace
