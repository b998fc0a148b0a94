// The layer `ao`: against scenes with known answers, hybrid against Monte Carlo, and its invariances.

#include <gtest/gtest.h>

#include <cmath>

#include "hybrid/render/render.h"
#include "tests/support/hybrid_scenes.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace {
namespace {

using test::hybrid_scene;
using test::look_at;
using test::scaling;
using test::SceneMaker;
using test::translation;

RenderOptions options_for(Method method, int spp, int light_samples) {
  RenderOptions o;
  o.method = method;
  o.spp = spp;
  o.light_samples = light_samples;
  o.threads = 2;
  o.aovs = {"ao"};
  return o;
}

double mean_occlusion(const Image& image) {
  const int channel = image.channel_index("ao.Y");
  EXPECT_GE(channel, 0);
  double sum = 0.0;
  for (size_t i = size_t(channel); i < image.data.size(); i += image.channel_count()) sum += double(image.data[i]);
  return sum / double(image.width * image.height);
}

// Of the layer, over the pixels that see objects, or over those that see the floor (the first instance) or nothing.
double mean_difference(const Image& a, const Image& b, bool objects) {
  const int a_channel = a.channel_index("ao.Y"), b_channel = b.channel_index("ao.Y");
  const int object = b.channel_index("object.Y");
  double sum = 0.0;
  int count = 0;
  for (int i = 0; i < a.width * a.height; ++i) {
    const int x = i % a.width, y = i / a.width;
    if ((b.pixel(x, y)[object] > 1.5f) != objects) continue;
    sum += double(a.pixel(x, y)[a_channel]) - double(b.pixel(x, y)[b_channel]), ++count;
  }
  EXPECT_GT(count, 50);
  return sum / double(count);
}

// Every pixel sees the origin of the plane z = 0; nothing hides it from the camera.
SceneMaker origin_of_a_plane(float size = 500.0f) {
  SceneMaker maker;
  const uint32_t grey = maker.bsdf(BsdfKind::diffuse, Rgb(0.5f));
  maker.instance(maker.shape(ShapeKind::rectangle), grey, scaling(Vec3(size)));
  maker.scene.camera.fov_x_degrees = 1e-3f;
  maker.scene.camera.to_world = look_at({0, -8, 2}, Vec3(0), {0, 0, 1});
  return maker;
}

double render_occlusion(const Scene& scene, float distance, Method method = Method::monte_carlo, int spp = 16) {
  RenderOptions o = options_for(method, spp, 64);
  o.ao_distance = distance;
  return mean_occlusion(render(scene, o).image);
}

// 256 pixels x 16 x 64 points: the standard error of as many independent ones of a share of one half, .5 / 512.
constexpr double k_tolerance = 1e-3;

TEST(AmbientOcclusion, OpenPlaneAndEmptySceneAreOpen) {
  SceneMaker maker = origin_of_a_plane();
  EXPECT_EQ(render_occlusion(maker.scene, k_infinity), 1.0);
  SceneMaker empty;
  empty.scene.camera.to_world = look_at({0, -8, 2}, Vec3(0), {0, 0, 1});
  EXPECT_EQ(render_occlusion(empty.scene, k_infinity), 1.0);
}

// A sphere of radius R at height h above the point hides the cone of sin = R / h, which is (R / h)^2 of the
// cosine-weighted hemisphere. Within a distance D it hides the directions whose nearer intersection lies at D or less:
// D^2 + h^2 - 2 D h cos = R^2.
TEST(AmbientOcclusion, PointUnderASphere) {
  constexpr float k_radius = 1.0f, k_height = 1.5f;
  SceneMaker maker = origin_of_a_plane();
  maker.instance(maker.shape(ShapeKind::sphere), 0, translation({0, 0, k_height}));
  // The camera sees the point from below the sphere: its rays, of slope 2 / 8, pass underneath.
  const double cone = (k_radius / k_height) * (k_radius / k_height);
  EXPECT_NEAR(render_occlusion(maker.scene, k_infinity), 1.0 - cone, k_tolerance);
  EXPECT_NEAR(render_occlusion(maker.scene, 50.0f), 1.0 - cone, k_tolerance);
  for (const double distance : {0.6, 0.8, 1.0}) {
    const double cosine =
        (distance * distance + k_height * k_height - k_radius * k_radius) / (2.0 * distance * k_height);
    EXPECT_NEAR(render_occlusion(maker.scene, float(distance)), cosine * cosine, k_tolerance) << distance;
  }
  EXPECT_EQ(render_occlusion(maker.scene, 0.49f), 1.0);
}

// A wall at distance w hides directions whose component along its normal is at least w / D: a segment of the unit disk
// that the cosine-weighted hemisphere projects to.
TEST(AmbientOcclusion, PointBesideAWall) {
  SceneMaker maker = origin_of_a_plane();
  constexpr float k_wall = 2.0f;
  // The camera looks along the wall, which faces the point.
  maker.instance(maker.shape(ShapeKind::rectangle), 0,
                 Affine(Vec3(0, 0, 500), Vec3(0, 500, 0), Vec3(-1, 0, 0), Vec3(k_wall, 0, 0)));
  for (const double distance : {2.5, 4.0, 20.0}) {
    const double c = double(k_wall) / distance;
    const double hidden = (std::acos(c) - c * std::sqrt(1.0 - c * c)) / M_PI;
    EXPECT_NEAR(render_occlusion(maker.scene, float(distance)), 1.0 - hidden, k_tolerance) << distance;
  }
  EXPECT_EQ(render_occlusion(maker.scene, 1.9f), 1.0);
  // The rectangle ends at a distance of 500: less than 1 % of its half of the sky is seen past it.
  EXPECT_NEAR(render_occlusion(maker.scene, k_infinity), 0.5, 5e-3);
}

// The same by direction cells, which know parallelograms.
TEST(AmbientOcclusion, CellsBesideAWall) {
  SceneMaker maker = origin_of_a_plane();
  constexpr float k_wall = 2.0f;
  maker.instance(maker.shape(ShapeKind::rectangle), 0,
                 Affine(Vec3(0, 0, 500), Vec3(0, 500, 0), Vec3(-1, 0, 0), Vec3(k_wall, 0, 0)));
  for (const double distance : {1.9, 2.1, 2.5, 4.0, 20.0}) {
    RenderOptions o = options_for(Method::hybrid, 1, 64);
    o.directions = 32;  // by request: nothing is left to rays for its cost
    o.ao_distance = float(distance);
    const RenderResult r = render(maker.scene, o);
    const double c = std::min(double(k_wall) / distance, 1.0);
    const double hidden = (std::acos(c) - c * std::sqrt(1.0 - c * c)) / M_PI;
    EXPECT_NEAR(mean_occlusion(r.image), 1.0 - hidden, 3e-3) << distance;
    EXPECT_EQ(r.stats.rays_shadow, 0u);
    EXPECT_EQ(r.stats.sky_directions, 32);
  }
}

// Occlusion is the same for every material and path depth.
TEST(AmbientOcclusion, DoesNotDependOnTheMaterialOrThePaths) {
  for (const BsdfKind kind : {BsdfKind::diffuse, BsdfKind::conductor, BsdfKind::dielectric}) {
    for (const int depth : {1, 2, -1}) {
      SceneMaker maker = origin_of_a_plane();
      maker.scene.bsdfs[0].kind = kind;
      maker.instance(maker.shape(ShapeKind::sphere), 0, translation({0, 0, 1.5f}));
      maker.light(EmitterKind::constant, Rgb(1.0f));
      maker.scene.integrator.max_depth = depth;
      EXPECT_NEAR(render_occlusion(maker.scene, k_infinity, Method::monte_carlo, 4), 1.0 - 4.0 / 9.0, 2 * k_tolerance)
          << int(kind) << " " << depth;
    }
  }
}

TEST(AmbientOcclusion, LeavesThePictureAsItIs) {
  const Scene scene = hybrid_scene("object_over_floor", 24).scene;
  for (const Method method : {Method::monte_carlo, Method::hybrid}) {
    for (const int directions : {0, 32}) {  // 32: fields answer the layer too
      RenderOptions o = options_for(method, 2, 16);
      o.directions = directions;
      const RenderResult with = render(scene, o);
      o.aovs.clear();
      const RenderResult without = render(scene, o);
      EXPECT_EQ(with.stats.field_left_to_rays, without.stats.field_left_to_rays);
      EXPECT_EQ(with.stats.field_self_to_rays, without.stats.field_self_to_rays);
      for (int y = 0; y < with.image.height; ++y) {
        for (int x = 0; x < with.image.width; ++x) {
          for (int c = 0; c < 3; ++c) ASSERT_EQ(with.image.pixel(x, y)[c], without.image.pixel(x, y)[c]);
        }
      }
    }
  }
}

class OcclusionPicture : public testing::TestWithParam<const char*> {
 protected:
  static constexpr int k_size = 24;
  const Scene scene_ = hybrid_scene(GetParam(), k_size).scene;

