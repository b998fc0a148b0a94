// The compiled variants of the loop behind CameraSampler::sample(), one per instruction set.
// Thread-safety: pure functions.
#pragma once

#include "core/camera/camera_samples.h"
#include "core/scene/camera_lens.h"
#include "core/simd/isa.h"

namespace fieldtrace {

// The caller resizes the outputs; the kernel writes their padding too.
using CameraKernel = void (*)(const CameraLens& lens, const CameraSamples& samples, uint32_t picture_seed,
                              RayBatch& rays, float* near_distance, uint32_t* pixel_seeds, uint32_t* vertex_seeds);

// `isa` must be resolved: supported by this processor, not `automatic`.
CameraKernel camera_kernel_for(Isa isa);

void sample_camera_scalar(const CameraLens& lens, const CameraSamples& samples, uint32_t picture_seed, RayBatch& rays,
                          float* near_distance, uint32_t* pixel_seeds, uint32_t* vertex_seeds);

}  // namespace fieldtrace
