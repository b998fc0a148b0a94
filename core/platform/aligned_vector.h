// Vectors whose elements start on a cache line, for loops that load whole SIMD vectors.
//
// Memory comes from operator new rather than from a pool such as TBB's, so that address and thread sanitizers see every
// allocation, its bounds and its release. Thread-safety: as std::vector.
#pragma once

#include <cstddef>
#include <new>
#include <vector>

namespace fieldtrace {

// The widest SIMD vector and the cache line of all supported processors.
inline constexpr size_t k_cache_line = 64;

// Throws std::bad_alloc, as std::allocator does.
template <class T>
struct CacheLineAllocator {
  using value_type = T;

  CacheLineAllocator() = default;
  template <class U>
  CacheLineAllocator(const CacheLineAllocator<U>&) {}

  T* allocate(size_t count) {
    if (count > size_t(-1) / sizeof(T)) throw std::bad_array_new_length();
    return static_cast<T*>(::operator new(count * sizeof(T), std::align_val_t(k_cache_line)));
  }
  void deallocate(T* p, size_t) { ::operator delete(p, std::align_val_t(k_cache_line)); }

  template <class U>
  bool operator==(const CacheLineAllocator<U>&) const {
    return true;
  }
};

template <class T>
using AlignedVector = std::vector<T, CacheLineAllocator<T>>;

// Makes room for n elements. Batches do not shrink: elements that come back would be zeroed, in vain.
template <class Vector>
void make_room(Vector& v, size_t n) {
  if (v.size() < n) v.resize(n);
}

}  // namespace fieldtrace
