// Coverage tiles as an OpenVDB grid, and back. Only the field's file code includes this: OpenVDB compiles slowly.
//
// Voxel (direction, y, x) holds the line at texel (x, y) of that direction: 0 for nothing met, else its depth code + 1
// (field/coverage.hd.h). Lines of tiles that are not baked are inactive. Thread-safety: distinct objects are
// independent.
#pragma once

#include <openvdb/openvdb.h>

#include <cstdint>
#include <span>
#include <vector>

#include "field/coverage.h"

namespace fieldtrace {

inline constexpr const char* k_coverage_grid_name = "coverage";

// Tiles read from a grid: slots ascending, and 32 x 32 lines for each.
struct CoverageData {
  std::vector<uint32_t> slots;
  std::vector<uint16_t> lines;
  std::span<const uint16_t> tile(size_t i) const {
    return std::span(lines).subspan(i * CoverageTiles::k_lines_per_tile, CoverageTiles::k_lines_per_tile);
  }
};

void write_coverage(std::span<const CoverageTiles* const> sources, openvdb::Int32Grid& grid);

// False if the grid holds anything but whole tiles of lines for D x D directions and planes of N cells.
bool read_coverage(const openvdb::Int32Grid& grid, int directions, int plane, CoverageData& data);

}  // namespace fieldtrace
