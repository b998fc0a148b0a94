#include "field/maps/cell_kernels_scalar.h"

#include "field/maps/cell_visibility.hd.h"

namespace fieldtrace {

int see_cell_scalar(const CellTask& task, const CellPoints& points, const CellSums& sums, int32_t* undecided) {
  return scalar::see_cell<float>(task, points, sums, undecided);
}

}  // namespace fieldtrace
