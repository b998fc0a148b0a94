// What a field file holds, for `fieldtrace info` and the statistics of a bake.
//
// Thread-safety: pure functions.
#pragma once

#include <cstdint>
#include <string>

#include "field/field_file.h"

namespace fieldtrace {

// Cells of one layer. The shares of the verdicts are those of the baked cells at a tolerance: a cell answers clear (or
// miss) or blocked (or sheet), or it asks for an exact ray.
struct LayerInfo {
  uint64_t cells_baked = 0;
  uint64_t cells_reachable = 0;  // what a full bake makes
  uint64_t clear = 0, blocked = 0, ask = 0;
};

struct FieldFileInfo {
  FieldFileHeader header;
  uint64_t bytes_disk = 0, bytes_memory = 0;
  uint64_t bricks = 0;
  uint64_t cells_full = 0;  // D^2 N^2, of each layer
  LayerInfo visibility, depth;
};

// The tolerance at which shares are counted unless another is asked for: the renderer's default.
inline constexpr float k_info_tolerance = 0.1f;

LayerInfo layer_info(const Field& field, FieldLayer layer, float tolerance = k_info_tolerance);

// Reads and checks the whole file. Throws FieldFileError as FieldFile does.
FieldFileInfo field_info(const std::string& path, float tolerance = k_info_tolerance);

}  // namespace fieldtrace
