// A GPU as a VisibilityDevice: questions of all threads in waves, answers merged by those who asked.
//
// A thread hands in the blocks of one occluder and waits. Whoever comes first while a wave is free submits all that
// wait: the questions' arrays in one transfer, copies of what the fields' mirrors lack, a launch for each question, the
// answers in one transfer; then it waits for them, while the next wave is submitted. There is a wave for each stream,
// with staging buffers of its own, taken in turn. A wave's arrays go up while the one before runs; its changes of
// mirrors and its kernels follow that one's. Threads that do not wait trace exact rays meanwhile.
//
// Blocks that met what is not resident go to the CPU's kernels, which report what must be baked, as ever. After a
// failure of any call a warning says so, and the CPU answers everything. An object that does not fit into the device's
// memory is left to the CPU, with a warning. Thread-safety: as VisibilityDevice.
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
  uint64_t filter_strata(const Field& field, const StratumTask& task, const RayBatch& rays,
                         const LightRaySource& source, const float* pdf, const float* radius, const int32_t* wanted,
                         std::span<const uint32_t> blocks, float* clear, int32_t* refused,
                         ConeUnknowns& unknowns) override;
  SegmentCounts query(const Field& field, const SegmentTask& task, const RayBatch& rays, const LightRaySource& source,
                      const uint32_t* shading_point_instance, std::span<const uint32_t> blocks, int32_t candidate_slot,
                      RayStates& states) override;
  bool see_cells(std::span<const CellTask> tasks, const CellPoints& points, const CellSums& sums,
                 std::span<uint32_t> undecided) override;
  void forget_fields() override;
  DeviceCounts counts() const override;
  size_t waiting() const;  // questions that no wave has taken yet

  struct Question;  // gpu/device_questions.h
  // Tables in device memory by their addresses on the host; without memory: those that there was no room for.
  struct Tables {
    std::map<const void*, DeviceBuffer> buffers;
    template <class T>
    T* at(const void* host) const {
      return buffers.at(host).as<T>();
    }
  };

  // What one wave sends and receives.
  struct Wave {
    Wave(DeviceMemory& memory, Stream s, const Tables& all_tables)
        : stream(s),
          tables(all_tables),
          in(memory),
          fields(memory),
          made(memory, StagingBuffer::Side::device),
          out(memory),
          missing(memory) {}
    const Stream stream;
    const Tables& tables;
    StagingBuffer in, fields, made, out, missing;  // questions, packet, rays that are made on the device, answers
    struct NewTable {
      size_t at;  // in `in`
      DeviceAddress to;
      size_t bytes;
    };
    std::vector<NewTable> new_tables;
    Packet packet;
    std::vector<std::unique_ptr<FieldMirror>> left_out;  // which streams may still use
    bool is_busy = false;                                // from being taken until its questions are answered
  };

 private:
  using Lock = std::unique_lock<std::mutex>;
  using Questions = std::span<Question* const>;

  // Returns when the question is answered, or left to the CPU.
  void ask(Question& question);
  Wave* free_wave();
  // Answers all that wait. Called and left with the lock; never throws.
  void run(Lock& lock, Wave& wave);
  void submit(Wave& wave, Questions questions);
  bool has_tables(Wave& wave, const Question& question);
  void update_mirrors(Wave& wave, Questions questions);
  void collect(Wave& wave, Questions questions);
  void tidy(Wave& wave, Questions questions);
  void stage_mirror(Wave& wave, const Field& field);
  void leave_out(Wave& wave, const Field& field, const std::string& why);
  // Whether `work` did not throw; else the device is lost.
  template <class Work>
  bool attempt(const Work& work);
  void lose(const std::string& why);
  void say_warnings();
  void release();

  std::unique_ptr<Runtime> runtime_;
  CpuDevice cpu_;
  WarningSink warning_;
  std::vector<std::string> warnings_;  // not said yet, since threads report progress meanwhile
  mutable std::mutex mutex_;           // guards what comes before `memory_`, and the counts
  std::condition_variable changed_;
  std::vector<Question*> waiting_;
  int last_wave_ = 0;
  bool is_used_ = false;  // by a thread, which alone uses the memory and mirrors
  bool is_open_ = false, is_lost_ = false;
  DeviceCounts counts_;
  std::optional<DeviceMemory> memory_;
  std::vector<std::unique_ptr<Wave>> waves_;  // k_streams
  Tables tables_;
  std::map<const Field*, std::unique_ptr<FieldMirror>> mirrors_;  // null: left out
};

// The devices of a runtime, a line each, or why there are none.
std::vector<std::string> list_devices(Runtime& runtime);

}  // namespace fieldtrace::gpu
