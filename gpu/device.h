// A GPU as a VisibilityDevice: questions of all threads in waves, answers merged by those who asked.
//
// A thread hands in the blocks of one occluder and waits. Whoever comes first while no wave runs makes one of all that
// wait: copies of what the fields' mirrors lack, the questions' arrays in one transfer, a launch for each question, the
// answers in one transfer, one synchronisation. Blocks that met what is not resident go to the CPU's kernels, which
// report what must be baked, as ever. After a failure of any call a warning says so, and the CPU answers everything.
// An object that does not fit into the device's memory is left to the CPU, with a warning.
// Thread-safety: as VisibilityDevice.
#pragma once

#include <condition_variable>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <vector>

#include "gpu/device_mirror.h"
#include "hybrid/visibility/visibility_device.h"

namespace fieldtrace::gpu {

class GpuDevice final : public VisibilityDevice {
 public:
  // Opens device 0 of `runtime`, with `kernels` as its functions. Throws Error saying what is missing.
  GpuDevice(std::unique_ptr<Runtime> runtime, std::span<const std::byte> kernels, const DeviceOptions& options);
  ~GpuDevice() override;

  ConeCounts light_cones(const Field& field, const ConeTask& task, const ShadingPointBatch& points, const Sphere& light,
                         std::span<const uint32_t> blocks, int32_t* flags, ConeUnknowns& unknowns) override;
  uint64_t filter_strata(const Field& field, const StratumTask& task, const RayBatch& rays, const float* pdf,
                         const float* radius, const int32_t* wanted, std::span<const uint32_t> blocks, float* clear,
                         int32_t* refused, ConeUnknowns& unknowns) override;
  SegmentCounts query(const Field& field, const SegmentTask& task, const RayBatch& rays,
                      const uint32_t* shading_point_instance, std::span<const uint32_t> blocks, int32_t candidate_slot,
                      RayStates& states) override;
  void forget_fields() override;
  DeviceCounts counts() const override;
  size_t waiting() const;  // questions that no wave has taken yet

  struct Question;  // gpu/device_questions.h
  // What one wave sends and receives.
  struct Wave {
    explicit Wave(DeviceMemory& memory) : in(memory), out(memory), missing(memory) {}
    StagingBuffer in, out, missing;
    Packet packet;
  };

 private:
  // Returns when the question is answered, or left to the CPU.
  void ask(Question& question);
  // Never throws: what fails loses the device.
  void run(std::span<Question* const> questions);
  void run_wave(std::span<Question* const> questions);
  void start(std::span<Question* const> questions);
  void collect(std::span<Question* const> questions);
  void stage_mirror(const Field& field);
  void leave_out(const Field& field, const std::string& why);
  void lose(const std::string& why);
  void say_warnings();
  void release();

  std::unique_ptr<Runtime> runtime_;
  CpuDevice cpu_;
  WarningSink warning_;
  std::vector<std::string> warnings_;  // not said yet, since threads report progress meanwhile
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<Question*> waiting_;
  bool runs_ = false;  // a wave; its thread alone uses what follows
  bool is_open_ = false, is_lost_ = false;
  std::optional<DeviceMemory> memory_;
  std::optional<Wave> wave_;
  std::map<const Field*, std::unique_ptr<FieldMirror>> mirrors_;  // null: left out
  std::vector<DeviceBuffer> retired_;                             // until the next synchronisation
  std::vector<std::unique_ptr<FieldMirror>> retired_mirrors_;
  DeviceCounts counts_;  // guarded by the mutex
};

// The devices of a runtime, a line each, or why there are none.
std::vector<std::string> list_devices(Runtime& runtime);

}  // namespace fieldtrace::gpu
