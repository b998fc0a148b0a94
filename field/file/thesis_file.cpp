#include "field/file/thesis_file.h"

#include <algorithm>
#include <filesystem>
#include <optional>
#include <vector>

#include "field/file/field_vdb.h"
#include "field/thesis/chart_thesis.hd.h"

namespace fieldtrace {
namespace {

constexpr const char *k_distance_grid = "distance", *k_normal_grid = "normal";
constexpr int32_t k_no_normal = k_thesis_normal_zero * 0x010101;
constexpr int k_positions = scalar::k_thesis_positions;

// Calls `visit(voxel, sample)` for every sample of the leaf at `origin`: its number in the leaf, and in the field,
// whose samples have z fastest.
template <class Visit>
void visit_samples(const VoxelCoord& origin, int m, const Visit& visit) {
  for (int i = 0; i < k_vdb_leaf_voxels; ++i) {
    const int x = origin[0] + i / 64, y = origin[1] + i / 8 % 8, z = origin[2] + i % 8;
    if (x < k_positions && y < m && z < m) visit(i, (size_t(x) * size_t(m) + size_t(y)) * size_t(m) + size_t(z));
  }
}

// `value(i)` is that of sample i. Samples that equal the background are inactive.
template <class Value>
VdbGridPtr make_grid(const char* name, int m, int32_t background, const Value& value) {
  VdbGridPtr grid = vdb().create(name, background);
  VoxelCoord origin;
  for (origin[0] = 0; origin[0] < k_positions; origin[0] += k_vdb_leaf_side) {
    for (origin[1] = 0; origin[1] < m; origin[1] += k_vdb_leaf_side) {
      for (origin[2] = 0; origin[2] < m; origin[2] += k_vdb_leaf_side) {
        VdbLeaf leaf;
        int active = 0;
        bool equal = true;
        visit_samples(origin, m, [&](int voxel, size_t sample) {
          const int32_t v = value(sample);
          leaf.values[size_t(voxel)] = v;
          equal = equal && v == leaf.values[0];
          if (v == background) return;
          leaf.active[size_t(voxel) / 64] |= uint64_t(1) << (voxel % 64);
          ++active;
        });
        if (active == k_vdb_leaf_voxels && equal) {
          vdb().add_tile(*grid, origin, leaf.values[0]);
        } else if (active > 0) {
          vdb().add_leaf(*grid, origin, leaf);
        }
      }
    }
  }
  return grid;
}

// Takes samples of a file over.
class SampleTaker {
 public:
  SampleTaker(int m, ThesisField& field) : limit_{k_positions, m, m}, field_(field) {}

  // False if these are none of a field's.
  bool take(const VdbTile& tile) {
    return take_cube(tile.origin, tile.side, [&](int) { return std::optional(tile.value); });
  }
  bool take(const VdbStoredLeaf& leaf, const VdbValues& values) {
    return take_cube(leaf.origin, k_vdb_leaf_side, [&](int voxel) {
      return is_active(leaf.active, voxel) ? std::optional(values[size_t(voxel)]) : std::nullopt;
    });
  }

 private:
  // value(voxel): a sample's, if it is active; voxels are numbered as in a leaf.
  template <class Value>
  bool take_cube(const VoxelCoord& origin, int side, const Value& value) {
    for (int dx = 0; dx < side; ++dx) {
      for (int dy = 0; dy < side; ++dy) {
        for (int dz = 0; dz < side; ++dz) {
          const std::optional<int32_t> v = value(64 * dx + 8 * dy + dz);
          if (v && !take_sample({origin[0] + dx, origin[1] + dy, origin[2] + dz}, *v)) return false;
        }
      }
    }
    return true;
  }
  bool take_sample(const VoxelCoord& at, int32_t value) {
    for (int axis = 0; axis < 3; ++axis) {
      if (at[axis] < 0 || at[axis] >= limit_[axis]) return false;
    }
    if (value < 0 || value > k_thesis_miss) return false;
    field_.distances_of(uint32_t(at[0]))[size_t(at[1]) * size_t(limit_[1]) + size_t(at[2])] = uint8_t(value);
    return true;
  }

  VoxelCoord limit_;
  ThesisField& field_;
};

bool take_all(const VdbStoredGrid& grid, SampleTaker taker) {
  for (const VdbTile& tile : grid.tiles) {
    if (!taker.take(tile)) return false;
  }
  VdbValues values;
  for (const VdbStoredLeaf& leaf : grid.leaves) {
    if (!grid.unpack(leaf, values) || !taker.take(leaf, values)) return false;
  }
  return true;
}

// The distances of a file's grid.
ThesisField distances_of(FieldVdb& what, const std::string& path) {
  require_chart(what.header, k_chart_thesis, path);
  const int m = what.header.identity.parameters.directions;
  ThesisField field(what.header.ball, m, ThesisLayers::distance);
  const std::optional<VdbStoredGrid> grid = take_grid(what, k_distance_grid, path);
  if (!grid) return field;  // all samples are misses
  if (grid->background != k_thesis_miss || !take_all(*grid, SampleTaker(m, field)))
    throw FieldFileError(path, "has samples that no bake writes");
  return field;
}

}  // namespace

FieldIdentity thesis_identity(const Shape& shape, int m) {
  FieldIdentity identity = field_identity(shape, {.directions = m, .plane = 0, .lines = 0});
  identity.chart = k_chart_thesis;
  return identity;
}

uint64_t save_thesis_field(const ThesisField& field, const FieldIdentity& identity, const std::string& path) {
  const ThesisFieldView view = field.view();
  std::vector<VdbGridPtr> grids;
  grids.push_back(
      make_grid(k_distance_grid, field.m(), k_thesis_miss, [&](size_t i) { return int32_t(view.distance[i]); }));
  if (field.has_normals()) {
    grids.push_back(make_grid(k_normal_grid, field.m(), k_no_normal, [&](size_t i) {
      const uint8_t* n = view.normal + 3 * i;
      return n[0] | n[1] << 8 | n[2] << 16;
    }));
  }
  return write_field_vdb(grids, identity, field.ball(), path);
}

ThesisField load_thesis_field(const FieldIdentity& identity, const std::string& path) {
  FieldVdb file = read_field_vdb(path);
  if (!(file.header.identity == identity)) throw FieldFileError(path, "has another mesh, chart or other parameters");
  return distances_of(file, path);
}

ThesisFileInfo thesis_file_info(const std::string& path) {
  FieldVdb file = read_field_vdb(path);
  const ThesisField field = distances_of(file, path);
  ThesisFileInfo info;
  info.header = file.header;
  info.samples = field.samples();
  const uint8_t* distance = field.view().distance;
  info.misses = uint64_t(std::count(distance, distance + field.samples(), uint8_t(k_thesis_miss)));
  std::error_code failed;
  info.bytes_disk = std::filesystem::file_size(path, failed);
  info.bytes_memory = field.bytes();
  info.has_normals = take_grid(file, k_normal_grid, path).has_value();
  return info;
}

std::string field_file_chart(const std::string& path) { return read_field_vdb(path).header.identity.chart; }

}  // namespace fieldtrace
