// Coverage tiles as an OpenVDB grid, and back.
//
// Voxel (direction, y, x) holds the line at texel (x, y) of that direction: 0 for nothing met, else its depth code + 1
// (field/store/coverage.hd.h). Lines of tiles that are not baked are inactive. 8^3 voxels that are all baked and meet
// nothing are an active tile of OpenVDB's, not a leaf. Thread-safety: distinct objects are independent.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "field/file/vdb_grid.h"
#include "field/store/coverage.h"

namespace fieldtrace {

inline constexpr const char* k_coverage_grid_name = "coverage";

// The union of the sources' tiles; one that several have comes from the first.
void write_coverage(std::span<const CoverageTiles* const> sources, VdbGrid& grid);

// The tiles of a grid. It keeps no copy of them: fields of many tiles would need it twice.
class CoverageGrid {
 public:
  CoverageGrid() = default;
  // Checks all of `grid`, made for D x D directions and planes of N cells. False, and nothing kept, if it holds
  // anything but whole tiles of lines.
  bool open(VdbGridPtr grid, int directions, int plane);

  const std::vector<uint32_t>& slots() const { return slots_; }  // ascending
  // The 32 x 32 lines of one of slots().
  void read(uint32_t slot, std::span<uint16_t> lines) const;

 private:
  VdbGridPtr grid_;
  int tiles_ = 0;  // along each side of a plane
  std::vector<uint32_t> slots_;
};

}  // namespace fieldtrace
