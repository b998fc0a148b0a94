// Bricks as leaves of OpenVDB grids, and back.
//
// Memory layout and formula: field/file/field_file.h. Thread-safety: distinct objects are independent.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "field/grid/vdb_grid.h"
#include "field/store/field.h"

namespace fieldtrace {

using BrickCells = std::array<int32_t, size_t(scalar::k_brick_cells)>;

// The grids of a file, in their order in it.
enum GridLayer { k_grid_visibility, k_grid_depth, k_grid_certificate, k_grid_primitive, k_grid_count };
inline constexpr const char* k_grid_names[k_grid_count] = {"visibility", "depth_normal", "certificate", "primitive"};

// First voxel of a brick. `parameters` must be a field's.
VoxelCoord brick_origin(const FieldParameters& parameters, uint32_t direction_brick, uint32_t plane_brick);

// The inverse; false if no brick begins at `origin`.
bool place_of_origin(const FieldParameters& parameters, const VoxelCoord& origin, uint32_t& direction_brick,
                     uint32_t& plane_brick);

// Adds a brick; bit s of `slices`: cells 32 s ... 32 s + 31 are baked. Adds nothing if `slices` is 0.
void add_brick(VdbGrid& grid, const VoxelCoord& origin, const BrickCells& cells, uint32_t slices);

// Reads a brick: its cells, and its slices in the sense above. False if the brick's active voxels are not whole slices,
// or damaged.
bool read_brick(const VdbStoredGrid& grid, const VoxelCoord& origin, BrickCells& cells, uint32_t& slices);

// Origins of the leaves and active tiles. False if an active tile is not of a brick's size.
bool brick_origins(const VdbStoredGrid& grid, std::vector<VoxelCoord>& origins);

}  // namespace fieldtrace
