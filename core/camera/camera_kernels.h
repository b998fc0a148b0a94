// The compiled forms of the loop behind CameraSampler::sample(), one per instruction set.
// Thread-safety: pure functions.
#pragma once

#include "core/camera/camera_samples.h"
#include "core/scene/camera_lens.h"
#include "core/simd/isa.h"

namespace fieldtrace {

// `rays` and near_distance are resized by the caller; their padding is written too.
using CameraKernel = void (*)(const CameraLens& lens, const CameraSamples& samples, uint32_t seed, RayBatch& rays,
                              float* near_distance);

// `isa` is resolved: supported by this processor and not `automatic`.
CameraKernel camera_kernel_for(Isa isa);

void sample_camera_scalar(const CameraLens& lens, const CameraSamples& samples, uint32_t seed, RayBatch& rays,
                          float* near_distance);

}  // namespace fieldtrace
