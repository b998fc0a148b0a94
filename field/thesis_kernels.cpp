// The look-up loops for every Highway target.

// clang-format off: foreach_target.h includes this file again for each target and must come first.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "field/thesis_kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
// clang-format on

#include "core/lanes-inl.h"
#include "core/lanes_pair-inl.h"
#include "field/thesis_batch-inl.h"

#if HWY_TARGET != HWY_SCALAR  // thesis_kernels_scalar() serves that
FT_LANES_BEGIN

// The kernels' addresses are taken inside the target's own namespace, so that no instance is shared between targets.
const ThesisKernels& thesis_kernels_of_target() {
  static constexpr ThesisKernels k_kernels = make_thesis_kernels<F32x2>();
  return k_kernels;
}

FT_LANES_END
#endif

#if HWY_ONCE
namespace fieldtrace {

const ThesisKernels& thesis_kernels(Isa isa) {
  switch (isa) {
#if HWY_TARGETS & HWY_AVX3
    case Isa::avx512:
      return N_AVX3::thesis_kernels_of_target();
#endif
#if HWY_TARGETS & HWY_AVX2
    case Isa::avx2:
      return N_AVX2::thesis_kernels_of_target();
#endif
#if HWY_TARGETS & HWY_SSE4
    case Isa::sse4:
      return N_SSE4::thesis_kernels_of_target();
#elif HWY_TARGETS & HWY_NEON
    case Isa::sse4:
      return N_NEON::thesis_kernels_of_target();
#endif
    default:
      return thesis_kernels_scalar();
  }
}

}  // namespace fieldtrace
#endif
