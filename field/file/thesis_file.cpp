#include "field/file/thesis_file.h"

#include <openvdb/tools/Dense.h>

#include <algorithm>
#include <filesystem>
#include <vector>

#include "field/file/field_vdb.h"
#include "field/thesis/chart_thesis.hd.h"

namespace fieldtrace {
namespace {

using openvdb::Int32Grid;
// Values in the order of the field's samples, which is that of a dense grid with z fastest.
using DenseSamples = openvdb::tools::Dense<int32_t, openvdb::tools::LayoutZYX>;

constexpr const char *k_distance_grid = "distance", *k_normal_grid = "normal";
constexpr int32_t k_no_normal = k_thesis_normal_zero * 0x010101;
constexpr int k_positions = scalar::k_thesis_positions;

// The voxels of positions [begin, end).
openvdb::CoordBBox box_of(int begin, int end, int m) {
  return {openvdb::Coord(begin, 0, 0), openvdb::Coord(end - 1, m - 1, m - 1)};
}

Int32Grid::Ptr make_grid(const char* name, std::vector<int32_t>& values, const ThesisField& field,
                         const FieldIdentity& identity, int32_t background) {
  const DenseSamples dense(box_of(0, k_positions, field.m()), values.data());
  Int32Grid::Ptr grid = Int32Grid::create(background);
  openvdb::tools::copyFromDense(dense, *grid, 0);
  grid->setName(name);
  write_metadata(*grid, identity, field.ball());
  return grid;
}

// The distances of a file's grid.
ThesisField distances_of(const FieldVdb& what, const std::string& path) {
  require_chart(what.header, k_chart_thesis, path);
  const int m = what.header.identity.parameters.directions;
  ThesisField field(what.header.ball, m, ThesisLayers::distance);
  const Int32Grid::Ptr grid = take_grid(what.grids, k_distance_grid, path);
  if (!grid) return field;  // all samples are misses
  const openvdb::CoordBBox active = grid->evalActiveVoxelBoundingBox();
  bool sound = grid->background() == k_thesis_miss && (active.empty() || box_of(0, k_positions, m).isInside(active));
  constexpr int k_at_once = 64;  // positions
  const size_t row = size_t(m) * size_t(m);
  std::vector<int32_t> values(k_at_once * row);
  for (int begin = 0; sound && begin < k_positions; begin += k_at_once) {
    const int end = std::min(begin + k_at_once, k_positions);
    DenseSamples dense(box_of(begin, end, m), values.data());
    openvdb::tools::copyToDense(*grid, dense);
    uint8_t* to = field.distances_of(uint32_t(begin));
    for (size_t i = 0; i < size_t(end - begin) * row; ++i) {
      sound = sound && values[i] >= 0 && values[i] <= k_thesis_miss;
      to[i] = uint8_t(values[i]);
    }
  }
  if (!sound) throw FieldFileError(path, "has samples that no bake writes");
  return field;
}

}  // namespace

FieldIdentity thesis_identity(const Shape& shape, int m) {
  FieldIdentity identity = field_identity(shape, {.directions = m, .plane = 0, .lines = 0});
  identity.chart = k_chart_thesis;
  return identity;
}

uint64_t save_thesis_field(const ThesisField& field, const FieldIdentity& identity, const std::string& path) {
  openvdb::initialize();
  const ThesisFieldView view = field.view();
  const size_t count = field.samples();
  std::vector<int32_t> values(view.distance, view.distance + count);
  std::vector<Int32Grid::Ptr> grids;
  grids.push_back(make_grid(k_distance_grid, values, field, identity, k_thesis_miss));
  if (field.has_normals()) {
    for (size_t i = 0; i < count; ++i) {
      const uint8_t* n = view.normal + 3 * i;
      values[i] = n[0] | n[1] << 8 | n[2] << 16;
    }
    grids.push_back(make_grid(k_normal_grid, values, field, identity, k_no_normal));
  }
  return write_field_vdb(grids, identity, field.ball(), path);
}

ThesisField load_thesis_field(const FieldIdentity& identity, const std::string& path) {
  const FieldVdb file = read_field_vdb(path);
  if (!(file.header.identity == identity)) throw FieldFileError(path, "has another mesh, chart or other parameters");
  return distances_of(file, path);
}

ThesisFileInfo thesis_file_info(const std::string& path) {
  const FieldVdb file = read_field_vdb(path);
  const ThesisField field = distances_of(file, path);
  ThesisFileInfo info;
  info.header = file.header;
  info.samples = field.samples();
  const uint8_t* distance = field.view().distance;
  info.misses = uint64_t(std::count(distance, distance + field.samples(), uint8_t(k_thesis_miss)));
  std::error_code failed;
  info.bytes_disk = std::filesystem::file_size(path, failed);
  info.bytes_memory = field.bytes();
  info.has_normals = take_grid(file.grids, k_normal_grid, path) != nullptr;
  return info;
}

std::string field_file_chart(const std::string& path) { return read_field_vdb(path).header.identity.chart; }

}  // namespace fieldtrace
