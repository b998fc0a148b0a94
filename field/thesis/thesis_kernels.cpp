// The look-up loops for every Highway target.

// clang-format off: foreach_target.h includes this file again for each target and must come first.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "field/thesis/thesis_kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
// clang-format on

#include "core/simd/lanes-inl.h"
#include "core/simd/lanes_pair-inl.h"
#include "field/thesis/thesis_batch-inl.h"

#if HWY_TARGET != HWY_SCALAR  // thesis_kernels_scalar() covers it
FT_LANES_BEGIN

// The kernels' addresses are taken inside the target's own namespace, so that no instance is shared between targets.
const ThesisKernels& thesis_kernels_of_target() {
  static constexpr ThesisKernels k_kernels = make_thesis_kernels<F32x2>();
  return k_kernels;
}

FT_LANES_END
#endif

#if HWY_ONCE
#include "core/simd/isa_dispatch.h"

namespace fieldtrace {

const ThesisKernels& thesis_kernels(Isa isa) {
  FT_RETURN_FORM_FOR(isa, thesis_kernels_of_target(), thesis_kernels_scalar())
}

}  // namespace fieldtrace
#endif
