// The loops over lights for every Highway target.

// clang-format off: foreach_target.h includes this file again for each target and must come first.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/light/light_kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
// clang-format on

#include "core/light/light_batch-inl.h"
#include "core/light/light_irradiance_batch-inl.h"
#include "core/simd/double_lanes-inl.h"
#include "core/simd/lanes-inl.h"

#if HWY_TARGET != HWY_SCALAR  // the scalar target is served by the functions of light_kernels_scalar.cpp
FT_LANES_BEGIN

inline void sample_light_lanes(const LightTable& lights, uint32_t light, const ShadingPointBatch& shading_points,
                               const LightSampleRange& range, ShadowBatch& out) {
  LightLoop<F32>{lights, light, shading_points, range, out}.run();
}

inline void whole_irradiance_lanes(const Light& light, const ShadingPointBatch& points, float* out) {
  whole_irradiance_batch<F64>(light, points, out);
}

inline void irradiance_vectors_lanes(const Light& light, const ShadingPointBatch& points, IrradianceVectors& out) {
  irradiance_vectors_batch<F64>(light, points, out);
}

FT_LANES_END
#endif

#if HWY_ONCE
#include "core/simd/isa_dispatch.h"

namespace fieldtrace {

LightKernel light_kernel_for(Isa isa){FT_RETURN_FORM_FOR(isa, sample_light_lanes, sample_light_scalar)}

IrradianceKernel
    irradiance_kernel_for(Isa isa){FT_RETURN_FORM_FOR(isa, whole_irradiance_lanes, whole_irradiance_scalar)}

IrradianceVectorsKernel irradiance_vectors_kernel_for(Isa isa) {
  FT_RETURN_FORM_FOR(isa, irradiance_vectors_lanes, irradiance_vectors_scalar)
}

}  // namespace fieldtrace
#endif
