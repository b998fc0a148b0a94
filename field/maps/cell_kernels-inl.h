// The table of cell kernels, for any lane type.

#if defined(FIELDTRACE_FIELD_MAPS_CELL_KERNELS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_FIELD_MAPS_CELL_KERNELS_INL_H_
#undef FIELDTRACE_FIELD_MAPS_CELL_KERNELS_INL_H_
#else
#define FIELDTRACE_FIELD_MAPS_CELL_KERNELS_INL_H_
#endif

#include "field/maps/cell_irradiance.hd.h"
#include "field/maps/cell_kernels.h"
#include "field/maps/cell_visibility.hd.h"
#include "field/maps/cell_within.hd.h"
#include "field/maps/direction_cells.hd.h"
#include "field/maps/group_lobes.hd.h"

FT_LANES_BEGIN

template <class F>
constexpr CellKernels make_cell_kernels() {
  return {&see_cell<F>, &see_cell_within<F>, &see_own<F>, &sum_cells<F>, &find_cells<F>, &hide_by_lobe<F>};
}

FT_LANES_END

#endif  // toggled guard
