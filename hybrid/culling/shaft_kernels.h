// Shafts from single shading points to one light, against one object, many at a time. Thread-safety: pure functions.
#pragma once

#include <cstdint>

#include "core/light/shading_points.h"
#include "core/simd/isa.h"

namespace fieldtrace {

// World space.
struct ShaftTask {
  double light_centre[3], light_radius;    // of its ball
  float light_lower[3], light_upper[3];    // of its box
  double object_centre[3], object_radius;  // likewise
  float object_lower[3], object_upper[3];
  double rounding;  // as for misses_ball()
};

// flags[r] becomes 0 where the shaft of all rays that may leave shading point r for the light, or its box, misses the
// object's ball or box; the same bits by any instruction set. `flags` is padded like the points.
using ShaftKernel = void (*)(const ShaftTask&, const ShadingPointBatch&, int32_t* flags);

// Of a resolved instruction set (not Isa::automatic; unchecked).
ShaftKernel shaft_kernel(Isa isa);

void keep_met_by_shafts_scalar(const ShaftTask& task, const ShadingPointBatch& points, int32_t* flags);

}  // namespace fieldtrace
