// What `--check` compares estimates with.
#pragma once

#include <cstdint>

namespace fieldtrace {

// Rays along each side of a part of a light or of a lobe.
inline constexpr int k_check_side = 8;
inline constexpr int k_check_rays = k_check_side * k_check_side;
// Rays for all that arrives at a point, of a light or a sky.
inline constexpr uint32_t k_arrival_rays = 1024;

}  // namespace fieldtrace
