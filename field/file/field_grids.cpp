#include "field/file/field_grids.h"

#include <algorithm>

namespace fieldtrace {
namespace {

using Leaf = openvdb::Int32Tree::LeafNodeType;

constexpr int k_slices = scalar::k_brick_cells / scalar::k_slice_cells;
constexpr uint32_t k_all_slices = (1u << k_slices) - 1;
constexpr int k_leaf_side = int(Leaf::DIM);
static_assert(Leaf::SIZE == scalar::k_brick_cells, "a leaf holds a brick");
// The node above the leaves, whose tiles have the size of a leaf.
constexpr openvdb::Index k_tile_level = 1;

}  // namespace

openvdb::Coord brick_origin(const FieldParameters& parameters, uint32_t direction_brick, uint32_t plane_brick) {
  const uint32_t bricks_b = uint32_t(parameters.plane) / 8;
  const openvdb::Coord leaf(int32_t(direction_brick), int32_t(plane_brick / bricks_b), int32_t(plane_brick % bricks_b));
  return {leaf.x() * k_leaf_side, leaf.y() * k_leaf_side, leaf.z() * k_leaf_side};
}

bool place_of_origin(const FieldParameters& parameters, const openvdb::Coord& origin, uint32_t& direction_brick,
                     uint32_t& plane_brick) {
  const int side = parameters.directions / 4;
  const int limit[3] = {side * side, parameters.plane / 4, parameters.plane / 8};
  int leaf[3];
  for (int axis = 0; axis < 3; ++axis) {
    leaf[axis] = origin[axis] / k_leaf_side;
    if (origin[axis] < 0 || origin[axis] % k_leaf_side != 0 || leaf[axis] >= limit[axis]) return false;
  }
  direction_brick = uint32_t(leaf[0]);
  plane_brick = uint32_t(leaf[1] * limit[2] + leaf[2]);
  return true;
}

void add_brick(openvdb::Int32Grid& grid, const openvdb::Coord& origin, const BrickCells& cells, uint32_t slices) {
  if (slices == 0) return;
  const bool equal = std::all_of(cells.begin(), cells.end(), [&](int32_t c) { return c == cells[0]; });
  if (slices == k_all_slices && equal) {
    grid.tree().addTile(k_tile_level, origin, cells[0], true);
    return;
  }
  Leaf* leaf = grid.tree().touchLeaf(origin);
  for (int i = 0; i < scalar::k_brick_cells; ++i) {
    if (slices >> (i / scalar::k_slice_cells) & 1) leaf->setValueOn(openvdb::Index(i), cells[size_t(i)]);
  }
}

bool read_brick(const openvdb::Int32Grid::ConstAccessor& grid, const openvdb::Coord& origin, BrickCells& cells,
                uint32_t& slices) {
  const Leaf* leaf = grid.probeConstLeaf(origin);
  if (!leaf) {
    int32_t value = 0;
    slices = grid.probeValue(origin, value) ? k_all_slices : 0;
    cells.fill(value);
    return true;
  }
  slices = 0;
  std::copy_n(leaf->buffer().data(), scalar::k_brick_cells, cells.begin());
  for (int s = 0; s < k_slices; ++s) {
    int active = 0;
    for (int i = s * scalar::k_slice_cells; i < (s + 1) * scalar::k_slice_cells; ++i) {
      active += leaf->isValueOn(openvdb::Index(i));
    }
    if (active != 0 && active != scalar::k_slice_cells) return false;
    if (active != 0) slices |= 1u << s;
  }
  return true;
}

bool brick_origins(const openvdb::Int32Grid& grid, std::vector<openvdb::Coord>& origins) {
  origins.clear();
  for (auto leaf = grid.tree().cbeginLeaf(); leaf; ++leaf) {
    if (!leaf->isEmpty()) origins.push_back(leaf->origin());
  }
  auto tile = grid.tree().cbeginValueOn();
  tile.setMaxDepth(decltype(tile)::LEAF_DEPTH - 1);
  for (; tile; ++tile) {
    openvdb::CoordBBox box;
    tile.getBoundingBox(box);
    if (box.dim() != openvdb::Coord(k_leaf_side)) return false;
    origins.push_back(box.min());
  }
  std::sort(origins.begin(), origins.end());
  return true;
}

}  // namespace fieldtrace
