#include "field/maps/cell_kernels_scalar.h"

#include "field/maps/cell_irradiance.hd.h"
#include "field/maps/cell_visibility.hd.h"
#include "field/maps/cell_within.hd.h"
#include "field/maps/direction_cells.hd.h"

namespace fieldtrace {

int see_cell_scalar(const CellTask& task, const CellPoints& points, const CellSums& sums, int32_t* undecided) {
  return scalar::see_cell<float>(task, points, sums, undecided);
}

int see_cell_within_scalar(const CellTask& task, const CellPoints& points, const CellSums& sums, int32_t* undecided) {
  return scalar::see_cell_within<float>(task, points, sums, undecided);
}

void see_own_scalar(const OwnLines& own, const CellPoints& points, const OwnShares& kept) {
  scalar::see_own<float>(own, points, kept);
}

void sum_cells_scalar(const CellLights& cells, const CellNormals& normals, float grazing, const CellLightSums& sums) {
  scalar::sum_cells<float>(cells, normals, grazing, sums);
}

void find_cells_scalar(const DirectionRow& row, int32_t directions, int32_t* cells) {
  scalar::find_cells<float>(row, directions, cells);
}

}  // namespace fieldtrace
