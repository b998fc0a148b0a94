// Pyramids of diffuse radiance as plain pointers: what an object's surface sends along a direction, prefiltered. Shared
// by every instruction set and the GPU.
//
// Memory layout: one pyramid after another, each of `levels` levels of (texels / 2^k)^2 words, row by row, the last of
// 2 x 2. A word holds codes of ten bits for red, green and blue, lowest first; radiance = scale x code^2. Texels that
// nothing is known of hold what surrounds them.
// Thread-safety: values; the pointer is valid while the RadiancePyramids live.
#pragma once

#include <cstdint>

namespace fieldtrace {

inline constexpr int k_most_radiance_levels = 8;
inline constexpr int k_radiance_codes = 1023;

struct RadianceView {
  int texels = 0;  // along each side
  int levels = 0;
  const uint8_t* words = nullptr;
  int32_t bytes = 0;                                 // of one pyramid
  int32_t count = 0;                                 // pyramids
  int32_t level_begin[k_most_radiance_levels] = {};  // bytes
  float scale = 0.0f;
};

}  // namespace fieldtrace
