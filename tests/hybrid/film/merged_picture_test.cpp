// Slices of a picture, joined, are the picture bit for bit: with fields, maps of skies and of gloss, crowds, crop
// windows and layers, however many slices there are and on whatever machine each was rendered.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cstring>
#include <functional>

#include "core/io/scratch_folder.h"
#include "core/mesh/mesh_procedural.h"
#include "hybrid/render/render.h"
#include "tests/support/hybrid_scenes.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace {
namespace {

constexpr int k_size = 112;  // 4 x 4 tiles, those at the ends cut off

class MergedPicture : public testing::Test {
 protected:
  // Renders all slices, each with another number of threads, and joins them. `change` may change a slice's options.
  Image merged(const Scene& scene, RenderOptions o, int count,
               const std::function<void(int number, RenderOptions&)>& change = {}) {
    std::vector<std::string> paths;
    for (int k = 1; k <= count; ++k) {
      o.slice = Slice{k, count};
      o.threads = 1 + k % 3;
      RenderOptions own = o;
      if (change) change(k, own);
      const RenderResult result = render(scene, own);
      EXPECT_FALSE(result.interrupted);
      EXPECT_EQ(result.stats.slice, slice_text(*o.slice));
      paths.push_back(folder_.path() + "/" + std::to_string(k) + ".exr");
      write_part(paths.back(), result.image, result.part.value(), {});
      stats_ = result.stats;
    }
    return merge_parts(paths).image;
  }

  static void expect_same(const Image& a, const Image& b, const std::string& what) {
    SCOPED_TRACE(what);
    ASSERT_EQ(a.channels, b.channels);
    ASSERT_EQ(a.width, b.width);
    ASSERT_EQ(a.height, b.height);
    ASSERT_EQ(a.data.size(), b.data.size());
    EXPECT_EQ(std::memcmp(a.data.data(), b.data.data(), a.data.size() * sizeof(float)), 0);
  }

