// The kernel of cells within a distance for every Highway target.

// clang-format off: foreach_target.h includes this file again for each target and must come first.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "field/maps/cell_within_kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
// clang-format on

#include "core/simd/lanes-inl.h"
#include "field/maps/cell_kernels.h"
#include "field/maps/cell_kernels_scalar.h"
#include "field/maps/cell_within.hd.h"

#if HWY_TARGET != HWY_SCALAR  // see_cell_within_scalar() covers it
FT_LANES_BEGIN

int see_cell_within_of_target(const CellTask& task, const CellPoints& points, const CellSums& sums,
                              int32_t* undecided) {
  return see_cell_within<F32>(task, points, sums, undecided);
}

FT_LANES_END
#endif

#if HWY_ONCE
#include "core/simd/isa_dispatch.h"

namespace fieldtrace {

CellKernel cell_within_kernel_for(Isa isa) {
  FT_RETURN_FORM_FOR(isa, see_cell_within_of_target, see_cell_within_scalar)
}

}  // namespace fieldtrace
#endif
