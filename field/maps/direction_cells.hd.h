// The direction cells that a row of directions lies in. Thread-safety: pure functions.

#if defined(FIELDTRACE_FIELD_MAPS_DIRECTION_CELLS_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_FIELD_MAPS_DIRECTION_CELLS_HD_H_
#undef FIELDTRACE_FIELD_MAPS_DIRECTION_CELLS_HD_H_
#else
#define FIELDTRACE_FIELD_MAPS_DIRECTION_CELLS_HD_H_
#endif

#include "core/platform/platform.h"
#include "core/simd/lanes.hd.h"
#include "field/chart/chart.hd.h"
#include "field/maps/cell_lights.h"

FT_LANES_BEGIN

// Sets the number u D + v of the cell of each direction; directions: D. As direction_cell() of field/bake/cell_lines.h.
template <class F>
FT_HD_INLINE void find_cells(const DirectionRow& row, int32_t directions, int32_t* cells) {
  const ChartAxis axis = make_axis(directions);
  for (int32_t i = 0; i < row.size; i += Lanes<F>::k_count) {
    const Vec3Lanes<F> around = {load_lanes<F>(row.x + i), load_lanes<F>(row.y + i), load_lanes<F>(row.z + i)};
    const Vec3Lanes<F> up = {splat<F>(row.up[0]), splat<F>(row.up[1]), splat<F>(row.up[2])};
    CellAddress<F> cell;
    find_direction_cell<F>(around * splat<F>(row.sine) + up, axis, cell);
    store_lanes(cell.u * splat_int<F>(directions) + cell.v, cells + i);
  }
}

FT_LANES_END

#endif  // toggled guard
