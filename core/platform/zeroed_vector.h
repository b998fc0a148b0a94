// Vectors of many elements that begin as zeros, in memory that the system zeroes where it is first touched: by the
// threads that fill it, not by the one that makes it. Thread-safety: as std::vector.
#pragma once

#include <sys/mman.h>

#include <cstddef>
#include <cstdlib>
#include <new>
#include <type_traits>
#include <utility>
#include <vector>

namespace fieldtrace {

// Asks for huge pages where memory holds whole ones; without them it is the same, but slower to touch first.
inline void want_huge_pages(void* memory, size_t bytes) {
  constexpr size_t k_page = size_t(2) << 20;
  const auto address = reinterpret_cast<size_t>(memory);
  const size_t begin = (address + k_page - 1) / k_page * k_page, end = (address + bytes) / k_page * k_page;
  if (end > begin) madvise(static_cast<char*>(memory) + (begin - address), end - begin, MADV_HUGEPAGE);
}

// Throws std::bad_alloc, as std::allocator does.
template <class T>
struct ZeroedAllocator {
  static_assert(std::is_trivially_copyable_v<T> && std::is_trivially_destructible_v<T>);
  using value_type = T;

  ZeroedAllocator() = default;
  template <class U>
  ZeroedAllocator(const ZeroedAllocator<U>&) {}

  T* allocate(size_t count) {
    if (count > size_t(-1) / sizeof(T)) throw std::bad_array_new_length();
    void* const p = std::calloc(count, sizeof(T));
    if (!p) throw std::bad_alloc();
    want_huge_pages(p, count * sizeof(T));
    return static_cast<T*>(p);
  }
  void deallocate(T* p, size_t) { std::free(p); }

  // New elements are what calloc made of them.
  void construct(T*) {}
  template <class... Arguments>
  void construct(T* p, Arguments&&... arguments) {
    ::new (static_cast<void*>(p)) T(std::forward<Arguments>(arguments)...);
  }

  template <class U>
  bool operator==(const ZeroedAllocator<U>&) const {
    return true;
  }
};

// Elements must begin as zeros in every byte, and a vector may grow once: from nothing.
template <class T>
using ZeroedVector = std::vector<T, ZeroedAllocator<T>>;

}  // namespace fieldtrace
