// Whole pictures through an emulated GPU equal those of the CPU, bit for bit, and it is the GPU that answers them.
#include <gtest/gtest.h>

#include "core/mesh/mesh_procedural.h"
#include "tests/gpu/emulated_device.h"
#include "tests/support/hybrid_scenes.h"
#include "tests/support/random_lines.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace {
namespace {

RenderOptions options_for(int spp, int light_samples) {
  RenderOptions o;
  o.spp = spp;
  o.light_samples = light_samples;
  o.threads = 2;
  o.directions = 32;
  o.plane = 64;
  o.leave_to_rays = false;
  return o;
}

// What decides a picture, beside its pixels. Look-ups are not among it: they are repeated as bakes demand.
void expect_equal(const RenderResult& device, const RenderResult& cpu, const std::string& name) {
  EXPECT_EQ(device.image.data, cpu.image.data) << name;
  const Stats &a = device.stats, &b = cpu.stats;
  EXPECT_EQ(a.rays_exact, b.rays_exact) << name;
  EXPECT_EQ(a.rays_crossing, b.rays_crossing) << name;
  EXPECT_EQ(a.cones_clear, b.cones_clear) << name;
  EXPECT_EQ(a.cones_blocked, b.cones_blocked) << name;
  EXPECT_EQ(a.strata_refused, b.strata_refused) << name;
  EXPECT_EQ(a.samples_spared, b.samples_spared) << name;
  EXPECT_EQ(a.check_answers, b.check_answers) << name;
  EXPECT_EQ(a.check_wrong, b.check_wrong) << name;
  EXPECT_EQ(a.field_cells_baked, b.field_cells_baked) << name;
  EXPECT_EQ(a.field_tiles_baked, b.field_tiles_baked) << name;
}

// Renders on the CPU and on the device, whose share of the blocks must be at least `least_share`.
void expect_same_picture(const Scene& scene, const RenderOptions& o, double least_share, const std::string& name) {
  const RenderResult cpu = render(scene, o);
  const test::EmulatedPicture device = test::render_emulated(scene, o);
  expect_equal(device.result, cpu, name);
  const Stats& s = device.result.stats;
  EXPECT_GE(double(s.device_blocks), least_share * double(s.device_blocks + s.device_blocks_cpu)) << name;
  EXPECT_GT(s.device_blocks, 0u) << name;
  EXPECT_TRUE(device.warnings.empty()) << name << ": " << device.warnings[0];
  EXPECT_TRUE(test::is_clean(device.log)) << name;
}

Scene knot_over_floor(const Mat3& shape, int size) {
  test::SceneMaker s;
  s.film(size, size);
  s.scene.camera.to_world = test::look_at({2.5f, -6, 3}, {0, 0, 0.3f}, {0, 0, 1});
  s.scene.camera.fov_x_degrees = 20.0f;
  const uint32_t grey = s.bsdf(BsdfKind::diffuse, Rgb(0.5f));
  s.instance(s.mesh(make_knot({.along = 256, .around = 24})), grey, Affine(shape[0], shape[1], shape[2], {0, 0, 1}));
  s.instance(s.shape(ShapeKind::rectangle), grey, test::scaling(Vec3(6.0f)));
  Affine at = test::scaling(Vec3(0.5f));
  at[3] = {2, -2, 4};
  s.area_light(s.instance(s.shape(ShapeKind::sphere), grey, at), Rgb(60.0f));
  const Affine turned = test::look_at({-2, -3, 5}, {0, 0, 0.5f}, {0, 0, 1});
  s.area_light(s.instance(s.shape(ShapeKind::rectangle), grey,
                          Affine(0.7f * turned[0], 0.4f * turned[1], 0.4f * turned[2], turned[3])),
               Rgb(60.0f));
  return s.scene;
}

// Instances of three meshes, more than single rays are tested against.
Scene crowd(int size) {
  test::SceneMaker maker;
  TestRandom random(1);
  maker.film(size, size);
  maker.scene.camera.to_world = test::look_at({0, -9, 5}, {0, 0, 0}, {0, 0, 1});
  maker.scene.camera.fov_x_degrees = 35.0f;
  const uint32_t grey = maker.bsdf(BsdfKind::diffuse, Rgb(0.5f));
  maker.instance(maker.shape(ShapeKind::rectangle), grey, test::scaling(Vec3(8.0f)));
  std::vector<uint32_t> shapes;
  for (int i = 0; i < 3; ++i) {
    SupershapeParams p;
    p.longitude.m = 3.0 + i;
    p.around = 32;
    p.along = 16;
    shapes.push_back(maker.mesh(make_supershape(p)));
  }
  for (int n = 0; n < 49; ++n) {
    const float scale = random.uniform(0.25f, 0.5f);
    Affine a = test::scaling(Vec3(scale));
    a[3] = {float(n % 7 - 3) + random.uniform(-0.2f, 0.2f), float(n / 7 - 3) + random.uniform(-0.2f, 0.2f), scale};
    maker.instance(shapes[random.index(3)], grey, a);
  }
  Affine light = test::scaling(Vec3(0.7f));
  light[3] = {4, -4, 6};
  maker.area_light(maker.instance(maker.shape(ShapeKind::sphere), grey, light), Rgb(100.0f));
  return maker.scene;
}

TEST(EmulatedPicture, EqualsTheCpusForAllSplitsOfSamples) {
  const Scene scene = knot_over_floor(Mat3(1.0f), 48);
  struct Split {
    int spp, light_samples;
  };
  for (const Split& split : {Split{1, 64}, Split{4, 16}, Split{16, 4}, Split{16, 1}, Split{2, 1}}) {
    expect_same_picture(scene, options_for(split.spp, split.light_samples), 0.3,
                        std::to_string(split.spp) + " x " + std::to_string(split.light_samples));
  }
}

TEST(EmulatedPicture, EqualsTheCpusAtAllTolerances) {
  const Scene scene = knot_over_floor(Mat3(1.0f), 40);
  for (const float tolerance : {0.01f, 0.3f, 1.0f}) {
    RenderOptions o = options_for(1, 16);
    o.tolerance = tolerance;
    expect_same_picture(scene, o, 0.1, std::to_string(tolerance));
  }
  RenderOptions o = options_for(1, 16);
  o.whole_lights = false;
  expect_same_picture(scene, o, 0.1, "single rays");
  o = options_for(1, 16);
  o.check = true;
  expect_same_picture(scene, o, 0.1, "checked");
  o = options_for(1, 16);
  o.leave_to_rays = true;
  o.directions = o.plane = 0;
  EXPECT_EQ(test::render_emulated(scene, o).result.image.data, render(scene, o).image.data);
}

TEST(EmulatedPicture, EqualsTheCpusOfSquashedInstances) {
  const auto squash = [](const Vec3& axis, float factor) {
    const Vec3 n = glm::normalize(axis);
    return Mat3(1.0f) + (factor - 1.0f) * glm::outerProduct(n, n);
  };
  expect_same_picture(knot_over_floor(squash({0, 0, 1}, 0.1f), 40), options_for(1, 64), 0.2, "a tenth");
  expect_same_picture(knot_over_floor(squash({0.3f, 1, 0.5f}, 1e-4f), 40), options_for(1, 16), 0.1, "flat");
  expect_same_picture(knot_over_floor(squash({1, -0.4f, 0.6f}, -0.03f), 40), options_for(4, 4), 0.1, "mirrored");
}

TEST(EmulatedPicture, EqualsTheCpusOfACrowd) {
  const Scene scene = crowd(48);
  expect_same_picture(scene, options_for(1, 32), 0.2, "1 x 32");
  expect_same_picture(scene, options_for(4, 1), 0.2, "4 x 1");
}

TEST(EmulatedPicture, EqualsTheCpusOfHardScenes) {
  for (const test::HybridScene& s : test::hybrid_scenes(24)) {
    const RenderOptions o = options_for(1, 16);
    const RenderResult cpu = render(s.scene, o);
    const test::EmulatedPicture device = test::render_emulated(s.scene, o);
    expect_equal(device.result, cpu, s.name);
    EXPECT_TRUE(test::is_clean(device.log)) << s.name;
  }
}

TEST(EmulatedPicture, IsTheSameForAnyThreads) {
  const Scene scene = knot_over_floor(Mat3(1.0f), 96);
  RenderOptions o = options_for(1, 16);
  o.threads = 8;
  const test::EmulatedPicture many = test::render_emulated(scene, o);
  expect_equal(many.result, render(scene, o), "8 threads");
  o.threads = 1;
  const test::EmulatedPicture one = test::render_emulated(scene, o);
  EXPECT_EQ(one.result.image.data, many.result.image.data);
  EXPECT_TRUE(test::is_clean(many.log));
}

// The device copies what its questions need and no more.
TEST(EmulatedPicture, OnlyWhatIsAskedForIsResident) {
  const Scene scene = knot_over_floor(Mat3(1.0f), 48);
  const RenderOptions o = options_for(1, 16);
  const test::EmulatedPicture device = test::render_emulated(scene, o);
  EXPECT_GT(device.log.launches[int(gpu::Kernel::scatter)], 0u);
  EXPECT_LT(device.log.launches[int(gpu::Kernel::scatter)], device.result.stats.device_waves);
  EXPECT_LT(20 * device.log.peak_bytes, Field::most_bytes({32, 64}));
}

}  // namespace
}  // namespace fieldtrace
