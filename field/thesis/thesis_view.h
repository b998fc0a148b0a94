// A thesis field as plain pointers. Shared by every instruction set and the GPU.
//
// Memory layout: sample = (position * M + v) * M + u; a byte of distance each, and three of normal. Both tables are
// followed by k_field_padding bytes, because vectors gather four bytes at a time.
// Thread-safety: values; the pointers are valid while the ThesisField lives.
#pragma once

#include <cstdint>

#include "field/store/view.h"

namespace fieldtrace {

inline constexpr int k_field_padding = 4;
// Distances are integer multiples of 2 R / 254; 255 is a miss.
inline constexpr int k_thesis_steps = 254;
inline constexpr int k_thesis_miss = 255;
// Components of normals are (byte - 127) / 127.
inline constexpr int k_thesis_normal_zero = 127;

struct ThesisFieldView {
  ChartAxis directions;               // M cells
  int m = 0;                          // M
  const uint8_t* distance = nullptr;  // 4,226 M^2
  const uint8_t* normal = nullptr;    // 3 a sample; null: not kept
};

// One instance of an object with a field.
struct ThesisInstanceView {
  ThesisFieldView field;
  float to_unit[12] = {};   // world to unit space, 3 x 4, column-major
  float to_normal[9] = {};  // object normals to world: the inverse transpose, column-major
  float slack = 0.0f;       // of shadow look-ups, in unit space
  uint32_t instance = 0;
};

}  // namespace fieldtrace
