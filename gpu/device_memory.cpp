#include "gpu/device_memory.h"

#include <algorithm>
#include <bit>

namespace fieldtrace::gpu {

void check(const Runtime& runtime, Status status, const char* what) {
  if (status == k_success) return;
  const std::string message = std::string(what) + ": " + runtime.describe(status);
  if (runtime.out_of_memory(status)) throw OutOfDeviceMemory(message);
  throw DeviceError(message);
}

DeviceBuffer::DeviceBuffer(DeviceMemory& memory, size_t bytes) {
  if (bytes > memory.limit_ - memory.used_) {
    throw OutOfDeviceMemory("the " + std::to_string(memory.limit_ / 1000000) + " MB of --device-memory are used up");
  }
  check(memory.runtime_, memory.runtime_.allocate(bytes, address_), "allocating device memory");
  memory_ = &memory;
  bytes_ = bytes;
  memory.used_ += bytes;
  memory.peak_ = std::max(memory.peak_, memory.used_);
}

DeviceBuffer::~DeviceBuffer() {
  if (!memory_) return;
  memory_->used_ -= bytes_;
  // A failure repeats what an earlier call has reported, or the next one will.
  (void)memory_->runtime_.free(address_);
}

StagingBuffer::~StagingBuffer() {
  if (host_) (void)memory_.runtime().free_host(host_);
}

size_t StagingBuffer::reserve(size_t bytes) {
  const size_t at = (size_ + k_alignment - 1) / k_alignment * k_alignment;
  if (at + bytes > capacity_) {
    constexpr size_t k_least = 1 << 16;
    const size_t capacity = std::max(std::bit_ceil(at + bytes), k_least);
    if (side_ == Side::device) {
      capacity_ = capacity;
      size_ = at + bytes;
      return at;
    }
    void* larger = nullptr;
    Runtime& runtime = memory_.runtime();
    check(runtime, runtime.allocate_host(capacity, larger), "allocating page-locked memory");
    if (size_ > 0) std::memcpy(larger, host_, size_);
    void* const old = std::exchange(host_, larger);
    capacity_ = capacity;
    if (old) check(runtime, runtime.free_host(old), "releasing page-locked memory");
  }
  size_ = at + bytes;
  return at;
}

void StagingBuffer::ensure_device() {
  if (device_.bytes() >= size_) return;
  device_ = {};
  device_ = DeviceBuffer(memory_, capacity_);
}

void StagingBuffer::copy_to_device(Stream stream) {
  if (size_ == 0) return;
  Runtime& runtime = memory_.runtime();
  check(runtime, runtime.copy_to_device(stream, device_.address(), host_, size_), "copying to the device");
}

void StagingBuffer::copy_to_host(Stream stream) {
  if (size_ == 0) return;
  Runtime& runtime = memory_.runtime();
  check(runtime, runtime.copy_to_host(stream, host_, device_.address(), size_), "copying from the device");
}

}  // namespace fieldtrace::gpu
