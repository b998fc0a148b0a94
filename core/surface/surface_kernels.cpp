// The loop over hits for every Highway target.

// clang-format off: foreach_target.h includes this file again for each target and must come first.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/surface/surface_kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
// clang-format on

#include "core/simd/double_lanes-inl.h"
#include "core/surface/surface_batch-inl.h"

#if HWY_TARGET != HWY_SCALAR  // the scalar target is served by evaluate_surfaces_scalar
FT_LANES_BEGIN

inline void evaluate_surfaces_lanes(const SurfaceTask& task, SurfaceBatch& result) {
  evaluate_surfaces<F32, F64>(task, result);
}

FT_LANES_END
#endif

#if HWY_ONCE
#include "core/simd/isa_dispatch.h"

namespace fieldtrace {

SurfaceKernel surface_kernel_for(Isa isa) { FT_RETURN_FORM_FOR(isa, evaluate_surfaces_lanes, evaluate_surfaces_scalar) }

}  // namespace fieldtrace
#endif
