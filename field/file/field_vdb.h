// What files of every chart have in common: metadata of the file and of each grid, the checksum behind it, and the
// errors.
//
// Thread-safety: pure functions on distinct files. Format: field/file/field_file.h.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "field/file/field_file.h"
#include "field/grid/vdb_grid.h"

namespace fieldtrace {

struct FieldVdb {
  FieldFileHeader header;
  std::vector<VdbStoredGrid> grids;
};

// Reads a file of any chart whose checksum matches. Throws FieldFileError for a file that is missing, damaged, not a
// field, of another format version, or with metadata that no field has.
FieldVdb read_field_vdb(const std::string& path);

// Throws FieldFileError unless the file is of this chart.
void require_chart(const FieldFileHeader& header, const char* chart, const std::string& path);

// Takes the grid of that name; nothing if there is none. Throws FieldFileError if there are two.
std::optional<VdbStoredGrid> take_grid(FieldVdb& file, const char* name, const std::string& path);

// Writes the grids that are not empty under a temporary name that is then renamed to `path`. Returns the file's size in
// bytes. Throws Error if it cannot be written.
uint64_t write_field_vdb(std::span<const VdbGridPtr> grids, const FieldIdentity& identity, const Sphere& ball,
                         const std::string& path);

}  // namespace fieldtrace
