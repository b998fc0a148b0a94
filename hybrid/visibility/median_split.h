// Points put in such an order that halving the list again and again cuts space: each half's points lie on one side of a
// plane across the longest extent of both.
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
  uint32_t index = 0;  // decides between points in one place
};

// Orders `points` so that every half of more than `smallest` points, made by middle_of, is cut as said above. The
// same points give the same sets in the halves, whatever their order before.
void order_by_median_splits(std::span<PlacedIndex> points, size_t smallest);

}  // namespace fieldtrace
