// The segment loops for every Highway target.

// clang-format off: foreach_target.h includes this file again for each target and must come first.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "field/query/segment_kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
// clang-format on

#include "core/simd/lanes-inl.h"
#include "core/simd/lanes_pair-inl.h"
#include "field/query/segment_batch-inl.h"
#include "field/query/segment_kernels_scalar.h"

#if HWY_TARGET != HWY_SCALAR  // segment_kernels_scalar() covers it
FT_LANES_BEGIN

// The kernels' addresses are taken inside the target's own namespace, so that no instance is shared between targets.
const SegmentKernels& segment_kernels_of_target() {
  static constexpr SegmentKernels k_kernels = make_segment_kernels<F32x2>();
  return k_kernels;
}

FT_LANES_END
#endif

#if HWY_ONCE
#include "core/simd/isa_dispatch.h"

namespace fieldtrace {

const SegmentKernels& segment_kernels(Isa isa) {
  FT_RETURN_FORM_FOR(isa, segment_kernels_of_target(), segment_kernels_scalar())
}

}  // namespace fieldtrace
#endif
