// Direction maps as plain pointers. Shared by every instruction set and the GPU, hence outside the lane namespaces.
//
// Memory layout. depth: 16 bits a texel, [direction][y][x], rows of `texels`; 0 where the line meets nothing, else
// 1 + 65534 (z + 1) / 2 for the highest hit, z its coordinate along the direction. coverage: per direction, levels 1 to
// `levels` one after another; level k has n = texels / 2^k texels a side and (n + 1)^2 entries of four bytes: the
// covered share of 2 x 2 neighbours in 1/255, so that a bilinear read is one gather. Entry (i, j) holds the texels
// (i - 1, j - 1), (i, j - 1), (i - 1, j), (i, j), lowest byte first; those beyond the map are 0.
// Thread-safety: values; the pointers are valid while the DirectionMaps live.
#pragma once

#include <cstdint>

namespace fieldtrace {

inline constexpr int k_most_coverage_levels = 8;
inline constexpr float k_depth_codes = 65534.0f;

struct MapsView {
  int texels = 0;  // along each side of a map over [-1, 1]^2
  int levels = 0;
  const uint8_t* depth = nullptr;
  const uint8_t* coverage = nullptr;
  int32_t depth_bytes = 0, coverage_bytes = 0;       // of one direction
  int32_t directions = 0;                            // maps
  int32_t level_begin[k_most_coverage_levels] = {};  // bytes; [k] is that of level k + 1
};

}  // namespace fieldtrace
