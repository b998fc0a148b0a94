// How much of a picture's noise is that of its light, and what maps of a sky may cost for it.

#include "hybrid/survey/light_noise.h"

#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <atomic>

#include "core/mesh/mesh_procedural.h"
#include "core/mesh/mesh_stress.h"
#include "hybrid/render/render.h"
#include "tests/hybrid/survey/surveyed_scene.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace {
namespace {

using namespace test;

constexpr int k_size = 64;
// Of what surfaces send on, the share whose noise is taken away.
constexpr double k_none_sent_on = 0.0, k_all_sent_on = 1.0;

struct TestScene : SceneMaker {
  uint32_t grey = 0;

  TestScene() {
    film(k_size, k_size);
    scene.camera.to_world = look_at({0, 3, 4}, {0, 0, 0}, {0, 1, 0});
    scene.integrator.max_depth = -1;
    grey = bsdf(BsdfKind::diffuse, Rgb(0.8f));
    scene.bsdfs[grey].two_sided = true;
  }
  // Fills the view.
  void floor() {
    instance(shape(ShapeKind::rectangle), grey, Affine(Vec3(30, 0, 0), Vec3(0, 0, -30), Vec3(0, 30, 0), Vec3(0)));
  }
  // Upright, beside and behind what is seen.
  void walls() {
    const uint32_t square = shape(ShapeKind::rectangle);
    instance(square, grey, Affine(Vec3(0, 0, 9), Vec3(0, 9, 0), Vec3(-9, 0, 0), Vec3(-6, 0, 0)));
    instance(square, grey, Affine(Vec3(9, 0, 0), Vec3(0, 9, 0), Vec3(0, 0, 9), Vec3(0, 0, -9)));
  }
  // Bright from one side alone.
  void one_sided_sky() {
    environment(32, 16, [](int x, int y) { return y < 8 && x < 4 ? Rgb(20.0f) : Rgb(0.1f); });
  }

