// The loop over camera samples for every Highway target.

// clang-format off: foreach_target.h includes this file again for each target and must come first.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/camera/camera_kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
// clang-format on

#include "core/camera/camera_batch-inl.h"
#include "core/simd/lanes-inl.h"

#if HWY_TARGET != HWY_SCALAR  // the scalar target is served by sample_camera_scalar
FT_LANES_BEGIN

inline void sample_camera_lanes(const CameraLens& lens, const CameraSamples& samples, uint32_t picture_seed,
                                RayBatch& rays, float* near_distance, uint32_t* pixel_seeds, uint32_t* vertex_seeds) {
  sample_camera_batch<F32>(lens, samples, picture_seed, rays, near_distance, pixel_seeds, vertex_seeds);
}

FT_LANES_END
#endif

#if HWY_ONCE
#include "core/simd/isa_dispatch.h"

namespace fieldtrace {

CameraKernel camera_kernel_for(Isa isa) { FT_RETURN_FORM_FOR(isa, sample_camera_lanes, sample_camera_scalar) }

}  // namespace fieldtrace
#endif
