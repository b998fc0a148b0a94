// Coverage tiles as an OpenVDB grid, and back.
//
// Voxel (direction, y, x) holds the line at texel (x, y) of that direction: 0 for a miss, else its depth code + 1
// (field/store/coverage.hd.h). Lines of tiles that are not baked are inactive. 8^3 voxels that are all baked and all
// misses are one active tile of OpenVDB's instead of a leaf. Thread-safety: distinct objects are independent.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "core/platform/zeroed_vector.h"
#include "field/grid/vdb_grid.h"
#include "field/store/coverage.h"

namespace fieldtrace {

inline constexpr const char* k_coverage_grid_name = "coverage";

// Writes the union of the sources' tiles; a tile that several sources have is taken from the first.
void write_coverage(std::span<const CoverageTiles* const> sources, VdbGrid& grid);

// The tiles of a grid, which is not kept.
class CoverageGrid {
 public:
  CoverageGrid() = default;
  // Checks all of `grid`, which was made for D x D directions and planes of N cells. False, with nothing kept, if it
  // holds anything but whole tiles of lines.
  bool open(const VdbStoredGrid& grid, int directions, int plane);

  const std::vector<uint32_t>& slots() const { return slots_; }  // ascending
  // The 32 x 32 lines of one of slots().
  std::span<const uint16_t> lines(uint32_t slot) const;

 private:
  std::vector<uint32_t> slots_;
  // Those of them that have leaves, ascending, and their lines. All lines of the others are misses.
  std::vector<uint32_t> held_;
  ZeroedVector<uint16_t> lines_;
};

}  // namespace fieldtrace
