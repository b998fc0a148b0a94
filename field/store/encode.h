// Writing the bits of a cell: the inverse of the decoders in field/store/layout.hd.h. Host only.
// Thread-safety: pure functions.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "core/math/math.h"
#include "field/store/layout.hd.h"

namespace fieldtrace {

// Nearest 16-bit code of a depth in [-1, 1].
inline uint32_t encode_depth(float depth) {
  return uint32_t(std::clamp(std::lround((depth + 1.0f) / scalar::k_depth_quantum), 0l, 65535l));
}

// Bits 16-31 of the depth word; `n` is unit.
inline uint32_t encode_normal(const Vec3& n) {
  const float sum = std::abs(n.x) + std::abs(n.y) + std::abs(n.z);
  float x = n.x / sum, y = n.y / sum;
  if (n.z < 0.0f) {
    const float fx = (1.0f - std::abs(y)) * std::copysign(1.0f, x);
    const float fy = (1.0f - std::abs(x)) * std::copysign(1.0f, y);
    x = fx;
    y = fy;
  }
  const auto byte = [](float f) { return uint32_t(std::clamp(std::lround((f + 1.0f) * 127.5f), 0l, 255l)); };
  return byte(x) << 16 | byte(y) << 24;
}

// The smallest code whose decoded bound is at least e; 255 if none is.
inline uint32_t encode_error(float e) {
  uint32_t low = 0, high = 255;
  while (low < high) {
    const uint32_t middle = (low + high) / 2;
    if (scalar::decode_error<float>(int32_t(middle << 8)) >= e) {
      high = middle;
    } else {
      low = middle + 1;
    }
  }
  return low;
}

inline uint32_t encode_certificate(int kind, int risk_class, uint32_t error_code) {
  return uint32_t(kind) | uint32_t(risk_class) << 2 | error_code << 8;
}

inline uint8_t encode_visibility(bool hit, int risk_class) { return uint8_t(1 + int(hit) + 2 * risk_class); }

}  // namespace fieldtrace
