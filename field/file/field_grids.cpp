#include "field/file/field_grids.h"

#include <algorithm>

namespace fieldtrace {
namespace {

constexpr int k_slices = scalar::k_brick_cells / scalar::k_slice_cells;
constexpr uint32_t k_all_slices = (1u << k_slices) - 1;
static_assert(k_vdb_leaf_voxels == scalar::k_brick_cells, "a leaf holds a brick");

}  // namespace

VoxelCoord brick_origin(const FieldParameters& parameters, uint32_t direction_brick, uint32_t plane_brick) {
  const uint32_t bricks_b = uint32_t(parameters.plane) / 8;
  const int32_t leaf[3] = {int32_t(direction_brick), int32_t(plane_brick / bricks_b), int32_t(plane_brick % bricks_b)};
  return {leaf[0] * k_vdb_leaf_side, leaf[1] * k_vdb_leaf_side, leaf[2] * k_vdb_leaf_side};
}

bool place_of_origin(const FieldParameters& parameters, const VoxelCoord& origin, uint32_t& direction_brick,
                     uint32_t& plane_brick) {
  const int side = parameters.directions / 4;
  const int limit[3] = {side * side, parameters.plane / 4, parameters.plane / 8};
  int leaf[3];
  for (int axis = 0; axis < 3; ++axis) {
    leaf[axis] = origin[axis] / k_vdb_leaf_side;
    if (origin[axis] < 0 || origin[axis] % k_vdb_leaf_side != 0 || leaf[axis] >= limit[axis]) return false;
  }
  direction_brick = uint32_t(leaf[0]);
  plane_brick = uint32_t(leaf[1] * limit[2] + leaf[2]);
  return true;
}

void add_brick(VdbGrid& grid, const VoxelCoord& origin, const BrickCells& cells, uint32_t slices) {
  if (slices == 0) return;
  const bool equal = std::all_of(cells.begin(), cells.end(), [&](int32_t c) { return c == cells[0]; });
  if (slices == k_all_slices && equal) {
    vdb().add_tile(grid, origin, cells[0]);
    return;
  }
  VdbLeaf leaf{cells};
  for (int i = 0; i < scalar::k_brick_cells; ++i) {
    if (slices >> (i / scalar::k_slice_cells) & 1) leaf.active[size_t(i) / 64] |= uint64_t(1) << (i % 64);
  }
  vdb().add_leaf(grid, origin, leaf);
}

bool read_brick(const VdbStoredGrid& grid, const VoxelCoord& origin, BrickCells& cells, uint32_t& slices) {
  const VdbStoredLeaf* const leaf = find_by_origin(grid.leaves, origin);
  if (!leaf) {
    const VdbTile* const tile = find_by_origin(grid.tiles, origin);
    slices = tile ? k_all_slices : 0;
    cells.fill(tile ? tile->value : grid.background);
    return true;
  }
  slices = 0;
  if (!grid.unpack(*leaf, cells)) return false;
  for (int s = 0; s < k_slices; ++s) {
    int active = 0;
    for (int i = s * scalar::k_slice_cells; i < (s + 1) * scalar::k_slice_cells; ++i) {
      active += is_active(leaf->active, i);
    }
    if (active != 0 && active != scalar::k_slice_cells) return false;
    if (active != 0) slices |= 1u << s;
  }
  return true;
}

bool brick_origins(const VdbStoredGrid& grid, std::vector<VoxelCoord>& origins) {
  origins.clear();
  const VdbMask none_active = {};
  for (const VdbStoredLeaf& leaf : grid.leaves) {
    if (leaf.active != none_active) origins.push_back(leaf.origin);
  }
  for (const VdbTile& tile : grid.tiles) {
    if (tile.side != k_vdb_leaf_side) return false;
    origins.push_back(tile.origin);
  }
  return true;
}

}  // namespace fieldtrace
