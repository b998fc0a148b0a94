// Arrays aligned to cache lines, and padded so that SIMD loops need no tail.
#pragma once

#include <cstddef>
#include <vector>

#include <tbb/cache_aligned_allocator.h>

namespace fieldtrace {

template <class T>
using AlignedVector = std::vector<T, tbb::cache_aligned_allocator<T>>;

// Two of the widest SIMD vectors in floats: some loops run over pairs.
inline constexpr size_t k_batch_padding = 32;
constexpr size_t padded(size_t n) { return (n + k_batch_padding - 1) / k_batch_padding * k_batch_padding; }

}  // namespace fieldtrace
