// A far group of objects, as it hides directions of the sky, and the directions that it is asked for. Plain data,
// shared by every instruction set. Space: world. Thread-safety: values.
#pragma once

#include <cstdint>

namespace fieldtrace {

// Of unit direction d, if it lies on the side of `direction`, it takes the share height min(2 (1 - q), 1), if above 0,
// where q = dot(d, x)^2 + dot(d, y)^2.
struct GroupLobe {
  float direction[3];       // unit, to the group
  float x[3], y[3];         // across it
  float height = 0;         // share of the light that is hidden in its middle
  float least_middle = -1;  // least cosine of `direction` and the middle of a block that it takes something from
};

inline constexpr int k_part_block = 16;

// Blocks of k_part_block unit directions, and the blocks' middles, unit. Structures of arrays, aligned.
struct PartDirections {
  const float *x, *y, *z;
  const float *middle_x, *middle_y, *middle_z;
  int32_t blocks = 0;  // a multiple of 16
};

}  // namespace fieldtrace
