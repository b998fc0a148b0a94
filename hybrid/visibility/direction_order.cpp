#include "hybrid/visibility/direction_order.h"

#include <numeric>

#include "field/chart/chart.hd.h"

namespace fieldtrace {

void order_by_direction(const RayBatch& rays, std::vector<uint32_t>& which, DirectionOrder& work) {
  constexpr int k_cells = 32;
  constexpr ChartAxis k_axis = make_axis(k_cells);
  work.cell_begin.assign(size_t(k_cells) * k_cells + 1, 0);
  work.cells.resize(which.size());
  work.sorted.resize(which.size());
  for (size_t j = 0; j < which.size(); ++j) {
    const Vec3 d = rays.direction(which[j]);
    scalar::CellAddress<float> cell;
    scalar::find_direction_cell<float>({d.x, d.y, d.z}, k_axis, cell);
    work.cells[j] = uint16_t(cell.u * k_cells + cell.v);
    ++work.cell_begin[work.cells[j] + 1u];
  }
  std::partial_sum(work.cell_begin.begin(), work.cell_begin.end(), work.cell_begin.begin());
  for (size_t j = 0; j < which.size(); ++j) work.sorted[work.cell_begin[work.cells[j]]++] = which[j];
  which.swap(work.sorted);
}

}  // namespace fieldtrace
