// Rays of like directions one after another: their look-ups then read the same parts of a field.
//
// Thread-safety: values.
#pragma once

#include <cstdint>
#include <vector>

#include "core/trace/rays.h"

namespace fieldtrace {

// What the sort works in.
struct DirectionOrder {
  std::vector<uint32_t> cell_begin, sorted;
  std::vector<uint16_t> cells;
};

// Sorts `which` (indices into `rays`, which are unit) by the rays' cells of a direction map of 32 x 32
// (field/chart/chart.hd.h), as coarse as fields have it; within a cell the order stays.
void order_by_direction(const RayBatch& rays, std::vector<uint32_t>& which, DirectionOrder& work);

}  // namespace fieldtrace
