// What files of every chart have in common: metadata of the file and of each grid, the checksum behind it, and the
// errors. Only the field's file code includes this: OpenVDB compiles slowly.
//
// Thread-safety: pure functions on distinct files. Format: field/file/field_file.h.
#pragma once

#include <openvdb/openvdb.h>

#include <span>
#include <string>

#include "field/file/field_file.h"

namespace fieldtrace {

void write_metadata(openvdb::MetaMap& map, const FieldIdentity& identity, const Sphere& ball);

struct FieldVdb {
  FieldFileHeader header;
  openvdb::GridPtrVec grids;
};

// Reads a file of any chart whose checksum matches. Throws FieldFileError for a file that is missing, damaged, not a
// field, of another format version, or with metadata that no field has.
FieldVdb read_field_vdb(const std::string& path);

// Throws FieldFileError unless the file is of this chart.
void require_chart(const FieldFileHeader& header, const char* chart, const std::string& path);

// The grid of that name; null if there is none. Throws FieldFileError if there are two, or if it is of another type.
openvdb::Int32Grid::Ptr take_grid(const openvdb::GridPtrVec& grids, const char* name, const std::string& path);

// Writes the grids that are not empty under a temporary name that is then renamed to `path`. Returns the file's size in
// bytes. Throws Error if it cannot be written.
uint64_t write_field_vdb(std::span<const openvdb::Int32Grid::Ptr> grids, const FieldIdentity& identity,
                         const Sphere& ball, const std::string& path);

}  // namespace fieldtrace
