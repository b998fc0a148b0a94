// The light sampling loop for every Highway target.

// clang-format off: foreach_target.h includes this file again for each target and must come first.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/light_kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
// clang-format on

#include "core/lanes-inl.h"
#include "core/light_batch-inl.h"

#if HWY_TARGET != HWY_SCALAR  // sample_light_scalar serves that
FT_LANES_BEGIN

inline void sample_light_lanes(const LightTable& lights, uint32_t light, const ReceiverBatch& receivers,
                               const LightSampleRange& range, ShadowBatch& out) {
  LightLoop<F32>{lights, light, receivers, range, out}.run();
}

FT_LANES_END
#endif

#if HWY_ONCE
namespace fieldtrace {

LightKernel light_kernel_for(Isa isa) {
  switch (isa) {
#if HWY_TARGETS & HWY_AVX3
    case Isa::avx512:
      return N_AVX3::sample_light_lanes;
#endif
#if HWY_TARGETS & HWY_AVX2
    case Isa::avx2:
      return N_AVX2::sample_light_lanes;
#endif
#if HWY_TARGETS & HWY_SSE4
    case Isa::sse4:
      return N_SSE4::sample_light_lanes;
#elif HWY_TARGETS & HWY_NEON
    case Isa::sse4:
      return N_NEON::sample_light_lanes;
#endif
    default:
      return sample_light_scalar;
  }
}

}  // namespace fieldtrace
#endif
