// Atomic access to values in plain arrays that several threads read and write.
//
// Thread-safety: what is read and written through shared() alone is free of races. The arrays keep their plain layout,
// so that kernels and files read them as they are.
#pragma once

#include <atomic>

namespace fieldtrace {

// Also for const owners, whose arrays are not const themselves: their readers need an atomic_ref, which takes no const
// value in C++20. Unchecked: `value` is not a const object, and outlives what is returned.
template <class T>
std::atomic_ref<T> shared(const T& value) {
  return std::atomic_ref<T>(const_cast<T&>(value));
}

}  // namespace fieldtrace
