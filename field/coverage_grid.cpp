#include "field/coverage_grid.h"

#include <algorithm>
#include <map>

namespace fieldtrace {
namespace {

using Leaf = openvdb::Int32Tree::LeafNodeType;
constexpr int k_leaf_side = int(Leaf::DIM);
constexpr int k_leaves_per_tile = scalar::k_tile_lines / k_leaf_side;
constexpr uint32_t k_all_parts = (1u << (k_leaves_per_tile * k_leaves_per_tile)) - 1;

// A tile being put together from the parts that its leaves hold.
struct Parts {
  uint32_t found = 0;
  TileLines lines = TileLines(CoverageTiles::k_lines_per_tile);
};

// One direction of a leaf: all of its 8 x 8 lines, or none. False if only some are there, or they are no lines.
bool read_part(const Leaf& leaf, int layer, int x0, int y0, uint32_t part, Parts& parts) {
  int active = 0;
  for (int y = 0; y < k_leaf_side; ++y) {
    for (int x = 0; x < k_leaf_side; ++x) {
      const openvdb::Index i = openvdb::Index((layer * k_leaf_side + y) * k_leaf_side + x);
      if (!leaf.isValueOn(i)) continue;
      const int32_t line = leaf.getValue(i);
      if (line < 0 || line > scalar::k_coverage_depths) return false;
      parts.lines[size_t((y0 + y) * scalar::k_tile_lines + x0 + x)] = uint16_t(line);
      ++active;
    }
  }
  parts.found |= 1u << part;
  return active == k_leaf_side * k_leaf_side;
}

bool has_layer(const Leaf& leaf, int layer) {
  const openvdb::Index begin = openvdb::Index(layer * k_leaf_side * k_leaf_side);
  for (openvdb::Index i = 0; i < openvdb::Index(k_leaf_side * k_leaf_side); ++i) {
    if (leaf.isValueOn(begin + i)) return true;
  }
  return false;
}

}  // namespace

void write_coverage(std::span<const CoverageTiles* const> sources, openvdb::Int32Grid& grid) {
  TileLines lines(CoverageTiles::k_lines_per_tile);
  std::vector<std::pair<uint32_t, size_t>> tiles;  // slot, source
  for (size_t s = 0; s < sources.size(); ++s) {
    for (const uint32_t slot : sources[s]->baked()) tiles.push_back({slot, s});
  }
  std::sort(tiles.begin(), tiles.end());
  auto grid_at = grid.getAccessor();
  for (size_t i = 0; i < tiles.size(); ++i) {
    if (i > 0 && tiles[i].first == tiles[i - 1].first) continue;
    const CoverageTiles& source = *sources[tiles[i].second];
    const CoverageTiles::Place place = source.place(tiles[i].first);
    source.read(tiles[i].first, lines);
    for (int y = 0; y < scalar::k_tile_lines; ++y) {
      for (int x = 0; x < scalar::k_tile_lines; ++x) {
        grid_at.setValueOn({int32_t(place.direction), place.y + y, place.x + x},
                           lines[size_t(y * scalar::k_tile_lines + x)]);
      }
    }
  }
}

bool read_coverage(const openvdb::Int32Grid& grid, int directions, int plane, CoverageData& data) {
  const int lines = CoverageTiles::lines_for(plane), tiles_along = lines / scalar::k_tile_lines;
  std::map<uint32_t, Parts> tiles;
  for (auto leaf = grid.tree().cbeginLeaf(); leaf; ++leaf) {
    const openvdb::Coord origin = leaf->origin();
    const int limit[3] = {directions * directions, lines, lines};
    for (int axis = 0; axis < 3; ++axis) {
      if (origin[axis] < 0 || origin[axis] >= limit[axis]) return false;
    }
    const int tile_y = origin.y() / scalar::k_tile_lines, tile_x = origin.z() / scalar::k_tile_lines;
    const int y0 = origin.y() % scalar::k_tile_lines, x0 = origin.z() % scalar::k_tile_lines;
    const uint32_t part = uint32_t(y0 / k_leaf_side * k_leaves_per_tile + x0 / k_leaf_side);
    for (int layer = 0; layer < k_leaf_side; ++layer) {
      if (!has_layer(*leaf, layer)) continue;
      const uint32_t slot = uint32_t(((origin.x() + layer) * tiles_along + tile_y) * tiles_along + tile_x);
      if (!read_part(*leaf, layer, x0, y0, part, tiles[slot])) return false;
    }
  }
  if (grid.tree().activeTileCount() != 0) return false;
  data.slots.clear();
  data.lines.clear();
  for (const auto& [slot, parts] : tiles) {
    if (parts.found != k_all_parts) return false;
    data.slots.push_back(slot);
    data.lines.insert(data.lines.end(), parts.lines.begin(), parts.lines.end());
  }
  return true;
}

}  // namespace fieldtrace
