// A device that notes how many samples each wave holds, and has another one answer. Thread-safety: as the other's.
#pragma once

#include <mutex>

#include "tests/gpu/emulated_device.h"

namespace fieldtrace::test {

enum class Level { whole_lights, strata, rays, lobes, sky_cells };
inline constexpr int k_levels = 5;

// By level, the samples of each wave that was asked.
using WaveSizes = std::vector<uint64_t>[k_levels];

class RecordingDevice final : public VisibilityDevice {
 public:
  RecordingDevice(std::unique_ptr<VisibilityDevice> device, WaveSizes& sizes)
      : device_(std::move(device)), sizes_(sizes) {}

  void answer(const DeviceWave& wave) override {
    note(Level::whole_lights, wave.cones);
    note(Level::strata, wave.strata);
    note(Level::rays, wave.rays);
    note(Level::lobes, wave.lobes);
    uint64_t cells = 0;
    for (const SkyQuestion* q : wave.skies) cells += uint64_t(q->points.size) * q->tasks->tasks().size();
    note(Level::sky_cells, cells);
    device_->answer(wave);
  }
  void forget_fields() override { device_->forget_fields(); }
  DeviceCounts counts() const override { return device_->counts(); }

 private:
  template <class Question>
  void note(Level level, const std::vector<Question*>& questions) {
    uint64_t samples = 0;
    for (const Question* q : questions) samples += q->samples;
    note(level, samples);
  }
  void note(Level level, uint64_t samples) {
    const std::lock_guard lock(mutex_);
    if (samples > 0) sizes_[int(level)].push_back(samples);
  }

  const std::unique_ptr<VisibilityDevice> device_;
  WaveSizes& sizes_;
  std::mutex mutex_;
};

// Renders with an emulated device, and notes the samples of its waves.
inline RenderResult render_recorded(const Scene& scene, RenderOptions options, WaveSizes& sizes) {
  DeviceKind kind;
  kind.name = "recording";
  kind.open = [&](const DeviceOptions& o) -> std::unique_ptr<VisibilityDevice> {
    auto runtime = std::make_unique<gpu::EmulatedRuntime>(gpu::EmulatedFaults{}, std::make_shared<gpu::EmulatedLog>());
    return std::make_unique<RecordingDevice>(
        std::make_unique<gpu::GpuDevice>(std::move(runtime), std::span<const std::byte>(), o), sizes);
  };
  register_device_kind(kind);
  options.device = "recording";
  return render(scene, options);
}

}  // namespace fieldtrace::test
