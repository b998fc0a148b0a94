// The loop over shafts for every Highway target.

// clang-format off: foreach_target.h includes this file again for each target and must come first.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "hybrid/culling/shaft_kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
// clang-format on

#include "core/simd/double_lanes-inl.h"
#include "hybrid/culling/shaft_batch-inl.h"

#if HWY_TARGET != HWY_SCALAR  // keep_met_by_shafts_scalar() covers it
FT_LANES_BEGIN

inline void keep_met_by_shafts_lanes(const ShaftTask& task, const ShadingPointBatch& points, int32_t* flags) {
  keep_met_by_shafts<F64>(task, points, flags);
}

FT_LANES_END
#endif

#if HWY_ONCE
#include "core/simd/isa_dispatch.h"

namespace fieldtrace {

ShaftKernel shaft_kernel(Isa isa) { FT_RETURN_FORM_FOR(isa, keep_met_by_shafts_lanes, keep_met_by_shafts_scalar) }

}  // namespace fieldtrace
#endif
