// What a field file holds, for `fieldtrace info` and the statistics of a bake.
//
// Thread-safety: pure functions.
#pragma once

#include <cstdint>
#include <string>

#include "field/file/field_file.h"
#include "field/store/risk_classes.h"

namespace fieldtrace {

// Cells of one layer. clear, blocked, undecided: verdicts of the baked cells at a tolerance; for the depth layer a miss
// counts as clear and a plane fit as blocked.
struct LayerInfo {
  uint64_t cells_baked = 0;
  uint64_t cells_reachable = 0;  // what a full bake makes
  uint64_t clear = 0, blocked = 0, undecided = 0;
  // One-sided bounds among the depth layer's `blocked`: they say what lies in front of them, not behind.
  uint64_t one_sided = 0;
};

// Coverage tiles.
struct CoverageInfo {
  int lines_across = 0;  // L: of a direction's L x L lines
  uint64_t tiles_baked = 0, tiles_full = 0;
  uint64_t tiles_empty = 0;  // baked, but without a hit: these take no memory
  uint64_t lines_baked = 0, lines_hit = 0;
};

struct FieldFileInfo {
  FieldFileHeader header;
  // bytes_memory: of a field that has loaded the file, cells and coverage included. bytes_cells, bytes_coverage: what
  // the baked cells and the non-empty tiles take of it, without tables and unused parts of bricks.
  uint64_t bytes_disk = 0, bytes_memory = 0, bytes_cells = 0, bytes_coverage = 0;
  uint64_t bricks = 0;
  uint64_t cells_full = 0;  // D^2 N^2, of each layer
  LayerInfo visibility, depth;
  uint64_t primitives_baked = 0;  // cells
  CoverageInfo coverage;

  // Bytes of baked data in memory for each byte on disk.
  double compression() const { return bytes_disk ? double(bytes_cells + bytes_coverage) / double(bytes_disk) : 0.0; }
};

CoverageInfo coverage_info(const CoverageTiles& tiles);

LayerInfo layer_info(const Field& field, FieldLayer layer, float tolerance = k_default_tolerance);

// Reads and checks the whole file. Throws FieldFileError as FieldFile does.
FieldFileInfo field_info(const std::string& path, float tolerance = k_default_tolerance);

}  // namespace fieldtrace
