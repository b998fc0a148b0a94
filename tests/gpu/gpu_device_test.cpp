// Questions to an emulated GPU one by one: waves, residency, fields that go and come.
#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <bit>
#include <thread>

#include "core/simd/isa.h"
#include "gpu/device.h"
#include "gpu/emulated.h"
#include "tests/gpu/ask_device.h"

namespace fieldtrace::gpu {
namespace {

constexpr size_t k_rays = 256;

class GpuDeviceTest : public ::testing::Test {
 protected:
  GpuDeviceTest() {
    rays_ = beam(0.3f, 0.0f);
    for (uint32_t b = 0; b < k_rays; b += uint32_t(k_batch_padding)) blocks_.push_back(b);
  }

  void open(const EmulatedFaults& faults = {}) {
    device_ = std::make_unique<GpuDevice>(std::make_unique<EmulatedRuntime>(faults, log_), std::span<const std::byte>(),
                                          DeviceOptions{0, {}});
  }

  // Rays through a square of half a side `width`, tilted.
  static RayBatch beam(float width, float tilt) {
    RayBatch rays;
    rays.resize(k_rays);
    TestRandom random(1);
    for (size_t i = 0; i < k_rays; ++i) {
      const float x = random.uniform(-width, width), y = random.uniform(-width, width);
      rays.set(i, {x - 3.0f * tilt, y, -3.0f}, {tilt, 0, 1}, 6.0f);
    }
    return rays;
  }

  RayStates ask(VisibilityDevice& device, const Field& field) { return ask(&device, field, rays_); }
  RayStates ask(VisibilityDevice& device, const Field& field, const RayBatch& rays) {
    return ask(&device, field, rays);
  }
  // null: the CPU's answers.
  RayStates ask(VisibilityDevice* device, const Field& field, const RayBatch& rays) {
    SegmentTask task;
    task.field = field.view();
    task.policy.visibility_max_class = 63;
    std::fill_n(task.to_unit, 12, 0.0f);
    task.to_unit[0] = task.to_unit[4] = task.to_unit[8] = 1.0f;
    task.instance = 7;
    const ShadowBatch batch = batch_of(rays, AlignedVector<uint32_t>(k_rays, 3u));
    RayStates states;
    states.keep_verdicts = true;
    states.reset(k_rays);
    ask_rays({segment_kernels(Isa::scalar), device}, field, task, batch, states);
    return states;
  }

  // Bakes all visibility cells that the rays meet, as if every line were blocked, or clear.
  void bake(Field& field, bool blocked) { bake(field, blocked, rays_); }
  void bake(Field& field, bool blocked, const RayBatch& rays) {
    for (const uint32_t slice : ask(nullptr, field, rays).unknown_visibility) {
      const std::optional<uint32_t> cell = field.claim(FieldLayer::visibility, slice);
      if (!cell) continue;
      for (uint32_t c = *cell; c < *cell + uint32_t(scalar::k_slice_cells); ++c) {
        field.store_visibility(c, blocked ? 2 : 1);
      }
      field.finish(FieldLayer::visibility, slice);
    }
  }

  static bool all_have(const RayStates& states, int32_t state) {
    return states.unknown_blocks.empty() &&
           std::all_of(states.state.begin(), states.state.end(), [&](int32_t s) { return s == state; });
  }

