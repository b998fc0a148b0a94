// A GPU as a VisibilityDevice: waves of questions, answered by masks that those who asked merge.
//
// A thread hands in a wave and waits. Whoever comes first while a stream is free submits all that wait: what the
// questions share in one transfer, copies of what the fields' mirrors lack, a launch for each occluder, the answers in
// one transfer; then it waits for them, while the next wave is submitted. Each stream has staging buffers of its own;
// streams are taken in turn. A wave's arrays go up while the one before runs; its changes of mirrors and its kernels
// follow that one's. Threads that do not wait trace exact rays meanwhile.
//
// Blocks that met what is not resident, but finished in the field, are asked about again at once, in a wave of their
// own. Others are left to those who asked, and what they lack is named (DeviceQuestion::unbaked). After a failure of
// any call a warning says so, and the CPU answers everything. An object that does not fit into the device's memory is
// left to the CPU, with a warning. Thread-safety: as VisibilityDevice.
#pragma once

#include <condition_variable>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <vector>

#include "gpu/device_launches.h"

namespace fieldtrace::gpu {

class GpuDevice final : public VisibilityDevice {
 public:
  // Opens device 0 of `runtime`, with `kernels` as its functions. Throws Error saying what is missing.
  GpuDevice(std::unique_ptr<Runtime> runtime, std::span<const std::byte> kernels, const DeviceOptions& options);
  ~GpuDevice() override;

  void answer(const DeviceWave& wave) override;
  void forget_fields() override;
  DeviceCounts counts() const override;
  size_t waiting() const;  // requests that no wave has taken yet

 private:
  using Lock = std::unique_lock<std::mutex>;
  using Items = std::span<Item* const>;

  // What a thread has handed in.
  struct Request {
    std::vector<Item> items;
    bool is_taken = false, is_done = false;  // by a wave
  };
  // What one wave sends and receives, and what it leaves behind.
  struct Wave : WaveBuffers {
    using WaveBuffers::WaveBuffers;
    WaveLaunches launches;
    struct NewTable {
      size_t at;  // in `in`
      DeviceAddress to;
      size_t bytes;
    };
    std::vector<NewTable> new_tables;
    Packet packet;
    std::vector<std::unique_ptr<FieldMirror>> left_out;  // which streams may still use
    bool is_busy = false;                                // from being taken until its requests are answered
  };

  // Returns when the request is answered, or left to the CPU.
  void ask(Request& request);
  Wave* free_wave();
  // Answers all that wait. Called and left with the lock; never throws.
  void run(Lock& lock, Wave& wave);
  void submit(Wave& wave, Items items);
  bool has_tables(Wave& wave, const Item& item);
  void update_mirrors(Wave& wave, Items items);
  void collect(Wave& wave, Items items);
  void tidy(Wave& wave, Items items);
  void stage_mirror(Wave& wave, const MirrorSource& source);
  void leave_out(Wave& wave, const MirrorSource& source, const std::string& why);
  // Whether `work` did not throw; else the device is lost.
  template <class Work>
  bool attempt(const Work& work);
  void lose(const std::string& why);
  void say_warnings();
  void release();

  std::unique_ptr<Runtime> runtime_;
  WarningSink warning_;
  std::vector<std::string> warnings_;  // not said yet, since threads report progress meanwhile
  mutable std::mutex mutex_;           // guards what comes before `memory_`, and the counts
  std::condition_variable changed_;
  std::vector<Request*> waiting_;
  int last_wave_ = 0;
  bool is_used_ = false;  // by a thread, which alone uses the memory and mirrors
  bool is_open_ = false, is_lost_ = false;
  DeviceCounts counts_;
  std::optional<DeviceMemory> memory_;
  std::vector<std::unique_ptr<Wave>> waves_;  // k_streams
  DeviceTables tables_;
  std::map<const CoverageTiles*, std::unique_ptr<FieldMirror>> mirrors_;  // by MirrorSource::tiles; null: left out
};

// The devices of a runtime, a line each, or why there are none.
std::vector<std::string> list_devices(Runtime& runtime);

}  // namespace fieldtrace::gpu
