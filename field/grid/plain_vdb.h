// Reads OpenVDB files as this program writes them without OpenVDB, whose library takes as long to open as a short frame
// takes (docs/decisions/021-start-up.md).
//
// Read are files of format 224 with offsets of grids, grids of the type Tree_int32_5_4_3 with a uniform scale, packed
// by Blosc, whose inactive voxels have the background's value. Format: OpenVDB 10, io/Archive.cc, io/Compression.h and
// tree/{RootNode,InternalNode,LeafNode}.h. Memory is bounded by the file's size: leaves stay packed.
// Thread-safety: pure function.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "field/grid/vdb_grid.h"

namespace fieldtrace {

// The file whose bytes these are, which the grids keep. Nothing for whatever is unusual or damaged, which is OpenVDB's
// to read or to refuse.
std::optional<VdbFile> read_plain_vdb(const std::shared_ptr<const std::string>& bytes, int most_grids);

}  // namespace fieldtrace
