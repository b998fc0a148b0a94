// Orders points so that halving the list repeatedly partitions space: the two halves lie on either side of a plane
// across the longest extent of both.
//
// Thread-safety: pure functions on values.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "core/math/math.h"

namespace fieldtrace {

// Where a list [begin, end) is halved.
constexpr size_t middle_of(size_t begin, size_t end) { return begin + (end - begin) / 2; }

struct PlacedIndex {
  Vec3 position;       // finite
  uint32_t index = 0;  // breaks ties between coincident points
};

// Orders `points` so that every range of more than `smallest` points that middle_of() halves is cut by such a plane.
// The same points give the same sets in the halves, whatever their order before.
void order_by_median_splits(std::span<PlacedIndex> points, size_t smallest);

}  // namespace fieldtrace