  static constexpr int32_t k_hidden = RayStates::k_crosses | RayStates::k_blocked;
  RayBatch rays_;
  std::vector<uint32_t> blocks_;
  const std::shared_ptr<EmulatedLog> log_ = std::make_shared<EmulatedLog>();
  std::unique_ptr<GpuDevice> device_;
  const Sphere ball_{Vec3(0.0f), 1.0f};
};

TEST_F(GpuDeviceTest, AnswersItselfOnceItIsBaked) {
  open();
  Field field(ball_, {32, 64});
  EXPECT_EQ(ask(*device_, field).unknown_blocks, blocks_);  // the CPU says what to bake
  bake(field, true);
  EXPECT_EQ(device_->counts().blocks, 0u);
  EXPECT_TRUE(all_have(ask(*device_, field), k_hidden));
  EXPECT_EQ(device_->counts().blocks, blocks_.size());
}

// A field that was complete before is copied as it is asked for: the question is asked again at once.
TEST_F(GpuDeviceTest, CopiesWhatTheFieldHadBefore) {
  open();
  Field field(ball_, {32, 64});
  bake(field, true);
  EXPECT_TRUE(all_have(ask(*device_, field), k_hidden));
  EXPECT_EQ(device_->counts().blocks, blocks_.size());
  EXPECT_EQ(device_->counts().waves, 2u);
  EXPECT_TRUE(all_have(ask(*device_, field), k_hidden));
  EXPECT_EQ(device_->counts().blocks, 2 * blocks_.size());
  EXPECT_EQ(device_->counts().waves, 3u);
  EXPECT_EQ(device_->counts().blocks_cpu, 0u);
  EXPECT_EQ(device_->counts().samples, 2 * k_rays);  // what is asked again stands for nothing new
}

TEST_F(GpuDeviceTest, ForgetsFieldsThatGo) {
  open();
  std::optional<Field> field;
  for (const bool blocked : {true, false, true}) {
    field.emplace(ball_, FieldParameters{32, 64});  // at the same address
    bake(*field, blocked);
    const uint64_t before = device_->counts().blocks;
    for (int i = 0; i < 2; ++i) {
      EXPECT_TRUE(all_have(ask(*device_, *field), blocked ? k_hidden : RayStates::k_crosses));
    }
    EXPECT_EQ(device_->counts().blocks - before, 2 * blocks_.size());
    EXPECT_GT(device_->counts().bytes_resident, 0u);
    device_->forget_fields();
  }
}

// A wave runs in each stream; threads that ask meanwhile share the next one.
TEST_F(GpuDeviceTest, ThreadsShareWaves) {
  std::array<std::thread, 3> threads;  // the second and third are made while the first may still be being stored
  std::atomic<int> synchronisations = 0;
  std::atomic<bool> two_wait = false;
  Field field(ball_, {32, 64});
  bake(field, true);
  const auto ask_beside = [&] { EXPECT_TRUE(all_have(ask(*device_, field), k_hidden)); };
  EmulatedFaults faults;
  bool is_copied = false;
  faults.at_synchronise = [&] {
    if (!is_copied) return;
    const int n = ++synchronisations;
    if (n == 1) threads[0] = std::thread(ask_beside);
    if (n == 2) {
      for (int i = 1; i < 3; ++i) threads[i] = std::thread(ask_beside);
    }
    while (n == 2 && device_->waiting() < 2) std::this_thread::yield();
    if (n == 2) two_wait = true;
    while (n == 1 && !two_wait) std::this_thread::yield();
  };
  open(faults);
  ask_beside();
  is_copied = true;
  ask_beside();
  for (std::thread& t : threads) t.join();
  EXPECT_EQ(device_->counts().waves, 5u);
  EXPECT_EQ(log_->launches[int(Kernel::query)], 6u);  // the rays of each have arrays of their own
  EXPECT_EQ(log_->launches[int(Kernel::scatter)], 1u);
  EXPECT_EQ(device_->counts().blocks, 5 * blocks_.size());
  EXPECT_EQ(device_->counts().blocks_cpu, 0u);
  device_.reset();
  EXPECT_EQ(log_->misuse, 0u);
}

// Waves that begin and end while another is under way see what that one copies, and what they outgrow stays until it is
// done.
TEST_F(GpuDeviceTest, WavesFollowEachOther) {
  for (const bool eager : {false, true}) {
    Field field(ball_, {32, 64});
    const RayBatch wide[] = {beam(0.6f, 0.0f), beam(0.6f, 0.2f), beam(0.6f, 0.4f), beam(0.6f, 0.8f)};
    bake(field, true);
    for (const RayBatch& rays : wide) bake(field, true, rays);
    std::function<void()> beside;
    EmulatedFaults faults;
    faults.eager = eager;
    faults.at_synchronise = [&] {
      const std::function<void()> once = std::exchange(beside, nullptr);
      if (once) std::thread(once).join();
    };
    open(faults);
    ask(*device_, field);
    beside = [&] { EXPECT_TRUE(all_have(ask(*device_, field), k_hidden)); };
    EXPECT_TRUE(all_have(ask(*device_, field), k_hidden));
    EXPECT_EQ(device_->counts().blocks, 3 * blocks_.size());
    const uint64_t resident = device_->counts().bytes_resident;
    for (const RayBatch& rays : wide) {
      beside = [&] {
        for (int i = 0; i < 2; ++i) EXPECT_TRUE(all_have(ask(*device_, field, rays), k_hidden));
      };
      EXPECT_TRUE(all_have(ask(*device_, field), k_hidden));
    }
    EXPECT_GT(device_->counts().bytes_resident, resident);
    EXPECT_EQ(device_->counts().blocks, 15 * blocks_.size());
    EXPECT_EQ(device_->counts().blocks_cpu, 0u);
    EXPECT_EQ(log_->launches[int(Kernel::scatter)], 5u * (eager + 1));
    device_.reset();
    EXPECT_EQ(log_->misuse, 0u);
  }
}

// The emulated device itself: streams have no order but by follow().
TEST(EmulatedStreams, HaveNoOrderButByFollow) {
  for (const bool eager : {false, true}) {
    for (const bool follows : {false, true}) {
      const auto log = std::make_shared<EmulatedLog>();
      EmulatedFaults faults;
      faults.eager = eager;
      EmulatedRuntime r(faults, log);
      void* host = nullptr;
      DeviceAddress first = 0, second = 0;
      ASSERT_EQ(r.open(0, {}) | r.allocate_host(8, host), k_success);
      ASSERT_EQ(r.allocate(4, first) | r.allocate(4, second), k_success);
      uint32_t* const words = static_cast<uint32_t*>(host);
      words[0] = 5;
      // Stream 1 reads what stream 0 has written so far, not what it writes then.
      ASSERT_EQ(r.copy_to_device(0, first, words, 4), k_success);
      if (follows) {
        ASSERT_EQ(r.follow(1, 0), k_success);
      }
      ASSERT_EQ(r.fill_zero(0, first, 4), k_success);
      ASSERT_EQ(r.copy_on_device(1, second, first, 4) | r.copy_to_host(1, words + 1, second, 4), k_success);
      EXPECT_EQ(words[1], 0xcdcdcdcdu);
      ASSERT_EQ(r.synchronise(1), k_success);
      EXPECT_EQ(words[1], eager ? 0u : follows ? 5u : 0xcdcdcdcdu);
      ASSERT_EQ(r.synchronise(0) | r.free(first) | r.free(second) | r.free_host(host), k_success);
      ASSERT_EQ(r.close(), k_success);
      EXPECT_EQ(log->misuse, 0u);
    }
  }
}

// What a stream is given after the failure may need what was lost: it is lost too.
TEST(EmulatedStreams, AFailureIsToldByEveryStream) {
  for (const bool is_late : {false, true}) {
    const auto log = std::make_shared<EmulatedLog>();
    EmulatedFaults faults;
    faults.failing_call = is_late ? 5 : 7;
    EmulatedRuntime r(faults, log);
    DeviceAddress place = 0;
    ASSERT_EQ(r.open(0, {}) | r.allocate(4, place), k_success);
    ASSERT_EQ(r.fill_zero(0, place, 4), k_success);
    const auto fail = [&] { EXPECT_EQ(r.synchronise(0), EmulatedFaults::k_launch_failed); };
    if (is_late) fail();
    ASSERT_EQ(r.fill_zero(1, place, 4) | r.follow(1, 0), k_success);
    if (!is_late) fail();
    EXPECT_EQ(r.synchronise(1), EmulatedFaults::k_launch_failed);
    EXPECT_EQ(r.synchronise(1), k_success);
    EXPECT_EQ(*std::bit_cast<const uint32_t*>(place), 0xcdcdcdcdu);
    ASSERT_EQ(r.free(place) | r.close(), k_success);
    EXPECT_EQ(log->misuse, 0u);
  }
}

}  // namespace
}  // namespace fieldtrace::gpu
