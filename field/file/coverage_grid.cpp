#include "field/file/coverage_grid.h"

#include <algorithm>
#include <array>
#include <map>
#include <tuple>

namespace fieldtrace {
namespace {

using Leaf = openvdb::Int32Tree::LeafNodeType;
using openvdb::Coord;

// A leaf holds a patch of 8 x 8 lines of 8 directions in a row; 4 x 4 patches make a tile.
constexpr int k_leaf_side = int(Leaf::DIM);
constexpr int k_patch_lines = k_leaf_side * k_leaf_side;
constexpr int k_patches_along = scalar::k_tile_lines / k_leaf_side;
constexpr int k_patches = k_patches_along * k_patches_along;
constexpr uint32_t k_all_patches = (1u << k_patches) - 1;

// First line of a patch within its tile.
size_t patch_start(int patch) {
  return size_t(patch / k_patches_along * k_leaf_side * scalar::k_tile_lines + patch % k_patches_along * k_leaf_side);
}

// Line `i` of a patch, within the tile.
size_t line_of_patch(int patch, int i) {
  return patch_start(patch) + size_t(i / k_leaf_side * scalar::k_tile_lines + i % k_leaf_side);
}

// The voxel nearest to the origin of the leaf that holds a patch of tile `tile`, for the eight directions from 8 *
// octet on.
Coord patch_origin(int tiles, uint32_t octet, uint32_t tile, int patch) {
  const int y = int(tile) / tiles * scalar::k_tile_lines + patch / k_patches_along * k_leaf_side;
  const int x = int(tile) % tiles * scalar::k_tile_lines + patch % k_patches_along * k_leaf_side;
  return {int(octet) * k_leaf_side, y, x};
}

struct Place {
  uint32_t octet = 0, tile = 0, layer = 0;
  bool operator<(const Place& o) const { return std::tie(octet, tile, layer) < std::tie(o.octet, o.tile, o.layer); }
};

Place place_of(uint32_t slot, int tiles) {
  const uint32_t per_plane = uint32_t(tiles * tiles), direction = slot / per_plane;
  return {direction / k_leaf_side, slot % per_plane, direction % k_leaf_side};
}

// The tiles that share leaves: those at one place of the plane, of eight directions.
struct Stack {
  uint32_t baked = 0;  // one bit per direction
  std::array<TileLines, k_leaf_side> lines;
};

bool is_empty_patch(const Stack& stack, int patch) {
  if (stack.baked != (1u << k_leaf_side) - 1) return false;
  for (const TileLines& lines : stack.lines) {
    for (int i = 0; i < k_patch_lines; ++i) {
      if (lines[line_of_patch(patch, i)] != 0) return false;
    }
  }
  return true;
}

void write_stack(const Stack& stack, int tiles, const Place& place, openvdb::Int32Tree& tree) {
  for (int patch = 0; patch < k_patches; ++patch) {
    const Coord origin = patch_origin(tiles, place.octet, place.tile, patch);
    if (is_empty_patch(stack, patch)) {
      tree.addTile(/*level=*/1, origin, 0, /*active=*/true);
      continue;
    }
    Leaf* const leaf = tree.touchLeaf(origin);
    for (int layer = 0; layer < k_leaf_side; ++layer) {
      if ((stack.baked >> layer & 1) == 0) continue;
      for (int i = 0; i < k_patch_lines; ++i) {
        leaf->setValueOn(openvdb::Index(layer * k_patch_lines + i), stack.lines[layer][line_of_patch(patch, i)]);
      }
    }
  }
}

// Whether a leaf holds lines of one direction; then whether all of them are there and in range.
bool has_layer(const Leaf& leaf, int layer) {
  for (int i = 0; i < k_patch_lines; ++i) {
    if (leaf.isValueOn(openvdb::Index(layer * k_patch_lines + i))) return true;
  }
  return false;
}
bool sound_layer(const Leaf& leaf, int layer) {
  for (int i = 0; i < k_patch_lines; ++i) {
    const openvdb::Index at = openvdb::Index(layer * k_patch_lines + i);
    const int32_t line = leaf.getValue(at);
    if (!leaf.isValueOn(at) || line < 0 || line > scalar::k_coverage_depths) return false;
  }
  return true;
}

// The patches found, by tile.
class FoundPatches {
 public:
  FoundPatches(int directions, int lines) : limit_(directions * directions, lines, lines) {}

