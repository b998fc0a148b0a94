// The hybrid method against Monte Carlo over the same samples: equal where every ray is exact, close where fields
// answer, and the same picture whatever the machine does.

#include <gtest/gtest.h>

#include "hybrid/compare/compare.h"
#include "hybrid/render/render.h"
#include "tests/support/field_checks.h"
#include "tests/support/hybrid_scenes.h"

namespace fieldtrace {
namespace {

using test::hybrid_scene;
using test::hybrid_scenes;
using test::HybridScene;

RenderOptions options_for(Method method, int light_samples, uint32_t seed = 1) {
  RenderOptions o;
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
  Scene scene = hybrid_scene("object_over_floor", 2048).scene;
  // A light of 3 degrees, which gets fine cells if there are enough rays.
  Instance& lamp = scene.instances[scene.emitters[0].instance];
  for (int axis = 0; axis < 3; ++axis) lamp.to_world[axis] *= 0.25f;
  for (int column = 0; column < 4; ++column) lamp.to_object[column] *= 4.0f;
  RenderOptions o;
  o.method = Method::hybrid;
  o.spp = 1;
  o.light_samples = 1;  // 4.2 million rays for the film, a few hundred for the window
  o.crop = Rect{1000, 1000, 16, 16};
  EXPECT_EQ(render(scene, o).stats.field_directions, 64);
  scene.film.width = scene.film.height = 1024;
  scene.film.crop = {0, 0, 1024, 1024};
  o.crop = Rect{500, 500, 16, 16};
  EXPECT_EQ(render(scene, o).stats.field_directions, 32);
}

}  // namespace
}  // namespace fieldtrace
