// Sorts rays so that those of similar directions follow each other: their look-ups then read the same parts of a field.
//
// Thread-safety: values.
#pragma once

#include <cstdint>
#include <vector>

#include "core/trace/rays.h"

namespace fieldtrace {

// Scratch memory of the sort.
struct DirectionOrder {
  std::vector<uint32_t> cell_begin, sorted;
  std::vector<uint16_t> cells;
};

// Sorts `which` (indices into `rays`, which must be unit) by direction, in cells of an octahedral map of 32 x 32
// (field/chart/chart.hd.h), the coarsest that fields have; stable within a cell.
void order_by_direction(const RayBatch& rays, std::vector<uint32_t>& which, DirectionOrder& work);

}  // namespace fieldtrace
