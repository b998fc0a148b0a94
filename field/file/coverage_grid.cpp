#include "field/file/coverage_grid.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <map>
#include <new>
#include <tuple>

#include "core/platform/machine_memory.h"
#include "core/platform/parallel.h"

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

// Whether a leaf holds lines of one direction; then whether all of them are there.
static_assert(k_patch_lines == 64, "a word of the mask is a direction");
bool has_layer(const VdbStoredLeaf& leaf, int layer) { return leaf.active[size_t(layer)] != 0; }
bool whole_layer(const VdbStoredLeaf& leaf, int layer) { return leaf.active[size_t(layer)] == ~uint64_t(0); }

// Where a patch lies: its tile in one of eight directions, and its number there.
struct PatchPlace {
  uint32_t slot;
  int patch;
};

PatchPlace place_of_patch(const VoxelCoord& origin, int layer, int tiles) {
  const int row = origin[1] / k_leaf_side, column = origin[2] / k_leaf_side;
  return {uint32_t(((origin[0] + layer) * tiles + row / k_patches_along) * tiles + column / k_patches_along),
          row % k_patches_along * k_patches_along + column % k_patches_along};
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
  void add(const VoxelCoord& origin, int layer, bool has_lines) {
    const PatchPlace at = place_of_patch(origin, layer, limit_[1] / scalar::k_tile_lines);
    std::vector<Found>& part = found_[at.slot / CoverageTiles::k_part_slots];
    part.resize(CoverageTiles::k_part_slots);
    Found& found = part[at.slot % CoverageTiles::k_part_slots];
    found.patches |= uint16_t(1u << at.patch);
    found.has_lines |= has_lines;
  }
  // The tiles, ascending, and those of them with lines. False if one is not whole.
  bool take_slots(std::vector<uint32_t>& slots, std::vector<uint32_t>& held) const {
    for (const auto& [number, part] : found_) {
      for (uint32_t i = 0; i < CoverageTiles::k_part_slots; ++i) {
        if (part[i].patches == 0) continue;
        if (part[i].patches != k_all_patches) return false;
        slots.push_back(number * CoverageTiles::k_part_slots + i);
        if (part[i].has_lines) held.push_back(slots.back());
      }
    }
    return true;
  }

 private:
  struct Found {
    uint16_t patches = 0;
    bool has_lines = false;
  };
  VoxelCoord limit_;
  // In parts of the table, each made when first needed: a small file may stand for millions of empty tiles.
  std::map<uint32_t, std::vector<Found>> found_;
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
  const int side = CoverageTiles::lines_for(plane), tiles = side / scalar::k_tile_lines;
  FoundPatches found(directions, side);
  for (const VdbTile& tile : grid.tiles) {
    if (tile.side != k_leaf_side || tile.value != 0 || !found.within(tile.origin)) return false;
    for (int layer = 0; layer < k_leaf_side; ++layer) found.add(tile.origin, layer, false);
  }
  for (const VdbStoredLeaf& leaf : grid.leaves) {
    if (!found.within(leaf.origin)) return false;
    for (int layer = 0; layer < k_leaf_side; ++layer) {
      if (!has_layer(leaf, layer)) continue;
      if (!whole_layer(leaf, layer)) return false;
      found.add(leaf.origin, layer, true);
    }
  }
  std::vector<uint32_t> slots, held;
  if (!found.take_slots(slots, held)) return false;

  // A made-up file may stand for more than it holds.
  if (held.size() > machine_memory_bytes() / 2 / (CoverageTiles::k_lines_per_tile * sizeof(uint16_t)))
    throw std::bad_alloc();
  ZeroedVector<uint16_t> lines(held.size() * CoverageTiles::k_lines_per_tile);
  std::atomic<bool> is_sound = true;
  // No two leaves have one origin: what reads grids sees to that.
  parallel_for_parts(grid.leaves.size(), [&](size_t first, size_t end) {
    VdbValues values;
    for (size_t l = first; l < end && is_sound; ++l) {
      const VdbStoredLeaf& leaf = grid.leaves[l];
      bool sound = grid.unpack(leaf, values);
      for (int layer = 0; sound && layer < k_leaf_side; ++layer) {
        if (!has_layer(leaf, layer)) continue;
        const PatchPlace at = place_of_patch(leaf.origin, layer, tiles);
        const size_t tile = size_t(std::lower_bound(held.begin(), held.end(), at.slot) - held.begin());
        uint16_t* const target = &lines[tile * CoverageTiles::k_lines_per_tile + patch_start(at.patch)];
        for (int i = 0; i < k_patch_lines; ++i) {
          const int32_t line = values[size_t(layer * k_patch_lines + i)];
          sound = sound && line >= 0 && line <= scalar::k_coverage_depths;
          target[i / k_leaf_side * scalar::k_tile_lines + i % k_leaf_side] = uint16_t(line);
        }
      }
      if (!sound) is_sound = false;
    }
  });
  if (!is_sound) return false;
  slots_ = std::move(slots);
  held_ = std::move(held);
  lines_ = std::move(lines);
  return true;
}

std::span<const uint16_t> CoverageGrid::lines(uint32_t slot) const {
  static const std::array<uint16_t, CoverageTiles::k_lines_per_tile> misses = {};
  const auto held = std::lower_bound(held_.begin(), held_.end(), slot);
  if (held == held_.end() || *held != slot) return misses;
  return std::span(lines_).subspan(size_t(held - held_.begin()) * CoverageTiles::k_lines_per_tile,
                                   CoverageTiles::k_lines_per_tile);
}

}  // namespace fieldtrace