  bool within(const Coord& origin) const {
    for (int axis = 0; axis < 3; ++axis) {
      if (origin[axis] < 0 || origin[axis] >= limit_[axis]) return false;
    }
    return true;
  }
  void add(const Coord& origin, int layer) {
    const int tiles = limit_[1] / scalar::k_tile_lines;
    const int row = origin.y() / k_leaf_side, column = origin.z() / k_leaf_side;
    const uint32_t slot =
        uint32_t(((origin.x() + layer) * tiles + row / k_patches_along) * tiles + column / k_patches_along);
    std::vector<uint16_t>& part = found_[slot / CoverageTiles::k_part_slots];
    part.resize(CoverageTiles::k_part_slots);
    part[slot % CoverageTiles::k_part_slots] |=
        uint16_t(1u << (row % k_patches_along * k_patches_along + column % k_patches_along));
  }
  bool take_slots(std::vector<uint32_t>& slots) const {
    for (const auto& [number, part] : found_) {
      for (uint32_t i = 0; i < CoverageTiles::k_part_slots; ++i) {
        if (part[i] == 0) continue;
        if (part[i] != k_all_patches) return false;
        slots.push_back(number * CoverageTiles::k_part_slots + i);
      }
    }
    return true;
  }

 private:
  Coord limit_;
  // In parts of the table, each made when first needed: a small file may stand for millions of empty tiles.
  std::map<uint32_t, std::vector<uint16_t>> found_;
};

}  // namespace

void write_coverage(std::span<const CoverageTiles* const> sources, openvdb::Int32Grid& grid) {
  if (sources.empty()) return;
  const int tiles = sources.front()->view().tiles;
  struct Source {
    Place place;
    const CoverageTiles* tiles;
    uint32_t slot;
  };
  std::vector<Source> all;
  for (const CoverageTiles* source : sources) {
    for (const uint32_t slot : source->baked()) all.push_back({place_of(slot, tiles), source, slot});
  }
  std::stable_sort(all.begin(), all.end(), [](const Source& a, const Source& b) { return a.place < b.place; });
  Stack stack;
  for (TileLines& lines : stack.lines) lines.resize(CoverageTiles::k_lines_per_tile);
  for (size_t i = 0; i < all.size();) {
    const Place first = all[i].place;
    stack.baked = 0;
    for (; i < all.size() && all[i].place.octet == first.octet && all[i].place.tile == first.tile; ++i) {
      const uint32_t layer = all[i].place.layer;
      if (stack.baked >> layer & 1) continue;
      stack.baked |= 1u << layer;
      all[i].tiles->read(all[i].slot, stack.lines[layer]);
    }
    write_stack(stack, tiles, first, grid.tree());
  }
}

bool CoverageGrid::open(const openvdb::Int32Grid::ConstPtr& grid, int directions, int plane) {
  const int lines = CoverageTiles::lines_for(plane);
  FoundPatches found(directions, lines);
  for (auto leaf = grid->tree().cbeginLeaf(); leaf; ++leaf) {
    const Coord origin = leaf->origin();
    if (!found.within(origin)) return false;
    for (int layer = 0; layer < k_leaf_side; ++layer) {
      if (!has_layer(*leaf, layer)) continue;
      if (!sound_layer(*leaf, layer)) return false;
      found.add(origin, layer);
    }
  }
  auto value = grid->cbeginValueOn();
  value.setMaxDepth(openvdb::Int32Tree::ValueOnCIter::LEAF_DEPTH - 1);
  for (; value; ++value) {
    openvdb::CoordBBox box;
    value.getBoundingBox(box);
    if (box.dim() != Coord(k_leaf_side) || *value != 0 || !found.within(box.min())) return false;
    for (int layer = 0; layer < k_leaf_side; ++layer) found.add(box.min(), layer);
  }
  std::vector<uint32_t> slots;
  if (!found.take_slots(slots)) return false;
  grid_ = grid;
  tiles_ = lines / scalar::k_tile_lines;
  slots_ = std::move(slots);
  return true;
}

void CoverageGrid::read(uint32_t slot, std::span<uint16_t> lines) const {
  const Place place = place_of(slot, tiles_);
  for (int patch = 0; patch < k_patches; ++patch) {
    const Leaf* const leaf = grid_->tree().probeConstLeaf(patch_origin(tiles_, place.octet, place.tile, patch));
    for (int i = 0; i < k_patch_lines; ++i) {
      lines[line_of_patch(patch, i)] =
          leaf ? uint16_t(leaf->getValue(openvdb::Index(int(place.layer) * k_patch_lines + i))) : uint16_t(0);
    }
  }
}

}  // namespace fieldtrace
