// Atomic access to values in plain arrays that several threads read and write.
//
// Thread-safety: values accessed through shared() alone are free of data races. The arrays keep their plain layout, so
// that kernels and files read them directly.
#pragma once

#include <atomic>

namespace fieldtrace {

// Takes const references too, because readers see the arrays through const owners and C++20's atomic_ref takes no const
// type. Unchecked: `value` is not a const object, and outlives the result.
template <class T>
std::atomic_ref<T> shared(const T& value) {
  return std::atomic_ref<T>(const_cast<T&>(value));
}

}  // namespace fieldtrace
