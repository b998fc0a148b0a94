// A thesis field as an OpenVDB file, to learn what it takes on disk.
//
// Two Int32 grids, "distance" (background 255, a miss) and "normal" (three bytes, x lowest; background 0x7f7f7f, a
// miss); voxel (position, v, u). Readable by vdb_print. Thread-safety: distinct paths are independent.
#pragma once

#include <cstdint>
#include <string>

#include "tools/thesis/field.h"

namespace fieldtrace {

// Writes the file and returns its size in bytes. Throws Error naming `path` if it cannot be written.
uint64_t write_thesis_vdb(const ThesisField& field, const std::string& path);

}  // namespace fieldtrace
