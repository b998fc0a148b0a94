// Questions to an emulated GPU one by one: waves, residency, fields that go and come.
#include <gtest/gtest.h>

#include <thread>

#include "core/simd/isa.h"
#include "gpu/device.h"
#include "gpu/emulated.h"
#include "tests/support/random_lines.h"

namespace fieldtrace::gpu {
namespace {

constexpr size_t k_rays = 256;

class GpuDeviceTest : public ::testing::Test {
 protected:
  GpuDeviceTest() {
    rays_.resize(k_rays);
    TestRandom random(1);
    for (size_t i = 0; i < k_rays; ++i) {
      rays_.set(i, {random.uniform(-0.3f, 0.3f), random.uniform(-0.3f, 0.3f), -3.0f}, {0, 0, 1}, 6.0f);
    }
    for (uint32_t b = 0; b < k_rays; b += uint32_t(k_batch_padding)) blocks_.push_back(b);
  }

  void open(const EmulatedFaults& faults = {}) {
    device_ = std::make_unique<GpuDevice>(std::make_unique<EmulatedRuntime>(faults, log_), std::span<const std::byte>(),
                                          DeviceOptions{segment_kernels(Isa::scalar), 0, {}});
  }

  RayStates ask(VisibilityDevice& device, const Field& field) {
    SegmentTask task;
    task.field = field.view();
    task.policy.visibility_max_class = 63;
    std::fill_n(task.to_unit, 12, 0.0f);
    task.to_unit[0] = task.to_unit[4] = task.to_unit[8] = 1.0f;
    task.instance = 7;
    const std::vector<uint32_t> instances(k_rays, 3);
    RayStates states;
    states.keep_verdicts = true;
    states.reset(k_rays);
    device.query(field, task, rays_, instances.data(), blocks_, 0, states);
    return states;
  }

  // Bakes all visibility cells that the rays meet, as if every line were blocked, or clear.
  void bake(Field& field, bool blocked) {
    CpuDevice cpu(segment_kernels(Isa::scalar));
    for (const uint32_t slice : ask(cpu, field).unknown_visibility) {
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

TEST_F(GpuDeviceTest, AnswersItselfFromTheSecondTimeOn) {
  open();
  Field field(ball_, {32, 64});
  EXPECT_EQ(ask(*device_, field).unknown_blocks, blocks_);  // the CPU says what to bake
  bake(field, true);
  EXPECT_EQ(device_->counts().blocks, 0u);
  EXPECT_TRUE(all_have(ask(*device_, field), k_hidden));
  EXPECT_EQ(device_->counts().blocks, blocks_.size());
}

// A field that was complete before is copied as it is asked for.
TEST_F(GpuDeviceTest, CopiesWhatTheFieldHadBefore) {
  open();
  Field field(ball_, {32, 64});
  bake(field, true);
  EXPECT_TRUE(all_have(ask(*device_, field), k_hidden));
  EXPECT_EQ(device_->counts().blocks, 0u);
  EXPECT_TRUE(all_have(ask(*device_, field), k_hidden));
  EXPECT_EQ(device_->counts().blocks, blocks_.size());
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
    EXPECT_EQ(device_->counts().blocks - before, blocks_.size());
    EXPECT_GT(device_->counts().bytes_resident, 0u);
    device_->forget_fields();
  }
}

// Three threads that ask while a wave runs share the next one.
TEST_F(GpuDeviceTest, ThreadsShareWaves) {
  std::vector<std::thread> threads;
  Field field(ball_, {32, 64});
  bake(field, true);
  EmulatedFaults faults;
  faults.at_synchronise = [&] {
    if (!threads.empty()) return;
    for (int i = 0; i < 3; ++i) {
      threads.emplace_back([&] { EXPECT_TRUE(all_have(ask(*device_, field), k_hidden)); });
    }
    while (device_->waiting() < 3) std::this_thread::yield();
  };
  open(faults);
  EXPECT_TRUE(all_have(ask(*device_, field), k_hidden));
  for (std::thread& t : threads) t.join();
  EXPECT_EQ(device_->counts().waves, 2u);
  EXPECT_EQ(log_->launches[int(Kernel::query)], 4u);
  EXPECT_EQ(log_->launches[int(Kernel::scatter)], 1u);
  EXPECT_EQ(device_->counts().blocks, 3 * blocks_.size());
  EXPECT_EQ(device_->counts().blocks_cpu, blocks_.size());
  device_.reset();
  EXPECT_EQ(log_->misuse, 0u);
}

}  // namespace
}  // namespace fieldtrace::gpu
