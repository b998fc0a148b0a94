// What the GPU back end asks of a CUDA driver: fifteen functions, behind a table, so that everything above them runs
// without a GPU (gpu/emulated.h) and every failure can be tried.
//
// Each of them returns a status that the caller must look at (gpu/device_memory.h throws). Copies, fills and launches
// are asynchronous: they happen in the order of their stream, by the end of its synchronise() at the latest, and host
// memory that they read or write must stay as it is until then. Streams have no order among each other but by follow().
// Thread-safety: any number of threads, which call enter() first; opening and closing by one alone. Memory layout:
// addresses are the device's, 64 bits.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace fieldtrace::gpu {

// 0: success. Other codes are the driver's; describe() tells what they mean.
using Status = int;
inline constexpr Status k_success = 0;

using DeviceAddress = uint64_t;

struct DeviceProperties {
  std::string name;
  int compute_major = 0, compute_minor = 0;
  uint64_t memory = 0;  // bytes
};

// The functions of gpu/kernels.cu, by the structures of gpu/device_arguments.h.
enum class Kernel { light_cones, filter_strata, query, scatter, light_rays, sky_cells, filter_lobes };
inline constexpr int k_kernels = 7;
inline constexpr const char* k_kernel_names[k_kernels] = {"light_cones", "filter_strata", "query",       "scatter",
                                                          "light_rays",  "sky_cells",     "filter_lobes"};

// A number below k_streams.
using Stream = int;
inline constexpr int k_streams = 2;

class Runtime {
 public:
  virtual ~Runtime() = default;

  // Starts the driver. The devices that it knows, which may be none.
  virtual Status list(std::vector<DeviceProperties>& devices) = 0;
  // Opens a device of the list, the kernels of the image and the streams. After a failure, as after success, close()
  // releases what was opened. Streams must be idle then.
  virtual Status open(int device, std::span<const std::byte> image) = 0;
  virtual Status close() = 0;
  // Makes the device that of the calling thread; open() does so, too.
  virtual Status enter() = 0;

  virtual Status allocate(size_t bytes, DeviceAddress& address) = 0;
  virtual Status free(DeviceAddress address) = 0;
  // Host memory that copies can read and write without another copy.
  virtual Status allocate_host(size_t bytes, void*& memory) = 0;
  virtual Status free_host(void* memory) = 0;

  virtual Status copy_to_device(Stream stream, DeviceAddress to, const void* from, size_t bytes) = 0;
  virtual Status copy_to_host(Stream stream, void* to, DeviceAddress from, size_t bytes) = 0;
  virtual Status copy_on_device(Stream stream, DeviceAddress to, DeviceAddress from, size_t bytes) = 0;
  virtual Status fill_zero(Stream stream, DeviceAddress address, size_t bytes) = 0;
  // `blocks` thread blocks of a warp each. The kernel takes the structure of `bytes` bytes, which is copied at once.
  virtual Status launch(Stream stream, Kernel kernel, uint32_t blocks, const void* arguments, size_t bytes) = 0;
  // What `stream` is given from now on waits for all that `other` has been given so far.
  virtual Status follow(Stream stream, Stream other) = 0;
  virtual Status synchronise(Stream stream) = 0;

  // What a status means.
  virtual bool out_of_memory(Status status) const = 0;
  virtual std::string describe(Status status) const = 0;
};

}  // namespace fieldtrace::gpu
