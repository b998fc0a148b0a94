// The compiled variants of the loop behind Surfaces::evaluate(), one per instruction set. Thread-safety: pure
// functions.
#pragma once

#include <cstdint>
#include <span>

#include "core/simd/isa.h"
#include "core/surface/surface.h"

namespace fieldtrace {

// Hits on one mesh instance with at most 2^31 / 3 triangles and positions.
struct SurfaceTask {
  const Scene& scene;
  uint32_t instance = 0;
  const HitBatch& hits;
  std::span<const int32_t> places;  // indices of the hits in `hits`, ascending
};

// Fills `result` at each place, except for uv.
using SurfaceKernel = void (*)(const SurfaceTask& task, SurfaceBatch& result);

// `isa` must be resolved: supported by this processor, not `automatic`.
SurfaceKernel surface_kernel_for(Isa isa);

void evaluate_surfaces_scalar(const SurfaceTask& task, SurfaceBatch& result);

}  // namespace fieldtrace
