// Thesis fields in files: OpenVDB with the metadata and checksum of every field file (field/file/field_file.h).
//
// Two Int32 grids: "distance" (background 255, a miss) and, where normals are kept, "normal" (three bytes, x lowest;
// background 0x7f7f7f, a miss); voxel (position, v, u). In the metadata chart is "thesis", directions is M, plane and
// lines are 0. Readable by vdb_print. Thread-safety: distinct paths are independent.
#pragma once

#include <cstdint>
#include <string>

#include "field/file/field_file.h"
#include "field/thesis/thesis_field.h"

namespace fieldtrace {

// Unchecked: the shape is a mesh, m is 32, 64 or 128.
FieldIdentity thesis_identity(const Shape& shape, int m);

// Writes the file under a temporary name that is then renamed, and returns its size in bytes. Unchecked: `identity`
// belongs to the field. Throws Error if the file cannot be written.
uint64_t save_thesis_field(const ThesisField& field, const FieldIdentity& identity, const std::string& path);

// The distances of a file. Throws FieldFileError for a file that is missing, damaged, of another identity, or with
// values that no bake writes.
ThesisField load_thesis_field(const FieldIdentity& identity, const std::string& path);

struct ThesisFileInfo {
  FieldFileHeader header;
  uint64_t samples = 0, misses = 0;  // of 4,226 M^2
  uint64_t bytes_disk = 0;
  uint64_t bytes_memory = 0;  // of a field that has loaded the file
  bool has_normals = false;
};

// Reads and checks the whole file. Throws FieldFileError as load_thesis_field() does.
ThesisFileInfo thesis_file_info(const std::string& path);

// The chart of a field file; reads and checks all of it. Throws FieldFileError as above.
std::string field_file_chart(const std::string& path);

}  // namespace fieldtrace
