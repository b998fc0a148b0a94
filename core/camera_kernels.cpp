// The loop over camera samples for every Highway target.

// clang-format off: foreach_target.h includes this file again for each target and must come first.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/camera_kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
// clang-format on

#include "core/camera_batch-inl.h"
#include "core/lanes-inl.h"

#if HWY_TARGET != HWY_SCALAR  // sample_camera_scalar serves that
FT_LANES_BEGIN

inline void sample_camera_lanes(const CameraLens& lens, const CameraSamples& samples, uint32_t seed, RayBatch& rays,
                                float* near_distance) {
  sample_camera_batch<F32>(lens, samples, seed, rays, near_distance);
}

FT_LANES_END
#endif

#if HWY_ONCE
namespace fieldtrace {

CameraKernel camera_kernel_for(Isa isa) {
  switch (isa) {
#if HWY_TARGETS & HWY_AVX3
    case Isa::avx512:
      return N_AVX3::sample_camera_lanes;
#endif
#if HWY_TARGETS & HWY_AVX2
    case Isa::avx2:
      return N_AVX2::sample_camera_lanes;
#endif
#if HWY_TARGETS & HWY_SSE4
    case Isa::sse4:
      return N_SSE4::sample_camera_lanes;
#elif HWY_TARGETS & HWY_NEON
    case Isa::sse4:
      return N_NEON::sample_camera_lanes;
#endif
    default:
      return sample_camera_scalar;
  }
}

}  // namespace fieldtrace
#endif
