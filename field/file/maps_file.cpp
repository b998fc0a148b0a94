#include "field/file/maps_file.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <filesystem>
#include <optional>
#include <vector>

#include "core/platform/parallel.h"
#include "field/file/field_vdb.h"

namespace fieldtrace {
namespace {

constexpr const char* k_depth_grid = "depth";
constexpr const char* k_not_of_a_bake = "has depths that no bake writes";

using DepthRow = std::array<uint16_t, k_vdb_leaf_side>;

MapSize size_of(const FieldIdentity& identity) { return {identity.parameters.directions, identity.parameters.plane}; }

// Whether the leaf lies within the maps.
bool is_within(const VdbStoredLeaf& leaf, const MapSize& size) {
  const VoxelCoord limit = {int32_t(size.maps()), size.texels, size.texels};
  for (int axis = 0; axis < 3; ++axis) {
    if (leaf.origin[axis] < 0 || leaf.origin[axis] >= limit[axis]) return false;
  }
  return true;
}

// The file's depths; nothing if all lines miss. What no line meets is inactive, so there are leaves alone.
std::optional<VdbStoredGrid> depth_grid(FieldVdb& file, const std::string& path) {
  require_chart(file.header, k_chart_maps, path);
  std::optional<VdbStoredGrid> depths = take_grid(file, k_depth_grid, path);
  if (!depths) return depths;
  const MapSize size = size_of(file.header.identity);
  const bool sound = depths->background == 0 && depths->tiles.empty() &&
                     std::all_of(depths->leaves.begin(), depths->leaves.end(),
                                 [&](const VdbStoredLeaf& leaf) { return is_within(leaf, size); });
  if (!sound) throw FieldFileError(path, k_not_of_a_bake);
  return depths;
}

// Visits the 64 texels of each of the leaf's directions, row by row, with their depths; 0: a miss. False if some
// are none.
template <class Visit>
bool visit_rows(const VdbStoredGrid& depths, const VdbStoredLeaf& leaf, const Visit& visit) {
  VdbValues values;
  if (!depths.unpack(leaf, values)) return false;
  uint32_t wrong = 0;
  for (int x = 0; x < k_vdb_leaf_side; ++x) {
    const uint64_t active = leaf.active[size_t(x)];
    if (active == 0) continue;
    for (int y = 0; y < k_vdb_leaf_side; ++y) {
      DepthRow row;
      for (int z = 0; z < k_vdb_leaf_side; ++z) {
        const uint32_t is_hit = active >> (8 * y + z) & 1;
        const uint32_t value = uint32_t(values[size_t(64 * x + 8 * y + z)]) & (0 - is_hit);
        wrong |= value >> 16 | (is_hit & uint32_t(value == 0));
        row[size_t(z)] = uint16_t(value);
      }
      visit(leaf.origin[0] + x, leaf.origin[1] + y, row);
    }
  }
  return wrong == 0;
}

// Visits the rows of all leaves in parallel. Throws FieldFileError for what is no depth.
template <class Visit>
void visit_depths(const std::optional<VdbStoredGrid>& depths, const std::string& path, const Visit& visit) {
  if (!depths) return;
  std::atomic<bool> sound = true;
  const std::vector<VdbStoredLeaf>& leaves = depths->leaves;
  parallel_for_parts(leaves.size(), [&](size_t first, size_t end) {
    for (size_t i = first; i < end; ++i) {
      const VdbStoredLeaf& leaf = leaves[i];
      if (!visit_rows(*depths, leaf, [&](int x, int y, const DepthRow& row) { visit(x, y, leaf.origin[2], row); })) {
        sound = false;
      }
    }
  });
  if (!sound) throw FieldFileError(path, k_not_of_a_bake);
}

VdbGridPtr make_grid(const DirectionMaps& maps) {
  const MapSize size = maps.size();
  VdbGridPtr grid = vdb().create(k_depth_grid, 0);
  VdbLeaf leaf;
  VoxelCoord origin;
  for (origin[0] = 0; origin[0] < int32_t(size.maps()); origin[0] += k_vdb_leaf_side) {
    for (origin[1] = 0; origin[1] < size.texels; origin[1] += k_vdb_leaf_side) {
      for (origin[2] = 0; origin[2] < size.texels; origin[2] += k_vdb_leaf_side) {
        uint64_t any = 0;
        for (int x = 0; x < k_vdb_leaf_side; ++x) {
          const uint16_t* const depths = maps.depths(origin[0] + x) + origin[1] * size.texels + origin[2];
          uint64_t active = 0;
          for (int i = 0; i < 64; ++i) {
            const uint16_t depth = depths[i / 8 * size.texels + i % 8];
            leaf.values[size_t(64 * x + i)] = depth;
            active |= uint64_t(depth != 0) << i;
          }
          leaf.active[size_t(x)] = active;
          any |= active;
        }
        if (any) vdb().add_leaf(*grid, origin, leaf);
      }
    }
  }
  return grid;
}

}  // namespace

FieldIdentity maps_identity(const Shape& shape, const DMat3& stretch, const MapSize& size) {
  FieldIdentity identity = field_identity(shape, {.directions = size.directions, .plane = size.texels, .lines = 0});
  if (stretch != DMat3(1.0)) {
    Hasher hasher;
    hasher.add_value(identity.geometry.high);
    hasher.add_value(identity.geometry.low);
    for (int i = 0; i < 9; ++i) hasher.add_value(stretch[i / 3][i % 3]);
    identity.geometry = hasher.result();
  }
  identity.chart = k_chart_maps;
  return identity;
}

uint64_t save_direction_maps(const DirectionMaps& maps, const FieldIdentity& identity, const std::string& path) {
  std::vector<VdbGridPtr> grids;
  grids.push_back(make_grid(maps));
  return write_field_vdb(grids, identity, maps.ball(), path);
}

DirectionMaps load_direction_maps(const FieldIdentity& identity, const Sphere& ball, const std::string& path) {
  FieldVdb file = read_field_vdb(path);
  const Sphere& held = file.header.ball;
  if (!(file.header.identity == identity) || held.centre != ball.centre || held.radius != ball.radius) {
    throw FieldFileError(path, "has another mesh, chart or other parameters");
  }
  const std::optional<VdbStoredGrid> depths = depth_grid(file, path);
  DirectionMaps maps(ball, size_of(identity));
  const int texels = maps.size().texels;
  visit_depths(depths, path, [&](int direction, int y, int x, const DepthRow& row) {
    std::copy(row.begin(), row.end(), maps.depths(direction) + y * texels + x);
  });
  parallel_for(size_t(maps.size().maps()), [&](size_t direction) { maps.finish(int(direction)); });
  return maps;
}

MapsFileInfo maps_file_info(const std::string& path) {
  FieldVdb file = read_field_vdb(path);
  const std::optional<VdbStoredGrid> depths = depth_grid(file, path);
  MapsFileInfo info;
  info.header = file.header;
  info.size = size_of(file.header.identity);
  visit_depths(depths, path, [](int, int, int, const DepthRow&) {});
  if (depths) {
    for (const VdbStoredLeaf& leaf : depths->leaves) {
      for (const uint64_t word : leaf.active) info.hits += uint64_t(std::popcount(word));
    }
  }
  std::error_code failed;
  info.bytes_disk = std::filesystem::file_size(path, failed);
  info.bytes_memory = DirectionMaps::bytes_of(info.size);
  return info;
}

}  // namespace fieldtrace
