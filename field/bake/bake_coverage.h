// Baking coverage tiles: 32 x 32 parallel lines of one direction, traced as the light sees them.
//
// The result is a pure function of mesh, chart, D and N. Thread-safety: any number of threads may bake one field at
// once; each tile is baked by one of them.
#pragma once

#include <cstdint>
#include <span>

#include "core/trace/accel.h"
#include "field/bake/bake.h"
#include "field/store/field.h"

namespace fieldtrace {

// Bakes those of `slots` (CoverageTiles) that are not baked yet, and waits for those that other threads are baking;
// afterwards all are finished, unless the pool is full. `shape` is the field's object in `accel`.
void bake_coverage(Field& field, std::span<const uint32_t> slots, const Accel& accel, uint32_t shape,
                   BakeCounters& counters);

}  // namespace fieldtrace