  // `asks`: as often goes_on() is true; becomes what is left of that.
  LightNoise::Without without(double share, int& asks, uint32_t seed = 0, int light_samples = 1) const {
    TransportSettings settings;
    settings.max_depth = scene.integrator.max_depth;
    settings.rr_depth = 100;
    settings.seed = seed;
    settings.light_samples = light_samples;
    const SurveyedScene surveyed{scene, settings};
    Stats stats;
    std::atomic<int> left = asks;
    const LightNoise noise(surveyed.with([&] { return left-- > 0; }), stats);
    const LightNoise::Without found = noise.without(share);
    asks = left;
    return found;
  }
  double gain_without(double share, uint32_t seed = 0, int light_samples = 1) const {
    int asks = 1 << 30;
    const double gain = without(share, asks, seed, light_samples).gain;
    EXPECT_GE(gain, 1.0);
    EXPECT_LE(gain, LightNoise::most_gain());
    return gain;
  }
  Stats rendered(RenderOptions o) const {
    o.method = Method::hybrid;
    o.spp = 64;
    o.max_depth = 2;
    return render(scene, o).stats;
  }
  uint64_t objects_mapped(const RenderOptions& o) const { return rendered(o).sky_objects; }
};

// Emitters alone: whatever light brings, edges of their discs are all of the noise.
TEST(LightNoise, IsNoneWhereEdgesHoldAllOfIt) {
  TestScene s;
  const uint32_t sphere = s.shape(ShapeKind::sphere);
  for (int i = -2; i <= 2; ++i) {
    Affine place = scaling(Vec3(0.3f));
    place[3] = Vec3(float(i), 0.2f * float(i), 0);
    s.area_light(s.instance(sphere, s.grey, place), Rgb(5.0f));
  }
  s.scene.integrator.max_depth = 1;
  EXPECT_EQ(s.gain_without(k_none_sent_on), 1.0);
}

TEST(LightNoise, IsAllOfItOnAnOpenFloor) {
  TestScene s;
  s.floor();
  s.one_sided_sky();
  EXPECT_GT(s.gain_without(k_none_sent_on), 8.0);
}

// Of a floor that sees all of an even sky what arrives has no noise of its own value: that is told without it.
TEST(LightNoise, TellsTheLightWithoutIt) {
  TestScene s;
  s.floor();
  s.light(EmitterKind::constant, Rgb(2.0f));
  s.instance(s.mesh(make_sphere()), s.grey, Affine(1.0f));
  s.scene.integrator.max_depth = 2;
  TransportSettings settings;
  settings.max_depth = 2;
  settings.light_samples = 1;
  const SurveyedScene surveyed{s.scene, settings};
  Stats stats;
  const LightNoise noise(surveyed.with([] { return true; }), stats);
  // All of it, but where nothing hides the sky from a pixel: there nothing is noisy.
  EXPECT_GT(noise.light(), 0.2 * 1.6 * 1.6);
  EXPECT_LT(noise.light(), 1.6 * 1.6);
  // Edges fall faster than light.
  const double one = noise.left_of(k_none_sent_on, 1.0), four = noise.left_of(k_none_sent_on, 4.0);
  EXPECT_GT(one, 0.0);
  EXPECT_LT(four, one / 6.0);
  EXPECT_GT(four, one / 8.01);
}

// A point's light is exact at the first surface, and random beyond.
TEST(LightNoise, IsToldApartByPaths) {
  TestScene s;
  s.floor(), s.walls();
  s.light(EmitterKind::point, Rgb(40.0f), Vec3(1, 3, 1));
  const double direct = s.gain_without(k_none_sent_on), all = s.gain_without(k_all_sent_on);
  EXPECT_LT(direct, 1.05);
  EXPECT_GT(all, 1.5);
}

// A ray of a path under a white sky brings light from it, or from what it meets. Both together have less noise than one
// alone, so that no more than a half is taken away without what is sent on, though direct light alone has more than
// all.
TEST(LightNoise, OfWhatIsSentOnMakesUpForTheSkys) {
  TestScene s;
  s.floor(), s.walls();
  s.light(EmitterKind::constant, Rgb(1.0f));
  TestScene direct = s;
  direct.scene.integrator.max_depth = 2;
  EXPECT_GT(direct.gain_without(k_none_sent_on), 8.0);
  double last = s.gain_without(k_none_sent_on);
  EXPECT_LT(last, 1.6);
  for (const double share : {0.5, 0.9, 1.0}) {
    const double gain = s.gain_without(share);
    EXPECT_GT(gain, last) << share;
    last = gain;
  }
  EXPECT_GT(last, 8.0);
}

// What light samples leave of it is less, but for that of longer paths, which have one.
TEST(LightNoise, IsLessWithLightSamples) {
  TestScene ball, room;
  ball.floor();
  ball.instance(ball.mesh(make_sphere()), ball.grey, Affine(1.0f));
  ball.one_sided_sky();
  const double one = ball.gain_without(k_none_sent_on), many = ball.gain_without(k_none_sent_on, 0, 1024);
  EXPECT_GT(one, 1.5 * many);
  room.floor(), room.walls();
  room.light(EmitterKind::point, Rgb(40.0f), Vec3(1, 3, 1));
  EXPECT_NEAR(room.gain_without(k_all_sent_on, 0, 1024), room.gain_without(k_all_sent_on), 0.05);
}

// Out of focus, a lamp's edges are noise of the lens.
TEST(LightNoise, IsNotThatOfALens) {
  TestScene s;
  s.area_light(s.instance(s.shape(ShapeKind::sphere), s.grey, scaling(Vec3(0.8f))), Rgb(5.0f));
  s.scene.integrator.max_depth = 1;
  s.scene.camera.aperture_radius = 0.3f;
  s.scene.camera.focus_distance = 2.0f;
  EXPECT_EQ(s.gain_without(k_none_sent_on), 1.0);
}

TEST(LightNoise, DependsNeitherOnThreadsNorOnTheSeed) {
  TestScene s;
  s.floor();
  s.one_sided_sky();
  s.area_light(s.instance(s.shape(ShapeKind::sphere), s.grey, scaling(Vec3(0.8f))), Rgb(20.0f));  // for edges
  double gains[2];
  for (int threads : {1, 2}) {
    tbb::task_arena arena(threads);
    arena.execute([&] { gains[threads - 1] = s.gain_without(k_all_sent_on, uint32_t(threads)); });
  }
  EXPECT_EQ(gains[0], gains[1]);
  EXPECT_GT(gains[0], 1.0);
  EXPECT_LT(gains[0], LightNoise::most_gain());
}

// Nothing is concluded from surveys that were cut short, wherever.
TEST(LightNoise, GainsNothingWhereItIsCut) {
  TestScene s;
  s.floor();
  s.one_sided_sky();
  tbb::task_arena arena(1);
  arena.execute([&] {
    int left = 1 << 30;
    EXPECT_GT(s.without(k_all_sent_on, left).gain, 8.0);
    const int all = (1 << 30) - left;
    EXPECT_GT(all, 2);
    for_each_cut(all, [&](int most) {
      left = most;
      const LightNoise::Without cut = s.without(k_all_sent_on, left);
      EXPECT_EQ(cut.gain, 1.0) << most;
      EXPECT_EQ(cut.share, 1.0) << most;
    });
  });
}

// Hairs before a white sky, whose edges are the noise, and a ball on a floor, whose shadow is. Both take as much to
// map.
TEST(LightNoise, DecidesWhetherASkyHasMaps) {
  TestScene hairs, ball;
  hairs.instance(hairs.mesh(make_hair_ball({.hairs = 600})), hairs.grey, Affine(1.0f));
  hairs.light(EmitterKind::constant, Rgb(1.0f));
  ball.floor();
  ball.instance(ball.mesh(make_sphere()), ball.grey, Affine(1.0f));
  ball.one_sided_sky();
  EXPECT_EQ(hairs.objects_mapped({}), 0u);
  EXPECT_EQ(ball.objects_mapped({}), 1u);
  // The film decides, whatever part of it is rendered, by however many threads.
  for (const TestScene* s : {&hairs, &ball}) {
    const Stats whole = s->rendered({});
    RenderOptions part;
    part.crop = Rect{0, 0, 8, 8};
    part.threads = 1;
    const Stats of_part = s->rendered(part);
    EXPECT_EQ(of_part.sky_objects, whole.sky_objects);
    EXPECT_EQ(of_part.sky_directions, whole.sky_directions);
    EXPECT_EQ(of_part.survey_rays, whole.survey_rays);
  }
  // What is asked for is made.
  RenderOptions at_any_cost;
  at_any_cost.directions = 32;
  EXPECT_EQ(hairs.objects_mapped(at_any_cost), 1u);
}

}  // namespace
}  // namespace fieldtrace
