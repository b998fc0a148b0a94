// An emulated GPU fails anywhere: the picture is the CPU's, a warning says why, and nothing leaks.
#include <gtest/gtest.h>

#include "core/mesh/mesh_procedural.h"
#include "tests/gpu/picture_checks.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace {
namespace {

using gpu::EmulatedFaults;

// Two objects over a floor; few pixels, so that every call can be made to fail.
Scene two_objects(int size) {
  test::SceneMaker s;
  s.film(size, size);
  s.scene.camera.to_world = test::look_at({0, -7, 4}, {0, 0, 0.5f}, {0, 0, 1});
  s.scene.camera.fov_x_degrees = 25.0f;
  const uint32_t grey = s.bsdf(BsdfKind::diffuse, Rgb(0.5f));
  s.instance(s.mesh(make_knot({.along = 128, .around = 12})), grey, test::translation({-0.8f, 0, 1}));
  SupershapeParams p;
  p.around = 32;
  p.along = 16;
  s.instance(s.mesh(make_supershape(p)), grey, test::translation({1.2f, 0, 1}));
  s.instance(s.shape(ShapeKind::rectangle), grey, test::scaling(Vec3(6.0f)));
  Affine at = test::scaling(Vec3(0.6f));
  at[3] = {2, -2, 4};
  s.area_light(s.instance(s.shape(ShapeKind::sphere), grey, at), Rgb(60.0f));
  return s.scene;
}

RenderOptions options() {
  RenderOptions o;
  o.spp = 1;
  o.light_samples = 16;
  o.threads = 1;
  o.directions = 32;
  o.plane = 64;
  o.leave_to_rays = false;
  return o;
}

bool any_contains(const std::vector<std::string>& lines, const std::string& text) {
  return std::any_of(lines.begin(), lines.end(),
                     [&](const std::string& line) { return line.find(text) != std::string::npos; });
}

class DeviceFailure : public ::testing::Test {
 protected:
  void expect_cpus_picture(const test::EmulatedPicture& picture, const std::string& name) {
    EXPECT_EQ(picture.result.image.data, cpu_.image.data) << name;
    EXPECT_FALSE(picture.result.interrupted) << name;
    EXPECT_TRUE(test::is_clean(picture.log))
        << name << ": " << picture.log.allocated << " " << picture.log.host_allocated << " " << picture.log.open_devices
        << " " << picture.log.streams << " " << picture.log.misuse;
  }

