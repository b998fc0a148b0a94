// Baking: tracing the lines of demanded slices with Embree and certifying their cells.
//
// A visibility cell traces K lines spread over its directions and over the feet of their perpendiculars. All lines must
// agree, else the cell asks; it stops at the first round that disagrees. A depth cell first traces the line through its
// centre and then lines that fan out from the depth of the frontmost hit: all on one plane make a plane fit, all on it
// or behind it a one-sided bound, none at all a miss. A primitive's cell traces the line through its centre. The result
// is a pure function of mesh, chart, D, N and K. Thread-safety: any number of threads may bake one field at once; each
// slice is baked by one of them.
#pragma once

#include <cstdint>
#include <span>

#include "core/trace/accel.h"
#include "field/store/field.h"

namespace fieldtrace {

struct BakeCounters {
  uint64_t rays = 0;
  double seconds = 0.0;
};

// Bakes those of `slices` that nobody has baked, and waits for those that others are baking; afterwards every one is
// finished, unless the pool is full. `shape` is the field's object in `accel`.
void bake_slices(Field& field, FieldLayer layer, std::span<const uint32_t> slices, const Accel& accel, uint32_t shape,
                 BakeCounters& counters);

}  // namespace fieldtrace
