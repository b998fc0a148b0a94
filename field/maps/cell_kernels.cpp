// The cell kernels for every Highway target.

// clang-format off: foreach_target.h includes this file again for each target and must come first.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "field/maps/cell_kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
// clang-format on

#include "core/simd/lanes-inl.h"
#include "field/maps/cell_kernels-inl.h"

#if HWY_TARGET != HWY_SCALAR  // cell_kernels_scalar() covers it
FT_LANES_BEGIN

// The kernels' addresses are taken inside the target's own namespace, so that no instance is shared between targets.
const CellKernels& cell_kernels_of_target() {
  static constexpr CellKernels k_kernels = make_cell_kernels<F32>();
  return k_kernels;
}

FT_LANES_END
#endif

#if HWY_ONCE
#include "core/simd/isa_dispatch.h"

namespace fieldtrace {

const CellKernels& cell_kernels(Isa isa) { FT_RETURN_FORM_FOR(isa, cell_kernels_of_target(), cell_kernels_scalar()) }

}  // namespace fieldtrace
#endif
