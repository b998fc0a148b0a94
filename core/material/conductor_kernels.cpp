// The sampling loop of rough metals for every Highway target.

// clang-format off: foreach_target.h includes this file again for each target and must come first.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/material/conductor_kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
// clang-format on

#include "core/material/conductor_batch-inl.h"
#include "core/simd/lanes-inl.h"

#if HWY_TARGET != HWY_SCALAR  // the scalar target is served by sample_conductor_scalar
FT_LANES_BEGIN

inline void sample_conductor_lanes(const ConductorTask& task, LobeSamples& out) {
  sample_conductor_batch<F32>(task, out);
}

FT_LANES_END
#endif

#if HWY_ONCE
#include "core/simd/isa_dispatch.h"

namespace fieldtrace {

ConductorKernel conductor_kernel_for(Isa isa) {
  FT_RETURN_FORM_FOR(isa, sample_conductor_lanes, sample_conductor_scalar)
}

}  // namespace fieldtrace
#endif
