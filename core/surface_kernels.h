// The compiled forms of the loop behind Surfaces::evaluate(), one per instruction set. Thread-safety: pure functions.
#pragma once

#include <cstddef>
#include <cstdint>

#include "core/isa.h"
#include "core/surface.h"

namespace fieldtrace {

// Hits on one instance of a mesh.
struct SurfaceTask {
  const Scene& scene;
  uint32_t instance = 0;
  const HitBatch& hits;
  const int32_t* places = nullptr;  // of the hits, in `hits`
  size_t count = 0;
};

// result[place] = the surface there, uv left as it is.
using SurfaceKernel = void (*)(const SurfaceTask& task, SurfacePoint* result);

// `isa` is resolved: supported by this processor and not `automatic`.
SurfaceKernel surface_kernel_for(Isa isa);

void evaluate_surfaces_scalar(const SurfaceTask& task, SurfacePoint* result);

}  // namespace fieldtrace
