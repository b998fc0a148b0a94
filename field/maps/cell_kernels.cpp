// The cell kernels for every Highway target.

// clang-format off: foreach_target.h includes this file again for each target and must come first.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "field/maps/cell_kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
// clang-format on

#include "core/simd/lanes-inl.h"
#include "field/maps/cell_irradiance.hd.h"
#include "field/maps/cell_kernels.h"
#include "field/maps/cell_kernels_scalar.h"
#include "field/maps/cell_visibility.hd.h"
#include "field/maps/direction_cells.hd.h"

#if HWY_TARGET != HWY_SCALAR  // cell_kernels_scalar.h covers it
FT_LANES_BEGIN

int see_cell_of_target(const CellTask& task, const CellPoints& points, const CellSums& sums, int32_t* undecided) {
  return see_cell<F32>(task, points, sums, undecided);
}

void see_own_of_target(const OwnLines& own, const CellPoints& points, const OwnShares& kept) {
  see_own<F32>(own, points, kept);
}

void sum_cells_of_target(const CellLights& cells, const CellNormals& normals, float grazing,
                         const CellLightSums& sums) {
  sum_cells<F32>(cells, normals, grazing, sums);
}

void find_cells_of_target(const DirectionRow& row, int32_t directions, int32_t* cells) {
  find_cells<F32>(row, directions, cells);
}

FT_LANES_END
#endif

#if HWY_ONCE
#include "core/simd/isa_dispatch.h"

namespace fieldtrace {

CellKernel cell_kernel_for(Isa isa){FT_RETURN_FORM_FOR(isa, see_cell_of_target, see_cell_scalar)}

OwnShareKernel own_share_kernel_for(Isa isa){FT_RETURN_FORM_FOR(isa, see_own_of_target, see_own_scalar)}

CellLightKernel cell_light_kernel_for(Isa isa){FT_RETURN_FORM_FOR(isa, sum_cells_of_target, sum_cells_scalar)}

DirectionCellKernel direction_cell_kernel_for(Isa isa) {
  FT_RETURN_FORM_FOR(isa, find_cells_of_target, find_cells_scalar)
}

}  // namespace fieldtrace
#endif