  static RenderOptions options(Method method, float distance) {
    RenderOptions o = options_for(method, 1, 16);
    o.directions = 32;
    o.plane = 64;
    o.ao_distance = distance;
    return o;
  }
};
constexpr float k_near = 1.3f;
constexpr float k_distances[] = {k_infinity, k_near};

TEST_P(OcclusionPicture, ToleranceZeroIsMonteCarlo) {
  for (const float distance : k_distances) {
    RenderOptions o = options(Method::monte_carlo, distance);
    const RenderResult expected = render(scene_, o);
    EXPECT_LT(mean_occlusion(expected.image), 0.995);
    o.method = Method::hybrid;
    o.tolerance = 0.0f;
    EXPECT_EQ(render(scene_, o).image.data, expected.image.data) << distance;
    if (distance == k_infinity) continue;
    // Rays go through look-ups and baking, but all are traced in the end.
    o.force_undecided = true;
    EXPECT_EQ(render(scene_, o).image.data, expected.image.data);
  }
}

// By direction maps: without a cut-off distance, and with one that ends among the objects, in them and beyond them.
// Means over seeds: the few rays to undecided cells make one picture's mean differ by .001.
TEST_P(OcclusionPicture, HybridIsNearMonteCarlo) {
  // Crowds read coarse maps; below many objects floors are too bright.
  const bool is_crowd = std::string(GetParam()) == "crowd";
  constexpr uint32_t k_seeds = 2;
  for (const float distance : {k_infinity, 0.15f, k_near, 40.0f}) {
    std::vector<Image> expected;
    for (uint32_t seed = 1; seed <= k_seeds; ++seed) {
      RenderOptions o = options(Method::monte_carlo, distance);
      o.aovs = {"ao", "object"};
      o.light_samples = 1024;
      o.seed = seed;
      expected.push_back(render(scene_, o).image);
    }
    for (const float tolerance : {k_default_tolerance, 0.03f, 1.0f}) {
      if (tolerance != k_default_tolerance && distance != k_near) continue;
      RenderOptions o = options(Method::hybrid, distance);
      o.check = true;
      o.tolerance = tolerance;
      double of_objects = 0.0, of_floor = 0.0;
      CheckedDifferences checked;
      // At tolerance 1 nothing near by is left to rays.
      const bool is_coarse = tolerance == 1.0f;
      for (uint32_t seed = 1; seed <= k_seeds; ++seed) {
        o.seed = seed;
        const RenderResult r = render(scene_, o);
        of_objects += mean_difference(r.image, expected[seed - 1], true) / k_seeds;
        of_floor += mean_difference(r.image, expected[seed - 1], false) / k_seeds;
        checked.merge(r.stats.checked(CheckedEstimate::sky));
      }
      EXPECT_NEAR(of_objects, 0.0, is_coarse ? 6e-3 : 3e-3) << distance << " " << tolerance;
      EXPECT_NEAR(of_floor, 0.0, is_coarse || is_crowd ? 6e-3 : 3e-3) << distance << " " << tolerance;
      EXPECT_GT(checked.compared, 100u);
      EXPECT_LT(checked.mean_difference(), is_crowd ? 0.06 : 0.03) << distance << " " << tolerance;
    }
  }
}

TEST_P(OcclusionPicture, DoesNotDependOnThreadsOrInstructionSet) {
  RenderOptions o = options(Method::hybrid, k_infinity);
  o.threads = 1;
  o.isa = Isa::scalar;
  const Image one = render(scene_, o).image;
  o.threads = 3;
  o.isa = Isa::automatic;
  EXPECT_EQ(render(scene_, o).image.data, one.data);
}

TEST_P(OcclusionPicture, CropIsThatPartOfTheWhole) {
  RenderOptions o = options(Method::hybrid, k_infinity);
  const Image whole = render(scene_, o).image;
  o.crop = Rect{5, 9, 17, 11};
  const Image part = render(scene_, o).image;
  for (int y = 0; y < part.height; ++y) {
    for (int x = 0; x < part.width; ++x) {
      for (size_t c = 0; c < part.channel_count(); ++c) ASSERT_EQ(part.pixel(x, y)[c], whole.pixel(x + 5, y + 9)[c]);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Scenes, OcclusionPicture, testing::Values("object_over_floor", "crowd", "odd_transforms"),
                         [](const auto& instance) { return std::string(instance.param); });

// A picture of few rays is not worth maps.
TEST(AmbientOcclusion, BakesNoMoreThanItGains) {
  const Scene scene = hybrid_scene("object_over_floor", 64).scene;
  RenderOptions o = options_for(Method::hybrid, 1, 16);
  const RenderResult few = render(scene, o);
  o.light_samples = 128;
  EXPECT_EQ(few.stats.field_bytes_maps, 0u);
  EXPECT_GT(render(scene, o).stats.field_bytes_maps, 0u);
  o.light_samples = 16;
  o.method = Method::monte_carlo;
  const RenderResult exact = render(scene, o);
  const int channel = exact.image.channel_index("ao.Y");
  ASSERT_GE(channel, 0);
  for (size_t i = size_t(channel); i < exact.image.data.size(); i += exact.image.channel_count()) {
    ASSERT_EQ(few.image.data[i], exact.image.data[i]);
  }
}

// Maps are for distances of an object's radius and more; shorter rays are cheap.
TEST(AmbientOcclusion, MapsAnswerFromAnObjectsRadiusOn) {
  const Scene scene = hybrid_scene("object_over_floor", 64).scene;
  RenderOptions o = options_for(Method::hybrid, 1, 128);
  o.ao_distance = 0.5f;
  EXPECT_EQ(render(scene, o).stats.field_bytes_maps, 0u);
  o.ao_distance = 2.0f;
  EXPECT_GT(render(scene, o).stats.field_bytes_maps, 0u);
}

// Within less the layer is exact rays: no survey counts them for fields, which they would not ask.
TEST(AmbientOcclusion, RaysWithADistanceBakeNothing) {
  uint64_t surveyed = 0, baked = 0;
  for (const int size : {64, 128}) {
    const Scene scene = hybrid_scene("object_over_floor", size).scene;
    for (const int spp : {1, 256}) {
      RenderOptions o = options_for(Method::hybrid, spp, 1);
      o.ao_distance = 0.25f;
      const RenderResult with = render(scene, o);
      o.aovs.clear();
      const RenderResult without = render(scene, o);
      EXPECT_EQ(with.stats.bake_rays, without.stats.bake_rays) << size << " " << spp;
      EXPECT_EQ(with.stats.survey_rays, without.stats.survey_rays) << size << " " << spp;
      surveyed += without.stats.survey_rays, baked += without.stats.bake_rays;
    }
  }
  EXPECT_GT(surveyed, 0u);
  EXPECT_GT(baked, 0u);
}

TEST(AmbientOcclusion, DistanceMustBePositive) {
  for (const float bad : {0.0f, -1.0f, std::nanf("")}) {
    RenderOptions o = options_for(Method::hybrid, 1, 1);
    o.ao_distance = bad;
    EXPECT_THROW(render(origin_of_a_plane().scene, o), UsageError);
  }
}

}  // namespace
}  // namespace fieldtrace
