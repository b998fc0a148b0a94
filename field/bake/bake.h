// Baking: tracing the lines of demanded slices with Embree and certifying their cells.
//
// A visibility cell traces K lines spread over its directions and over the feet of their perpendiculars, and stops
// after the first round if they disagree; a cell whose lines disagree is undecided at the default tolerance. A depth
// cell first traces the line through its centre and then lines that fan out from the depth of the frontmost hit: hits
// that all lie on one plane make a plane fit, hits on it or behind it a one-sided bound, no hit at all a miss. A
// primitive cell traces the line through its centre. The result is a pure function of mesh, chart, D, N and K.
// Thread-safety: any number of threads may bake one field at once; each slice is baked by one of them.
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

// Bakes those of `slices` that are not baked yet, and waits for those that other threads are baking; afterwards all are
// finished, unless the pool is full. `shape` is the field's object in `accel`.
void bake_slices(Field& field, FieldLayer layer, std::span<const uint32_t> slices, const Accel& accel, uint32_t shape,
                 BakeCounters& counters);

}  // namespace fieldtrace
