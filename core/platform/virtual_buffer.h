// A large array of reserved address space whose memory is committed on first write; zero until then.
//
// For arrays that grow on demand while other threads read them, and so can never be moved. Where the system limits
// address space (core/platform/address_space.h), owners reserve less, and their arrays fill up sooner.
// Thread-safety: construction by one thread; synchronising the contents is the caller's task.
#pragma once

#include <sys/mman.h>

#include <cstddef>
#include <string>
#include <utility>

#include "core/platform/error.h"

namespace fieldtrace {

template <class T>
class VirtualBuffer {
 public:
  VirtualBuffer() = default;
  // Reserves room for `count` zero elements. Throws Error if the system has no address space left.
  explicit VirtualBuffer(size_t count) : bytes_(count * sizeof(T)) {
    void* p = mmap(nullptr, bytes_, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    if (p == MAP_FAILED) {
      throw Error(
          "cannot reserve " + std::to_string(bytes_ >> 20) +
          " MiB of address space for a field; raise the limit (ulimit -v), or use a smaller --directions or --plane");
    }
    data_ = static_cast<T*>(p);
  }
  ~VirtualBuffer() {
    if (data_) munmap(data_, bytes_);
  }
  VirtualBuffer(VirtualBuffer&& other) noexcept
      : data_(std::exchange(other.data_, nullptr)), bytes_(std::exchange(other.bytes_, 0)) {}
  VirtualBuffer& operator=(VirtualBuffer&& other) noexcept {
    std::swap(data_, other.data_);
    std::swap(bytes_, other.bytes_);
    return *this;
  }

  T* data() { return data_; }
  const T* data() const { return data_; }
  T& operator[](size_t i) { return data_[i]; }
  const T& operator[](size_t i) const { return data_[i]; }

 private:
  T* data_ = nullptr;
  size_t bytes_ = 0;
};

}  // namespace fieldtrace
