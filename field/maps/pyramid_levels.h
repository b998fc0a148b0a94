// Levels of pyramids over square maps. Thread-safety: pure functions.
#pragma once

#include <bit>

namespace fieldtrace {

// Levels of half, a quarter, ... of `texels` along a side, a power of two, down to one.
inline int pyramid_levels(int texels) { return std::bit_width(unsigned(texels)) - 1; }

}  // namespace fieldtrace
