// The compiled forms of the loop behind Surfaces::evaluate(), one per instruction set. Thread-safety: pure functions.
#pragma once

#include <cstdint>
#include <span>

#include "core/simd/isa.h"
#include "core/surface/surface.h"

namespace fieldtrace {

// Hits on one instance of a mesh, whose triangles and positions are no more than 2^31 / 3.
struct SurfaceTask {
  const Scene& scene;
  uint32_t instance = 0;
  const HitBatch& hits;
  std::span<const int32_t> places;  // of the hits, in `hits`
};

// result[place] = the surface there, uv left as it is.
using SurfaceKernel = void (*)(const SurfaceTask& task, SurfacePoint* result);

// `isa` is resolved: supported by this processor and not `automatic`.
SurfaceKernel surface_kernel_for(Isa isa);

void evaluate_surfaces_scalar(const SurfaceTask& task, SurfacePoint* result);

}  // namespace fieldtrace
