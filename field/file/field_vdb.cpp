#include "field/file/field_vdb.h"

#include <cmath>
#include <filesystem>
#include <memory>
#include <utility>

#include "core/io/atomic_file.h"
#include "field/file/field_trailer.h"
#include "field/grid/plain_vdb.h"
#include "field/maps/direction_maps.h"
#include "field/thesis/thesis_field.h"

namespace fieldtrace {
namespace {

// The orthographic chart's cell layers and coverage; the thesis' chart has two, direction maps one.
constexpr int k_most_grids = 5;

template <class T>
T metadata_value(const VdbMetadata& map, const std::string& path, const char* name) {
  const auto found = map.find(name);
  const T* const entry = found == map.end() ? nullptr : std::get_if<T>(&found->second);
  if (!entry) throw FieldFileError(path, std::string("has no ") + name + " of a field");
  return *entry;
}

bool valid_for_chart(const FieldIdentity& i) {
  const FieldParameters& p = i.parameters;
  if (i.chart == k_chart_orthographic) return valid_parameters(p);
  if (i.chart == k_chart_thesis) return valid_thesis_parameters(p);
  return i.chart == k_chart_maps && valid_map_size({p.directions, p.plane}) && p.lines == 0;
}

FieldFileHeader read_metadata(const VdbMetadata& map, const std::string& path) {
  FieldFileHeader h;
  FieldIdentity& i = h.identity;
  i.format_version = metadata_value<int32_t>(map, path, "fieldtrace_format");
  if (i.format_version != k_field_format_version) {
    throw FieldFileError(path, other_format(i.format_version));
  }
  i.chart = metadata_value<std::string>(map, path, "chart");
  i.parameters.directions = metadata_value<int32_t>(map, path, "directions");
  i.parameters.plane = metadata_value<int32_t>(map, path, "plane");
  i.parameters.lines = metadata_value<int32_t>(map, path, "lines");
  const auto centre = metadata_value<std::array<float, 3>>(map, path, "centre");
  h.ball.centre = {centre[0], centre[1], centre[2]};
  h.ball.radius = metadata_value<float>(map, path, "radius");
  const int64_t primitives = metadata_value<int64_t>(map, path, "primitive_count");
  i.primitive_count = uint32_t(primitives);
  const bool finite = std::isfinite(h.ball.centre.x) && std::isfinite(h.ball.centre.y) &&
                      std::isfinite(h.ball.centre.z) && std::isfinite(h.ball.radius);
  bool sound = finite && h.ball.radius > 0.0f && primitives == int64_t(i.primitive_count);
  sound = sound && parse_hash(metadata_value<std::string>(map, path, "mesh_hash"), i.geometry);
  sound = sound && valid_for_chart(i);
  if (!sound) throw FieldFileError(path, "has metadata that no field of this program has");
  return h;
}

VdbMetadata metadata_of(const FieldIdentity& identity, const Sphere& ball) {
  return {{"fieldtrace_format", int32_t(identity.format_version)},
          {"chart", identity.chart},
          {"directions", int32_t(identity.parameters.directions)},
          {"plane", int32_t(identity.parameters.plane)},
          {"lines", int32_t(identity.parameters.lines)},
          {"centre", std::array<float, 3>{ball.centre.x, ball.centre.y, ball.centre.z}},
          {"radius", ball.radius},
          {"mesh_hash", identity.geometry.hex()},
          {"primitive_count", int64_t(identity.primitive_count)}};
}

}  // namespace

FieldVdb read_field_vdb(const std::string& path) {
  const auto contents = std::make_shared<std::string>(read_checked(path));
  try {
    std::optional<VdbFile> file = read_plain_vdb(contents, k_most_grids);
    if (!file) file = vdb().read(std::move(*contents), k_most_grids);
    return {read_metadata(file->metadata, path), std::move(file->grids)};
  } catch (const Error&) {
    throw;
  } catch (const std::bad_alloc&) {
    throw;  // says nothing about the file
  } catch (const std::exception& e) {
    throw FieldFileError(path, std::string("is not a field that OpenVDB can read (") + e.what() + ")");
  }
}

void require_chart(const FieldFileHeader& header, const char* chart, const std::string& path) {
  if (header.identity.chart == chart) return;
  throw FieldFileError(path, "is a field of the chart " + header.identity.chart + ", not " + chart);
}

std::optional<VdbStoredGrid> take_grid(FieldVdb& file, const char* name, const std::string& path) {
  std::optional<VdbStoredGrid> found;
  for (VdbStoredGrid& grid : file.grids) {
    if (grid.name != name) continue;
    if (found) throw FieldFileError(path, std::string("has two grids named ") + name);
    found = std::exchange(grid, {});
  }
  return found;
}

uint64_t write_field_vdb(std::span<const VdbGridPtr> grids, const FieldIdentity& identity, const Sphere& ball,
                         const std::string& path) {
  AtomicFile file(path);
  std::vector<const VdbGrid*> written;
  for (const VdbGridPtr& grid : grids) written.push_back(grid.get());
  try {
    vdb().write(file.temporary_path(), written, metadata_of(identity, ball));
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception& e) {
    throw Error({path}, std::string("cannot be written: ") + e.what());
  }
  append_trailer(file.temporary_path(), path);
  file.commit();
  return std::filesystem::file_size(path);
}

}  // namespace fieldtrace