  const Scene scene_ = two_objects(8);
  const RenderResult cpu_ = render(scene_, options());
};

TEST_F(DeviceFailure, OfTheNthCallForEveryN) {
  const gpu::EmulatedLog log = test::render_emulated(scene_, options()).log;
  const uint64_t calls = log.calls;
  ASSERT_GT(calls, 100u);
  struct Way {
    const char* name;
    gpu::Status failure;
    bool lost;
  };
  const Way ways[] = {{"fails once", EmulatedFaults::k_launch_failed, false},
                      {"is lost", EmulatedFaults::k_launch_failed, true},
                      {"has no memory", EmulatedFaults::k_out_of_memory, false}};
  for (const Way& way : ways) {
    uint64_t told = 0;
    for (uint64_t n = 0; n < calls; ++n) {
      EmulatedFaults faults;
      faults.failing_call = n;
      faults.failure = way.failure;
      faults.lost = way.lost;
      const test::EmulatedPicture picture = test::render_emulated(scene_, options(), faults);
      expect_cpus_picture(picture, std::string(way.name) + " at call " + std::to_string(n));
      told += !picture.warnings.empty();
      if (!picture.warnings.empty()) {
        EXPECT_TRUE(any_contains(picture.warnings, "the CPU answers")) << picture.warnings[0];
      }
    }
    // All but those that release what is not needed any more, and the four that make the device current and wait for
    // its streams before that.
    EXPECT_GE(told, calls - log.releases - 4) << way.name;
    EXPECT_LT(told, calls) << way.name;
  }
}

// What a wave could not have is not taken for there by the next one.
TEST_F(DeviceFailure, OfTheNthAllocationForEveryWave) {
  const Scene scene = two_objects(32);
  RenderOptions o = options();
  o.wave_samples = 2000;
  const RenderResult cpu = render(scene, o);
  constexpr uint64_t k_of_first_waves = 130;
  ASSERT_GT(test::render_emulated(scene, o).log.calls, k_of_first_waves + 50);
  uint64_t used_after = 0;
  for (uint64_t n = 0; n < k_of_first_waves; n += 3) {
    EmulatedFaults faults;
    faults.failing_call = n;
    faults.failure = EmulatedFaults::k_out_of_memory;
    const test::EmulatedPicture picture = test::render_emulated(scene, o, faults);
    EXPECT_EQ(picture.result.image.data, cpu.image.data) << n;
    EXPECT_TRUE(test::is_clean(picture.log)) << n << " " << picture.log.misuse;
    used_after += any_contains(picture.warnings, "does not fit") && picture.result.stats.device_blocks > 0;
  }
  EXPECT_GT(used_after, 10u);
}

// With waves of several threads in both streams: which call is the n-th differs from run to run.
TEST_F(DeviceFailure, OfAnyCallWhileWavesOverlap) {
  const Scene scene = two_objects(64);
  RenderOptions o = options();
  o.wave_samples = 2000;
  const RenderResult cpu = render(scene, o);
  o.threads = 4;
  const uint64_t calls = test::render_emulated(scene, o).log.calls;
  ASSERT_GT(calls, 300u);
  for (uint64_t n = 10; n < calls; n += 1 + calls / 41) {
    EmulatedFaults faults;
    faults.failing_call = n;
    faults.eager = n % 2 == 0;
    faults.lost = n % 3 == 0;
    faults.failure = n % 3 == 1 ? EmulatedFaults::k_out_of_memory : EmulatedFaults::k_launch_failed;
    const test::EmulatedPicture picture = test::render_emulated(scene, o, faults);
    EXPECT_EQ(picture.result.image.data, cpu.image.data) << n;
    EXPECT_TRUE(test::is_clean(picture.log)) << n << " " << picture.log.misuse;
    EXPECT_LE(picture.warnings.size(), 2u) << n;  // an object does not fit, the device is lost
  }
}

TEST_F(DeviceFailure, NothingToUse) {
  EmulatedFaults faults;
  faults.has_driver = false;
  test::EmulatedPicture picture = test::render_emulated(scene_, options(), faults);
  expect_cpus_picture(picture, "no driver");
  EXPECT_TRUE(any_contains(picture.warnings,
                           "--device emulated: looking for CUDA devices: no driver; the CPU answers instead"));
  EXPECT_EQ(picture.result.stats.device, "cpu");
  faults = {};
  faults.devices = 0;
  picture = test::render_emulated(scene_, options(), faults);
  expect_cpus_picture(picture, "no device");
  EXPECT_TRUE(any_contains(picture.warnings, "this machine has no CUDA device"));
  faults = {};
  faults.has_kernels = false;
  picture = test::render_emulated(scene_, options(), faults);
  expect_cpus_picture(picture, "wrong architecture");
  EXPECT_TRUE(any_contains(picture.warnings, "opening Emulated GPU: no kernel image"));
}

TEST_F(DeviceFailure, MemoryEndsAnywhere) {
  const uint64_t most = test::render_emulated(scene_, options()).log.peak_bytes;
  uint64_t full = 0, part = 0, none = 0;
  for (uint64_t step = 0; step <= 24; ++step) {
    const uint64_t bytes = most * step / 24;
    for (const bool by_option : {false, true}) {
      EmulatedFaults faults;
      RenderOptions o = options();
      (by_option ? o.device_memory : faults.memory) = std::max<uint64_t>(bytes, 1);
      const test::EmulatedPicture picture = test::render_emulated(scene_, o, faults);
      expect_cpus_picture(picture, std::to_string(bytes) + (by_option ? " by option" : " of the device"));
      EXPECT_LE(picture.log.peak_bytes, bytes);
      EXPECT_EQ(picture.warnings.empty(), step == 24) << bytes;
      const bool loses = any_contains(picture.warnings, "is not used any more");
      full += picture.warnings.empty();
      part += !picture.warnings.empty() && !loses && picture.result.stats.device_blocks > 0;
      none += picture.result.stats.device_blocks == 0;
    }
  }
  // All three ways of coping were met: everything fits, an object does not, nothing does.
  EXPECT_GT(full, 0u);
  EXPECT_GT(part, 0u);
  EXPECT_GT(none, 0u);
}

TEST_F(DeviceFailure, ThreadsShareALostDevice) {
  const Scene scene = two_objects(96);
  RenderOptions o = options();
  o.wave_samples = 2000;
  const RenderResult cpu = render(scene, o);
  o.threads = 4;
  for (const uint64_t n : {20u, 60u, 150u, 300u}) {
    EmulatedFaults faults;
    faults.failing_call = n;
    faults.lost = true;
    const test::EmulatedPicture picture = test::render_emulated(scene, o, faults);
    EXPECT_EQ(picture.result.image.data, cpu.image.data) << n;
    EXPECT_TRUE(test::is_clean(picture.log)) << n;
    EXPECT_EQ(picture.warnings.size(), 1u) << n;
  }
}

// Skies and glossy rays, too: their maps and waves.
TEST_F(DeviceFailure, OfTheNthCallUnderASkyOverAGlossyFloor) {
  const Scene scene = test::glossy_floor(128, true);
  RenderOptions o = test::glossy_options();
  o.crop = Rect{56, 64, 8, 8};
  o.threads = 1;
  const RenderResult cpu = render(scene, o);
  const test::EmulatedPicture whole = test::render_emulated(scene, o);
  ASSERT_GT(whole.log.launches[int(gpu::Kernel::filter_lobes)], 0u);
  ASSERT_GT(whole.log.launches[int(gpu::Kernel::sky_cells)], 0u);
  const uint64_t calls = whole.log.calls, step = 1 + calls / 7;
  for (const gpu::Status failure : {EmulatedFaults::k_launch_failed, EmulatedFaults::k_out_of_memory}) {
    for (uint64_t n = 10; n < calls; n += step) {
      EmulatedFaults faults;
      faults.failing_call = n;
      faults.failure = failure;
      faults.lost = failure == EmulatedFaults::k_launch_failed;
      const test::EmulatedPicture picture = test::render_emulated(scene, o, faults);
      EXPECT_EQ(picture.result.image.data, cpu.image.data) << failure << " at call " << n;
      EXPECT_TRUE(test::is_clean(picture.log)) << failure << " at call " << n;
    }
  }
}

// Of fields that outgrow their memory the copies go with them.
TEST_F(DeviceFailure, FieldsAreForgottenBetweenAttempts) {
  const Scene scene = two_objects(48);
  RenderOptions o = options();
  o.field_memory = 1500000;
  const RenderResult cpu = render(scene, o);
  ASSERT_GT(cpu.stats.field_restarts, 0u);
  const test::EmulatedPicture picture = test::render_emulated(scene, o);
  EXPECT_EQ(picture.result.image.data, cpu.image.data);
  EXPECT_TRUE(test::is_clean(picture.log));
}

}  // namespace
}  // namespace fieldtrace
