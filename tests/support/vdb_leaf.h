// Leaves of grids, for files made by hand. Thread-safety: pure.
#pragma once

#include "field/grid/vdb_grid.h"

namespace fieldtrace::test {

// A leaf with one active voxel.
inline VdbLeaf leaf_of(int voxel, int32_t value) {
  VdbLeaf leaf;
  leaf.values.fill(0);
  leaf.values[size_t(voxel)] = value;
  leaf.active[size_t(voxel) / 64] = uint64_t(1) << (voxel % 64);
  return leaf;
}

}  // namespace fieldtrace::test
