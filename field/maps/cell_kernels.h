// see_cell() and see_own() of field/maps/cell_visibility.hd.h, see_cell_within() of field/maps/cell_within.hd.h,
// sum_cells() of field/maps/cell_irradiance.hd.h and find_cells() of field/maps/direction_cells.hd.h for each
// instruction set. Thread-safety: pure functions.
#pragma once

#include "core/simd/isa.h"
#include "field/maps/cell_lights.h"
#include "field/maps/cell_task.h"

namespace fieldtrace {

using CellKernel = int (*)(const CellTask& task, const CellPoints& points, const CellSums& sums, int32_t* undecided);

using OwnShareKernel = void (*)(const OwnLines& own, const CellPoints& points, const OwnShares& kept);

using CellLightKernel = void (*)(const CellLights& cells, const CellNormals& normals, float grazing,
                                 const CellLightSums& sums);

using DirectionCellKernel = void (*)(const DirectionRow& row, int32_t directions, int32_t* cells);

// `isa` must be resolved. The same bits for each.
CellKernel cell_kernel_for(Isa isa);
CellKernel cell_within_kernel_for(Isa isa);
OwnShareKernel own_share_kernel_for(Isa isa);
CellLightKernel cell_light_kernel_for(Isa isa);
DirectionCellKernel direction_cell_kernel_for(Isa isa);

}  // namespace fieldtrace
