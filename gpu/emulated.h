// A GPU that is not there, for tests: host memory, and kernels that are loops over the scalar look-ups.
//
// A stream's work happens when it, or one that follows it, is synchronised, and not before, so that a missing wait
// shows as wrong answers; or, if the faults say so, as early as can be. Memory is filled with garbage when it is
// allocated and before it is released. Any call may be made to fail, once or from then on; memory may be small. Misuse
// (copies beyond an allocation, memory released while work that uses it waits) is counted. Thread-safety: as
// gpu/runtime.h; the log may be read by one thread at any time when nobody calls.
#pragma once

#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <vector>

#include "gpu/runtime.h"

namespace fieldtrace::gpu {

// One kernel for all blocks.
void run_emulated_kernel(Kernel kernel, uint32_t blocks, const void* arguments);

struct EmulatedFaults {
  static constexpr uint64_t k_never = ~uint64_t(0);
  static constexpr Status k_out_of_memory = 2, k_no_image = 209, k_launch_failed = 719, k_no_driver = 100;

  uint64_t failing_call = k_never;   // counted from 0 over all functions with a status; open() is three
  Status failure = k_launch_failed;  // what it returns
  bool lost = false;                 // so do all later calls
  bool has_driver = true, has_kernels = true;
  int devices = 1;
  uint64_t memory = uint64_t(1) << 32;
  bool eager = false;                    // at synchronise() other streams come first
  std::function<void()> at_synchronise;  // called first, if set
  // What runs a launch.
  void (*run_kernel)(Kernel kernel, uint32_t blocks, const void* arguments) = &run_emulated_kernel;
};

// What outlives the runtime.
struct EmulatedLog {
  uint64_t calls = 0, releases = 0, launches[k_kernels] = {}, synchronisations = 0;
  uint64_t allocated = 0, host_allocated = 0;  // not released yet
  uint64_t bytes = 0, peak_bytes = 0;          // of device memory
  // Copied to the device before a question's kernel, and back after it, fields' copies included. A wave of several
  // questions counts as one of its first and last.
  uint64_t bytes_up[k_kernels] = {}, bytes_down[k_kernels] = {};
  uint64_t open_devices = 0, streams = 0;
  uint64_t misuse = 0;
};

class EmulatedRuntime final : public Runtime {
 public:
  EmulatedRuntime(const EmulatedFaults& faults, std::shared_ptr<EmulatedLog> log)
      : faults_(faults), log_(std::move(log)) {}
  ~EmulatedRuntime() override;

  Status list(std::vector<DeviceProperties>& devices) override;
  Status open(int device, std::span<const std::byte> image) override;
  Status close() override;
  Status enter() override;
  Status allocate(size_t bytes, DeviceAddress& address) override;
  Status free(DeviceAddress address) override;
  Status allocate_host(size_t bytes, void*& memory) override;
  Status free_host(void* memory) override;
  Status copy_to_device(Stream stream, DeviceAddress to, const void* from, size_t bytes) override;
  Status copy_to_host(Stream stream, void* to, DeviceAddress from, size_t bytes) override;
  Status copy_on_device(Stream stream, DeviceAddress to, DeviceAddress from, size_t bytes) override;
  Status fill_zero(Stream stream, DeviceAddress address, size_t bytes) override;
  Status launch(Stream stream, Kernel kernel, uint32_t blocks, const void* arguments, size_t bytes) override;
  Status follow(Stream stream, Stream other) override;
  Status synchronise(Stream stream) override;
  bool out_of_memory(Status status) const override { return status == EmulatedFaults::k_out_of_memory; }
  std::string describe(Status status) const override;

 private:
  struct Work {
    std::function<void()> run;
    std::vector<const void*> uses;  // first bytes of its memory
  };
  struct Queue {
    std::deque<Work> work;
    uint64_t begun = 0;          // pieces of work taken from it
    Status failure = k_success;  // what its next synchronise() returns
    uint64_t bytes_waiting = 0;  // for a kernel that they are counted for
    Kernel last_kernel = Kernel::query;
  };

  Status count();  // the status that this call has by the faults
  Status count_release();
  bool lies_inside(const std::map<std::byte*, size_t>& memory, const void* from, size_t bytes) const;
  void require(bool right);
  void queue(Stream stream, std::vector<const void*> uses, std::function<void()> run);
  void run_until(Stream stream, uint64_t end);  // all work before the end-th
  void run_kernel(Kernel kernel, uint32_t blocks, const void* arguments);
  void release(std::map<std::byte*, size_t>& memory, void* address);
  void drop(std::map<std::byte*, size_t>& memory, uint64_t& live);

  const EmulatedFaults faults_;
  const std::shared_ptr<EmulatedLog> log_;
  std::mutex mutex_;
  std::map<std::byte*, size_t> memory_, host_memory_;
  Queue queues_[k_streams];
};

}  // namespace fieldtrace::gpu
