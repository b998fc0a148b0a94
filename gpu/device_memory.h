// Memory of a device and of the host beside it, and the check of every call of the run-time layer.
//
// Thread-safety: one thread at a time, as gpu/runtime.h.
#pragma once

#include <bit>
#include <cstring>
#include <utility>

#include "core/platform/error.h"
#include "gpu/runtime.h"

namespace fieldtrace::gpu {

// A call failed: the device cannot be relied on any more.
class DeviceError : public Error {
 public:
  using Error::Error;
};

// Device memory ran out, or --device-memory is used up. Nothing else is wrong.
class OutOfDeviceMemory : public DeviceError {
 public:
  using DeviceError::DeviceError;
};

// Throws DeviceError, or OutOfDeviceMemory, naming `what` unless `status` is success.
void check(const Runtime& runtime, Status status, const char* what);

// The memory of one device, counted and limited.
class DeviceMemory {
 public:
  DeviceMemory(Runtime& runtime, uint64_t limit) : runtime_(runtime), limit_(limit) {}

  Runtime& runtime() { return runtime_; }
  uint64_t used() const { return used_; }
  uint64_t peak() const { return peak_; }
  uint64_t limit() const { return limit_; }

 private:
  friend class DeviceBuffer;
  Runtime& runtime_;
  const uint64_t limit_;
  uint64_t used_ = 0, peak_ = 0;
};

// Owns device memory. No stream may still use it when it is destroyed.
class DeviceBuffer {
 public:
  DeviceBuffer() = default;
  // Throws OutOfDeviceMemory, or DeviceError.
  DeviceBuffer(DeviceMemory& memory, size_t bytes);
  ~DeviceBuffer();
  DeviceBuffer(DeviceBuffer&& other) noexcept { *this = std::move(other); }
  DeviceBuffer& operator=(DeviceBuffer&& other) noexcept {
    std::swap(memory_, other.memory_);
    std::swap(address_, other.address_);
    std::swap(bytes_, other.bytes_);
    return *this;
  }

  DeviceAddress address() const { return address_; }
  size_t bytes() const { return bytes_; }
  template <class T>
  T* as() const {
    return std::bit_cast<T*>(address_);
  }

 private:
  DeviceMemory* memory_ = nullptr;
  DeviceAddress address_ = 0;
  size_t bytes_ = 0;
};

// Host memory that grows as it is filled, and as much device memory, for what goes over the bus together; or, for what
// never does, device memory alone. Places in it are offsets, aligned to k_alignment bytes.
class StagingBuffer {
 public:
  static constexpr size_t k_alignment = 256;

  enum class Side { both, device };
  explicit StagingBuffer(DeviceMemory& memory, Side side = Side::both) : memory_(memory), side_(side) {}
  ~StagingBuffer();
  StagingBuffer(const StagingBuffer&) = delete;
  StagingBuffer& operator=(const StagingBuffer&) = delete;

  void clear() { size_ = 0; }
  size_t size() const { return size_; }
  // Room for `bytes` bytes; the contents are unspecified.
  size_t reserve(size_t bytes);
  size_t append(const void* from, size_t bytes) {
    const size_t at = reserve(bytes);
    if (bytes > 0) std::memcpy(host<std::byte>(at), from, bytes);
    return at;
  }
  template <class T>
  T* host(size_t at) const {
    return reinterpret_cast<T*>(static_cast<std::byte*>(host_) + at);
  }
  // After ensure_device(), until the next reserve().
  template <class T>
  T* device(size_t at) const {
    return std::bit_cast<T*>(device_.address() + at);
  }
  // Makes the device memory as large as the host's. No stream may use it.
  void ensure_device();
  // Copies all that is filled.
  void copy_to_device(Stream stream);
  void copy_to_host(Stream stream);

 private:
  DeviceMemory& memory_;
  const Side side_;
  void* host_ = nullptr;
  size_t size_ = 0, capacity_ = 0;
  DeviceBuffer device_;
};

}  // namespace fieldtrace::gpu
