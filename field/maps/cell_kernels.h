// see_cell() and see_own() of field/maps/cell_visibility.hd.h, see_cell_within() of field/maps/cell_within.hd.h,
// sum_cells() of field/maps/cell_irradiance.hd.h, find_cells() of field/maps/direction_cells.hd.h and hide_by_lobe() of
// field/maps/group_lobes.hd.h for each instruction set. Thread-safety: pure functions.
#pragma once

#include "core/simd/isa.h"
#include "field/maps/cell_lights.h"
#include "field/maps/cell_task.h"
#include "field/maps/group_lobe.h"

namespace fieldtrace {

using CellKernel = int (*)(const CellTask& task, const CellPoints& points, const CellSums& sums, int32_t* undecided);

struct CellKernels {
  CellKernel see_cell, see_cell_within;
  void (*see_own)(const OwnLines& own, const CellPoints& points, const OwnShares& kept);
  void (*sum_cells)(const CellLights& cells, const CellNormals& normals, float grazing, const CellLightSums& sums);
  void (*find_cells)(const DirectionRow& row, int32_t directions, int32_t* cells);
  void (*hide_by_lobe)(const GroupLobe& lobe, const PartDirections& parts, int32_t* blocks, float* clear);
};

// `isa` must be resolved. The same bits for each.
const CellKernels& cell_kernels(Isa isa);
const CellKernels& cell_kernels_scalar();

}  // namespace fieldtrace
