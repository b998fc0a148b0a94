#include "field/file/coverage_grid.h"

#include <algorithm>
#include <array>
#include <map>
#include <tuple>

namespace fieldtrace {
namespace {

// A leaf holds a patch of 8 x 8 lines of 8 directions in a row; 4 x 4 patches make a tile.
constexpr int k_leaf_side = k_vdb_leaf_side;
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
VoxelCoord patch_origin(int tiles, uint32_t octet, uint32_t tile, int patch) {
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

void write_stack(const Stack& stack, int tiles, const Place& place, VdbGrid& grid) {
  for (int patch = 0; patch < k_patches; ++patch) {
    const VoxelCoord origin = patch_origin(tiles, place.octet, place.tile, patch);
    if (is_empty_patch(stack, patch)) {
      vdb().add_tile(grid, origin, 0);
      continue;
    }
    VdbLeaf leaf;
    for (int layer = 0; layer < k_leaf_side; ++layer) {
      if ((stack.baked >> layer & 1) == 0) continue;
      for (int i = 0; i < k_patch_lines; ++i) {
        leaf.values[size_t(layer * k_patch_lines + i)] = stack.lines[layer][line_of_patch(patch, i)];
      }
      leaf.active[size_t(layer)] = ~uint64_t(0);  // 64 lines are a word
    }
    vdb().add_leaf(grid, origin, leaf);
  }
}

// Whether a leaf holds lines of one direction; then whether all of them are there and in range.
static_assert(k_patch_lines == 64, "a word of the mask is a direction");
bool has_layer(const VdbStoredLeaf& leaf, int layer) { return leaf.active[size_t(layer)] != 0; }
bool sound_layer(const VdbStoredLeaf& leaf, const VdbValues& values, int layer) {
  const int32_t* const lines = values.data() + layer * k_patch_lines;
  const auto sound = [](int32_t line) { return line >= 0 && line <= scalar::k_coverage_depths; };
  return leaf.active[size_t(layer)] == ~uint64_t(0) && std::all_of(lines, lines + k_patch_lines, sound);
}

// The patches found, by tile.
class FoundPatches {
 public:
  FoundPatches(int directions, int lines) : limit_{directions * directions, lines, lines} {}

  bool within(const VoxelCoord& origin) const {
    for (int axis = 0; axis < 3; ++axis) {
      if (origin[axis] < 0 || origin[axis] >= limit_[axis]) return false;
    }
    return true;
  }
  void add(const VoxelCoord& origin, int layer) {
    const int tiles = limit_[1] / scalar::k_tile_lines;
    const int row = origin[1] / k_leaf_side, column = origin[2] / k_leaf_side;
    const uint32_t slot =
        uint32_t(((origin[0] + layer) * tiles + row / k_patches_along) * tiles + column / k_patches_along);
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
  VoxelCoord limit_;
  // In parts of the table, each made when first needed: a small file may stand for millions of empty tiles.
  std::map<uint32_t, std::vector<uint16_t>> found_;
};

}  // namespace

void write_coverage(std::span<const CoverageTiles* const> sources, VdbGrid& grid) {
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
    write_stack(stack, tiles, first, grid);
  }
}

bool CoverageGrid::open(const VdbStoredGrid& grid, int directions, int plane) {
  const int lines = CoverageTiles::lines_for(plane);
  FoundPatches found(directions, lines);
  for (const VdbTile& tile : grid.tiles) {
    if (tile.side != k_leaf_side || tile.value != 0 || !found.within(tile.origin)) return false;
    for (int layer = 0; layer < k_leaf_side; ++layer) found.add(tile.origin, layer);
  }
  std::vector<Patch> patches;
  VdbValues values;
  for (const VdbStoredLeaf& leaf : grid.leaves) {
    if (!found.within(leaf.origin) || !grid.unpack(leaf, values)) return false;
    for (int layer = 0; layer < k_leaf_side; ++layer) {
      if (!has_layer(leaf, layer)) continue;
      if (!sound_layer(leaf, values, layer)) return false;
      found.add(leaf.origin, layer);
    }
    Patch& patch = patches.emplace_back(Patch{leaf.origin, {}});
    std::copy(values.begin(), values.end(), patch.lines.begin());
  }
  std::vector<uint32_t> slots;
  if (!found.take_slots(slots)) return false;
  tiles_ = lines / scalar::k_tile_lines;
  patches_ = std::move(patches);
  slots_ = std::move(slots);
  return true;
}

void CoverageGrid::read(uint32_t slot, std::span<uint16_t> lines) const {
  const Place place = place_of(slot, tiles_);
  for (int p = 0; p < k_patches; ++p) {
    const VoxelCoord origin = patch_origin(tiles_, place.octet, place.tile, p);
    const Patch* const patch = find_by_origin(patches_, origin);
    for (int i = 0; i < k_patch_lines; ++i) {
      lines[line_of_patch(p, i)] = patch ? patch->lines[place.layer * size_t(k_patch_lines) + size_t(i)] : uint16_t(0);
    }
  }
}

}  // namespace fieldtrace
