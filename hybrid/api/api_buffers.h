// Buffers of the caller, checked: pointer, bytes from element to element, count. Thread-safety: values.
#pragma once

#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "core/math/finite.h"
#include "core/math/math.h"
#include "hybrid/api/api_objects.h"

namespace fieldtrace::api {

// Elements of `k_parts` values of type T. Null: not given.
template <class T, int k_parts = 1>
class Buffer {
 public:
  Buffer(const char* name, T* data, size_t stride, size_t count)
      : name_(name), data_(data), stride_(stride == 0 ? sizeof(T) * k_parts : stride), count_(count) {
    if (!data || count == 0) return;
    const std::string text(name);
    require(reinterpret_cast<uintptr_t>(data) % alignof(T) == 0, text + ": the pointer is not aligned");
    require(stride_ % alignof(T) == 0, text + ": the stride is not a multiple of its numbers' size");
    require(stride_ >= sizeof(T) * k_parts, text + ": the stride is smaller than an element");
    require(count <= std::numeric_limits<size_t>::max() / 2 / stride_, text + ": too many elements");
    require(begin() <= std::numeric_limits<uintptr_t>::max() - stride_ * count, text + ": reaches beyond memory");
  }

  explicit operator bool() const { return data_ != nullptr; }
  size_t count() const { return count_; }
  size_t stride() const { return stride_; }  // bytes
  const char* name() const { return name_; }
  // Throws Failure if it was not given, unless it has no elements.
  const Buffer& needed() const {
    require(data_ || count_ == 0, std::string(name_) + " is null");
    return *this;
  }
  T* at(size_t i) const {
    using Byte = std::conditional_t<std::is_const_v<T>, const char, char>;
    return reinterpret_cast<T*>(reinterpret_cast<Byte*>(data_) + i * stride_);
  }
  uintptr_t begin() const { return reinterpret_cast<uintptr_t>(data_); }
  uintptr_t end() const { return data_ && count_ ? begin() + (count_ - 1) * stride_ + sizeof(T) * k_parts : begin(); }

 private:
  const char* name_;
  T* data_;
  size_t stride_, count_;
};

// Throws Failure if the result `a` overlaps any other buffer; interleaved ones, whose strides are equal and whose
// elements do not meet, do not.
template <class A, class... Others>
void require_apart(const A& a, const Others&... others) {
  const auto check = [&](const auto& b) {
    if (!a || !b || a.begin() >= b.end() || b.begin() >= a.end()) return;
    const size_t stride = a.count() > 1 ? size_t(reinterpret_cast<uintptr_t>(a.at(1)) - a.begin()) : 0;
    const size_t other = b.count() > 1 ? size_t(reinterpret_cast<uintptr_t>(b.at(1)) - b.begin()) : 0;
    if (stride > 0 && stride == other) {
      const size_t shift = a.begin() >= b.begin() ? (a.begin() - b.begin()) % stride
                                                  : (stride - (b.begin() - a.begin()) % stride) % stride;
      const size_t size_a = a.end() - (a.begin() + (a.count() - 1) * stride);
      const size_t size_b = b.end() - (b.begin() + (b.count() - 1) * stride);
      if (shift >= size_b && shift + size_a <= stride) return;
    }
    throw Failure(FT_ERROR_INVALID_ARGUMENT, std::string(a.name()) + " overlaps " + b.name());
  };
  (check(others), ...);
}

inline Vec3 vector_at(const Buffer<const float, 3>& buffer, size_t i) {
  const float* const v = buffer.at(i);
  return {v[0], v[1], v[2]};
}

}  // namespace fieldtrace::api