  ScratchFolder folder_{testing::TempDir(), "merged"};
  Stats stats_;  // of the last slice
};

RenderOptions options_of(Method method) {
  RenderOptions o;
  o.method = method;
  o.spp = 4;
  o.seed = 9;
  o.threads = 2;
  return o;
}

class MergedSlices : public MergedPicture, public testing::WithParamInterface<const char*> {};

// By fields and maps wherever they can answer, as the hybrid chooses by itself, and by Monte Carlo.
TEST_P(MergedSlices, AreTheWhole) {
  const std::string name = GetParam();
  const Scene scene = test::hybrid_scene(name, k_size).scene;
  RenderOptions o = options_of(Method::hybrid);
  if (name == "coatings") o.lobe_samples = 16;
  o.aovs = {"albedo", "depth", "object", "exact", "variance", "ao"};
  RenderOptions by_request = o, by_rays = o;
  by_request.leave_to_rays = false;
  by_rays.method = Method::monte_carlo;
  expect_same(merged(scene, by_request, 3), render(scene, by_request).image, "fields");
  const bool by_maps = name.rfind("environment", 0) == 0;
  EXPECT_GT(by_maps ? stats_.sky_objects : stats_.field_objects, 0u);
  expect_same(merged(scene, o, 7), render(scene, o).image, "by itself");
  for (const int count : {1, 2, 19}) expect_same(merged(scene, by_rays, count), render(scene, by_rays).image, "rays");
}

INSTANTIATE_TEST_SUITE_P(Scenes, MergedSlices,
                         testing::Values("object_over_floor", "environment_map", "environment", "crowd", "materials",
                                         "coatings"),
                         [](const auto& test) { return std::string(test.param); });

// Windows that begin within blocks of pixels, and within tiles; crowds trace more than their window.
TEST_F(MergedPicture, IsTheCropWindow) {
  for (const char* name : {"object_over_floor", "crowd", "environment_map"}) {
    const Scene scene = test::hybrid_scene(name, k_size).scene;
    for (const Rect window : {Rect{13, 21, 93, 40}, Rect{50, 60, 1, 1}}) {
      RenderOptions o = options_of(Method::hybrid);
      o.leave_to_rays = false;
      o.crop = window;
      o.aovs = {"position"};
      const Image whole = render(scene, o).image;
      expect_same(merged(scene, o, 3), whole, name);
    }
  }
}

// Radiance maps for glossy rays are shaded by every slice.
TEST_F(MergedPicture, IsTheWholeWithRadianceMaps) {
  test::SceneMaker m;
  m.film(k_size, k_size);
  m.scene.camera.to_world = test::look_at({3, 3, 5}, {0, 0.4f, 0}, {0, 1, 0});
  m.scene.integrator.max_depth = 3;
  const uint32_t clay = m.bsdf(BsdfKind::diffuse, Rgb(0.5f, 0.4f, 0.3f));
  m.instance(m.mesh(make_knot({.along = 256, .around = 24})), clay, test::translation({0, 1.2f, 0}));
  m.lit_floor(m.metal(0.15f), clay);
  RenderOptions o = options_of(Method::hybrid);
  o.leave_to_rays = false;
  o.spp = 1;
  o.lobe_samples = 256;
  const Image whole = render(m.scene, o).image;
  expect_same(merged(m.scene, o, 3), whole, "knot");
  EXPECT_GT(stats_.field_bytes_maps, 0u);
  EXPECT_GT(stats_.rays_glossy, 2 * stats_.rays_glossy_exact);
}

// Slices that find a cache, one that others have filled, or none; other instruction sets.
TEST_F(MergedPicture, DoesNotDependOnTheMachines) {
  const Scene scene = test::hybrid_scene("odd_transforms", k_size).scene;
  RenderOptions o = options_of(Method::hybrid);
  o.leave_to_rays = false;
  const Image whole = render(scene, o).image;
  const auto change = [&](int number, RenderOptions& own) {
    if (number > 1) own.field_cache = folder_.path() + "/cache";
    if (number == 2) own.isa = Isa::scalar;
    if (number == 3) own.field_memory = 4'000'000'000;
  };
  // Whose --field-memory is not the others', is of another picture.
  EXPECT_THROW(merged(scene, o, 3, change), Error);
  const auto without = [&](int number, RenderOptions& own) {
    change(number, own);
    own.field_memory = 0;
  };
  expect_same(merged(scene, o, 3, without), whole, "cache");
  expect_same(merged(scene, o, 3, without), whole, "warm cache");
  EXPECT_GT(stats_.field_objects, 0u);
}

TEST_F(MergedPicture, IsThatOfTheThesisChart) {
  const Scene scene = test::hybrid_scene("object_over_floor", k_size).scene;
  RenderOptions o = options_of(Method::hybrid);
  o.chart = Chart::thesis;
  o.directions = 32;
  o.tolerance = 0.1f;
  expect_same(merged(scene, o, 3), render(scene, o).image, "thesis");
  EXPECT_GT(stats_.field_objects, 0u);
}

TEST_F(MergedPicture, TakesWhatIsWrittenAsTheWholeIs) {
  const Scene scene = test::hybrid_scene("coatings", k_size).scene;
  RenderOptions o = options_of(Method::hybrid);
  o.aovs = {"depth", "normal"};
  const Image whole = render(scene, o).image, joined = merged(scene, o, 3);
  for (const bool half : {true, false}) {
    ImageWriteOptions options;
    options.half = half;
    const std::string a = folder_.path() + "/a.exr", b = folder_.path() + "/b.exr";
    write_image(a, whole, options);
    write_image(b, joined, options);
    expect_same(read_image(b), read_image(a), half ? "half" : "float");
  }
}

// Every tile is in one slice's work: slices trace about their share of camera rays, and no more together.
TEST_F(MergedPicture, IsSharedWork) {
  const Scene scene = test::hybrid_scene("object_over_floor", 128).scene;
  RenderOptions o = options_of(Method::monte_carlo);
  o.max_depth = 2;
  const uint64_t whole = render(scene, o).stats.rays_primary;
  uint64_t sum = 0;
  for (int k = 1; k <= 4; ++k) {
    o.slice = Slice{k, 4};
    const uint64_t rays = render(scene, o).stats.rays_primary;
    EXPECT_EQ(rays, whole / 4);
    sum += rays;
  }
  EXPECT_EQ(sum, whole);
}

// What the whole picture would do when memory runs out, a slice cannot know.
TEST_F(MergedPicture, IsRefusedWhereFieldsOutgrowTheirMemory) {
  const Scene scene = test::hybrid_scene("object_over_floor", k_size).scene;
  RenderOptions o = options_of(Method::hybrid);
  o.light_samples = 16;
  o.leave_to_rays = false;
  o.field_memory = 300'000;
  EXPECT_GT(render(scene, o).stats.field_restarts, 0u);
  o.slice = Slice{1, 2};
  try {
    render(scene, o);
    FAIL() << "rendered";
  } catch (const Error& error) {
    const std::string message = error.what();
    EXPECT_NE(message.find("the fields of slice 1/2 outgrew"), std::string::npos) << message;
    EXPECT_NE(message.find("raise --field-memory"), std::string::npos) << message;
  }
}

TEST_F(MergedPicture, IsOfSamplesAtOnce) {
  const Scene scene = test::hybrid_scene("object_over_floor", 32).scene;
  RenderOptions o = options_of(Method::monte_carlo);
  o.slice = Slice{1, 2};
  RenderOptions by_error = o, by_time = o, kept = o;
  by_error.target_error = 0.1f;
  by_time.time_limit = 1.0f;
  kept.checkpoint = folder_.path() + "/checkpoint";
  for (const RenderOptions& refused : {by_error, by_time, kept}) EXPECT_THROW(render(scene, refused), UsageError);
}

}  // namespace
}  // namespace fieldtrace
