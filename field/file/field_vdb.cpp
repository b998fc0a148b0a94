#include "field/file/field_vdb.h"

#include <cmath>
#include <filesystem>

#include "core/io/atomic_file.h"
#include "field/file/field_trailer.h"
#include "field/file/vdb_archive.h"
#include "field/thesis/thesis_field.h"

namespace fieldtrace {
namespace {

// The orthographic chart's cell layers and coverage; the thesis' chart has two.
constexpr int k_most_grids = 5;

template <class T>
T metadata_value(const openvdb::MetaMap& map, const std::string& path, const char* name) {
  const auto entry = map.getMetadata<openvdb::TypedMetadata<T>>(name);
  if (!entry) throw FieldFileError(path, std::string("has no ") + name + " of a field");
  return entry->value();
}

FieldFileHeader read_metadata(const openvdb::MetaMap& map, const std::string& path) {
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
  const openvdb::Vec3s centre = metadata_value<openvdb::Vec3s>(map, path, "centre");
  h.ball.centre = {centre[0], centre[1], centre[2]};
  h.ball.radius = metadata_value<float>(map, path, "radius");
  const int64_t primitives = metadata_value<int64_t>(map, path, "primitive_count");
  i.primitive_count = uint32_t(primitives);
  const bool finite = std::isfinite(h.ball.centre.x) && std::isfinite(h.ball.centre.y) &&
                      std::isfinite(h.ball.centre.z) && std::isfinite(h.ball.radius);
  bool sound = finite && h.ball.radius > 0.0f && primitives == int64_t(i.primitive_count);
  sound = sound && parse_hash(metadata_value<std::string>(map, path, "mesh_hash"), i.geometry);
  sound = sound && (i.chart == k_chart_thesis ? valid_thesis_parameters(i.parameters)
                                              : i.chart == k_chart_orthographic && valid_parameters(i.parameters));
  if (!sound) throw FieldFileError(path, "has metadata that no field of this program has");
  return h;
}

}  // namespace

void write_metadata(openvdb::MetaMap& map, const FieldIdentity& identity, const Sphere& ball) {
  map.insertMeta("fieldtrace_format", openvdb::Int32Metadata(identity.format_version));
  map.insertMeta("chart", openvdb::StringMetadata(identity.chart));
  map.insertMeta("directions", openvdb::Int32Metadata(identity.parameters.directions));
  map.insertMeta("plane", openvdb::Int32Metadata(identity.parameters.plane));
  map.insertMeta("lines", openvdb::Int32Metadata(identity.parameters.lines));
  map.insertMeta("centre", openvdb::Vec3SMetadata({ball.centre.x, ball.centre.y, ball.centre.z}));
  map.insertMeta("radius", openvdb::FloatMetadata(ball.radius));
  map.insertMeta("mesh_hash", openvdb::StringMetadata(identity.geometry.hex()));
  map.insertMeta("primitive_count", openvdb::Int64Metadata(identity.primitive_count));
}

FieldVdb read_field_vdb(const std::string& path) {
  std::string contents = read_checked(path);
  openvdb::initialize();
  try {
    VdbContents file = VdbArchive().read_bytes(std::move(contents), k_most_grids);
    return {read_metadata(file.metadata, path), std::move(file.grids)};
  } catch (const FieldFileError&) {
    throw;
  } catch (const std::exception& e) {
    throw FieldFileError(path, std::string("is not a field that OpenVDB can read (") + e.what() + ")");
  }
}

void require_chart(const FieldFileHeader& header, const char* chart, const std::string& path) {
  if (header.identity.chart == chart) return;
  throw FieldFileError(path, "is a field of the chart " + header.identity.chart + ", not " + chart);
}

openvdb::Int32Grid::Ptr take_grid(const openvdb::GridPtrVec& grids, const char* name, const std::string& path) {
  openvdb::Int32Grid::Ptr found;
  for (const openvdb::GridBase::Ptr& grid : grids) {
    if (grid->getName() != name) continue;
    if (found) throw FieldFileError(path, std::string("has two grids named ") + name);
    found = openvdb::GridBase::grid<openvdb::Int32Grid>(grid);
    if (!found) throw FieldFileError(path, std::string("has a grid ") + name + " of another type");
  }
  return found;
}

uint64_t write_field_vdb(std::span<const openvdb::Int32Grid::Ptr> grids, const FieldIdentity& identity,
                         const Sphere& ball, const std::string& path) {
  openvdb::initialize();
  AtomicFile file(path);
  openvdb::MetaMap metadata;
  write_metadata(metadata, identity, ball);
  openvdb::GridCPtrVec written;
  for (const openvdb::Int32Grid::Ptr& grid : grids) {
    if (!grid->empty()) written.push_back(grid);
  }
  try {
    VdbArchive archive;
    archive.setCompression(
        openvdb::io::COMPRESS_ACTIVE_MASK |
        (openvdb::io::Archive::hasBloscCompression() ? openvdb::io::COMPRESS_BLOSC : openvdb::io::COMPRESS_ZIP));
    archive.write_file(file.temporary_path(), written, metadata);
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
