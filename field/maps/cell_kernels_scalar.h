// The cell kernels with one float a lane: the reference, and `--isa scalar`.
#pragma once

#include "field/maps/cell_lights.h"
#include "field/maps/cell_task.h"

namespace fieldtrace {

int see_cell_scalar(const CellTask& task, const CellPoints& points, const CellSums& sums, int32_t* undecided);
int see_cell_within_scalar(const CellTask& task, const CellPoints& points, const CellSums& sums, int32_t* undecided);
void see_own_scalar(const OwnLines& own, const CellPoints& points, const OwnShares& kept);
void sum_cells_scalar(const CellLights& cells, const CellNormals& normals, float grazing, const CellLightSums& sums);
void find_cells_scalar(const DirectionRow& row, int32_t directions, int32_t* cells);

}  // namespace fieldtrace
