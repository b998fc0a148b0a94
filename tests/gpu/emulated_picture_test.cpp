// Whole pictures through an emulated GPU equal those of the CPU, bit for bit, and it is the GPU that answers them.
#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>

#include "tests/gpu/picture_checks.h"
#include "tests/gpu/recording_device.h"
#include "tests/support/hybrid_scenes.h"

namespace fieldtrace {
namespace {

using namespace test;

TEST(EmulatedPicture, EqualsTheCpusForAllSplitsOfSamples) {
  const Scene scene = knot_over_floor(Mat3(1.0f), 48);
  struct Split {
    int spp, light_samples;
  };
  for (const Split& split : {Split{1, 64}, Split{4, 16}, Split{16, 4}, Split{16, 1}, Split{2, 1}}) {
    expect_same_picture(scene, options_for(split.spp, split.light_samples),
                        std::to_string(split.spp) + " x " + std::to_string(split.light_samples));
  }
}

TEST(EmulatedPicture, EqualsTheCpusAtAllTolerances) {
  const Scene scene = knot_over_floor(Mat3(1.0f), 40);
  for (const float tolerance : {0.01f, 0.3f, 1.0f}) {
    RenderOptions o = options_for(1, 16);
    o.tolerance = tolerance;
    expect_same_picture(scene, o, std::to_string(tolerance));
  }
  RenderOptions o = options_for(1, 16);
  o.whole_lights = false;
  expect_same_picture(scene, o, "single rays");
  o = options_for(1, 16);
  o.check = true;
  expect_same_picture(scene, o, "checked");
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
  expect_same_picture(knot_over_floor(squash({0, 0, 1}, 0.1f), 40), options_for(1, 64), "a tenth");
  expect_same_picture(knot_over_floor(squash({0.3f, 1, 0.5f}, 1e-4f), 40), options_for(1, 16), "flat");
  expect_same_picture(knot_over_floor(squash({1, -0.4f, 0.6f}, -0.03f), 40), options_for(4, 4), "mirrored");
}

TEST(EmulatedPicture, EqualsTheCpusOfACrowd) {
  const Scene scene = crowd(48);
  expect_same_picture(scene, options_for(1, 32), "1 x 32");
  expect_same_picture(scene, options_for(4, 4), "4 x 4");
}

TEST(EmulatedPicture, EqualsTheCpusOfTheDemo) {
  for (const bool sky : {false, true}) {
    const Scene scene = demo(64, sky);
    const RenderOptions o = options_for(4, 4);
    const EmulatedPicture device = render_emulated(scene, o);
    const std::string name = sky ? "sky" : "lights";
    expect_equal(device.result, render(scene, o), name);
    expect_no_fault(device, name);
    EXPECT_GT(device.log.launches[int(sky ? gpu::Kernel::sky_cells : gpu::Kernel::light_cones)], 0u) << name;
  }
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
  o.wave_samples = 20000;  // several bands
  const test::EmulatedPicture many = test::render_emulated(scene, o);
  expect_equal(many.result, render(scene, o), "8 threads");
  gpu::EmulatedFaults faults;
  faults.eager = true;
  const test::EmulatedPicture eager = test::render_emulated(scene, o, faults);
  EXPECT_EQ(eager.result.image.data, many.result.image.data);
  EXPECT_TRUE(test::is_clean(eager.log));
  o.threads = 1;
  const test::EmulatedPicture one = test::render_emulated(scene, o);
  EXPECT_EQ(one.result.image.data, many.result.image.data);
  EXPECT_TRUE(test::is_clean(many.log));
}

// Strata, and several samples of a point, are made on the device, if they can be: then no rays go up.
TEST(EmulatedPicture, RaysAreMadeFromShadingPoints) {
  struct Case {
    bool whole_lights, transmits;
    int light_samples;
    bool makes;
  };
  for (const Case& c : {Case{true, false, 64, true}, Case{false, false, 16, true}, Case{true, true, 64, true}}) {
    Scene scene = knot_over_floor(Mat3(1.0f), 32);
    if (c.transmits) {
      for (Bsdf& b : scene.bsdfs) b.kind = BsdfKind::rough_dielectric, b.alpha_u = b.alpha_v = 0.5f;
    }
    RenderOptions o = options_for(1, c.light_samples);
    o.whole_lights = c.whole_lights;
    const EmulatedPicture device = render_emulated(scene, o);
    const std::string name = std::to_string(c.light_samples) + (c.transmits ? " transmits" : "");
    expect_equal(device.result, render(scene, o), name);
    EXPECT_EQ(device.log.launches[int(gpu::Kernel::light_rays)] > 0, c.makes) << name;
    EXPECT_GT(device.result.stats.device_blocks, 0u) << name;
  }
}

// The cells of skies are the device's, and so is what comes back from objects; skies' maps go to it once.
TEST(EmulatedPicture, SkyCellsAreTheDevices) {
  bool any = false;
  for (const HybridScene& s : hybrid_scenes(24)) {
    RenderOptions o = options_for(1, 16);
    o.threads = 1;
    const EmulatedPicture device = render_emulated(s.scene, o);
    const uint64_t waves = device.log.launches[int(gpu::Kernel::sky_cells)];
    if (waves == 0) continue;
    any = true;
    expect_equal(device.result, render(s.scene, o), s.name);
    EXPECT_TRUE(device.warnings.empty()) << s.name;
    EXPECT_TRUE(is_clean(device.log)) << s.name;
    // Without room for its maps the CPU answers, with a warning.
    o.device_memory = 200000;
    const EmulatedPicture small = render_emulated(s.scene, o);
    EXPECT_EQ(small.result.image.data, device.result.image.data) << s.name;
    EXPECT_FALSE(small.warnings.empty()) << s.name;
    EXPECT_TRUE(is_clean(small.log)) << s.name;
  }
  EXPECT_TRUE(any);
}

// The layer `ao` asks the cells of a white sky.
TEST(EmulatedPicture, OcclusionIsTheDevices) {
  const Scene scene = knot_over_floor(Mat3(1.0f), 48);
  RenderOptions o = options_for(1, 16);
  o.aovs = {"ao"};
  const RenderResult cpu = render(scene, o);
  WaveSizes sizes;
  const RenderResult device = render_recorded(scene, o, sizes);
  expect_equal(device, cpu, "ao");
  EXPECT_FALSE(sizes[int(Level::sky_cells)].empty());
  o.ao_distance = 1.0f;  // rays, which no field answers
  expect_same_picture(scene, o, "nearby");
}

// --check asks the CPU's kernel about cells that the device has answered.
TEST(EmulatedPicture, SkyCellsAreChecked) {
  const Scene scene = knot_under_sky(48);
  RenderOptions o = options_for(1, 16);
  o.check = true;
  WaveSizes sizes;
  const RenderResult device = render_recorded(scene, o, sizes);
  EXPECT_FALSE(sizes[int(Level::sky_cells)].empty());
  EXPECT_GT(device.stats.checked(CheckedEstimate::sky).compared, 0u);
  expect_equal(device, render(scene, o), "checked");
}

// The cells of many batches are one wave.
TEST(EmulatedPicture, WavesOfSkyCellsAreFull) {
  const Scene scene = knot_under_sky(160);
  const RenderOptions o = options_for(1, 16);
  WaveSizes sizes;
  const RenderResult device = render_recorded(scene, o, sizes);
  expect_equal(device, render(scene, o), "sky");
  const std::vector<uint64_t>& waves = sizes[int(Level::sky_cells)];
  ASSERT_FALSE(waves.empty());
  EXPECT_GE(*std::max_element(waves.begin(), waves.end()), k_wave_samples);
  EXPECT_GE(device.stats.device_waves_full, 1u);
}

// A device is opened, but not used, where no field and no map would be asked.
TEST(EmulatedPicture, IsTheCpusWhereNothingIsAsked) {
  const Scene scene = knot_over_floor(Mat3(1.0f), 32);
  RenderOptions o;
  o.spp = o.light_samples = 1;  // too few for fields
  const EmulatedPicture device = render_emulated(scene, o);
  expect_equal(device.result, render(scene, o), "nothing asked");
  EXPECT_EQ(device.result.stats.device, "cpu");
  EXPECT_TRUE(device.warnings.empty());
  EXPECT_TRUE(is_clean(device.log));
}

TEST(EmulatedPicture, IsTheCpusWhereOpeningFails) {
  const Scene scene = knot_over_floor(Mat3(1.0f), 32);
  DeviceKind kind;
  kind.name = "failing";
  kind.open = [](const DeviceOptions&) -> std::unique_ptr<VisibilityDevice> { throw std::bad_alloc(); };
  register_device_kind(kind);
  for (const int light_samples : {1, 16}) {
    RenderOptions o = options_for(1, light_samples);
    const Image cpu = render(scene, o).image;
    o.device = "failing";
    std::vector<std::string> warnings;
    RenderCallbacks callbacks;
    callbacks.warning = [&](const std::string& message) { warnings.push_back(message); };
    const RenderResult r = render(scene, o, callbacks);
    EXPECT_EQ(r.image.data, cpu.data);
    EXPECT_EQ(r.stats.device, "cpu");
    ASSERT_EQ(warnings.size(), 1u);
    EXPECT_EQ(warnings[0].rfind("--device failing: ", 0), 0u) << warnings[0];
  }
}

// What radiance maps tell of samples of lobes is asked of the device, whichever way these come by.
TEST(EmulatedPicture, GlossyRaysAreTheDevices) {
  for (const bool sky : {false, true}) {
    const Scene scene = glossy_floor(128, sky);
    RenderOptions o = glossy_options();
    const RenderResult cpu = render(scene, o);
    for (const uint64_t wave_samples : {uint64_t(1), uint64_t(1) << 40}) {
      o.wave_samples = wave_samples;
      const EmulatedPicture device = render_emulated(scene, o);
      const std::string name = std::string(sky ? "sky" : "lamp") + " " + std::to_string(wave_samples);
      expect_equal(device.result, cpu, name);
      EXPECT_EQ(device.result.stats.rays_glossy_exact, cpu.stats.rays_glossy_exact) << name;
      expect_no_fault(device, name);
      EXPECT_GT(device.log.launches[int(gpu::Kernel::filter_lobes)], 0u) << name;
      EXPECT_GT(device.result.stats.device_blocks, device.result.stats.device_blocks_cpu) << name;
    }
    // Without room for the maps the CPU answers, with a warning.
    o.device_memory = 4000000;
    const EmulatedPicture small = render_emulated(scene, o);
    expect_equal(small.result, cpu, "small");
    EXPECT_FALSE(small.warnings.empty());
    EXPECT_TRUE(is_clean(small.log));
  }
}

// How a picture is cut into waves does not change it.
TEST(EmulatedPicture, IsTheSameForWavesOfAnySize) {
  for (const bool is_crowd : {false, true}) {
    const Scene scene = is_crowd ? crowd(96) : knot_over_floor(Mat3(1.0f), 96);
    for (const RenderOptions& split : {options_for(1, 16), options_for(4, 1)}) {
      const RenderResult cpu = render(scene, split);
      uint64_t waves = ~uint64_t(0);
      for (const uint64_t wave_samples : {uint64_t(1), uint64_t(20000), uint64_t(1) << 40}) {
        RenderOptions o = split;
        o.wave_samples = wave_samples;
        const EmulatedPicture device = render_emulated(scene, o);
        expect_equal(device.result, cpu, std::to_string(wave_samples));
        expect_no_fault(device, std::to_string(wave_samples));
        EXPECT_LT(device.result.stats.device_waves, waves);
        waves = device.result.stats.device_waves;
      }
    }
  }
}

// A ball between a floor that fills the picture and a light: the light of nearly all points is asked about.
TEST(EmulatedPicture, WavesAreFull) {
  SceneMaker s;
  s.film(320, 320);
  s.scene.camera.to_world = look_at({0, 0, 0.5f}, {0, 0, 0}, {0, 1, 0});
  s.scene.camera.fov_x_degrees = 40.0f;
  const uint32_t grey = s.bsdf(BsdfKind::diffuse, Rgb(0.5f));
  s.instance(s.shape(ShapeKind::rectangle), grey, scaling(Vec3(6.0f)));
  s.instance(s.mesh(make_knot({.along = 256, .around = 24})), grey, translation({0, 0, 3}));
  Affine light = scaling(Vec3(1.5f));
  light[3] = {0, 0, 8};
  s.area_light(s.instance(s.shape(ShapeKind::sphere), grey, light), Rgb(60.0f));
  RenderOptions o = options_for(1, 64);
  WaveSizes sizes;
  const RenderResult device = render_recorded(s.scene, o, sizes);
  EXPECT_EQ(device.image.data, render(s.scene, o).image.data);
  std::vector<uint64_t>& whole = sizes[int(Level::whole_lights)];
  ASSERT_GE(whole.size(), 2u);
  std::sort(whole.begin(), whole.end());
  // All but that of the last tiles.
  for (size_t i = 1; i < whole.size(); ++i) EXPECT_GE(whole[i], k_wave_samples) << i;
  EXPECT_GE(device.stats.device_waves_full, whole.size() - 1);
  EXPECT_GT(device.stats.device_samples, std::accumulate(whole.begin(), whole.end(), uint64_t(0)) - 1);
}

// The device copies what its questions need and no more.
TEST(EmulatedPicture, OnlyWhatIsAskedForIsResident) {
  const Scene scene = knot_over_floor(Mat3(1.0f), 48);
  RenderOptions o = options_for(1, 16);
  o.threads = 1;                     // the sizes of waves are the same each time then
  o.directions = 64, o.plane = 128;  // fields beside which questions and answers are small
  const test::EmulatedPicture device = test::render_emulated(scene, o);
  EXPECT_GT(device.log.launches[int(gpu::Kernel::scatter)], 0u);
  EXPECT_LT(device.log.launches[int(gpu::Kernel::scatter)], device.result.stats.device_waves);
  EXPECT_LT(20 * device.log.peak_bytes, Field::most_bytes({64, 128}));
}

}  // namespace
}  // namespace fieldtrace
