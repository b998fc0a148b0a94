// Int32 grids of OpenVDB files. OpenVDB itself lies behind plain functions in a module (core/platform/module.h), which
// is opened when the first file is written, or read that is not as this program writes them: those are read without it
// (field/grid/plain_vdb.h).
//
// Thread-safety: distinct grids are independent; one that was read may be read by any number of threads.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <variant>
#include <vector>

namespace fieldtrace {

using VoxelCoord = std::array<int32_t, 3>;  // x, y, z

inline constexpr int k_vdb_leaf_side = 8;
inline constexpr int k_vdb_leaf_voxels = k_vdb_leaf_side * k_vdb_leaf_side * k_vdb_leaf_side;
// Bit i mod 64 of word i / 64 tells whether voxel i is active.
using VdbMask = std::array<uint64_t, k_vdb_leaf_voxels / 64>;

inline bool is_active(const VdbMask& mask, int voxel) { return (mask[size_t(voxel) / 64] >> (voxel % 64) & 1) != 0; }

// Of 8^3 voxels: voxel (x, y, z) from the origin is number 64 x + 8 y + z.
using VdbValues = std::array<int32_t, k_vdb_leaf_voxels>;
struct VdbLeaf {
  VdbValues values;
  VdbMask active = {};
};

// A leaf that was read. Its values stay packed as they are in the file.
struct VdbStoredLeaf {
  VoxelCoord origin = {};  // its lowest voxel
  int32_t number = 0;      // in the file
  VdbMask active = {};
};

// A cube of equal active voxels.
struct VdbTile {
  VoxelCoord origin = {};
  int side = 0;  // voxels
  int32_t value = 0;
};

// A grid that was read.
struct VdbStoredGrid {
  std::string name;
  int32_t background = 0;
  std::vector<VdbStoredLeaf> leaves;  // by ascending origin, as are tiles
  std::vector<VdbTile> tiles;
  // Unpacks a leaf; inactive voxels get the background's value. False if its bytes are damaged.
  std::function<bool(const VdbStoredLeaf& leaf, VdbValues& values)> unpack;
};

using VdbMetadata = std::map<std::string, std::variant<int32_t, int64_t, float, std::string, std::array<float, 3>>>;

struct VdbFile {
  VdbMetadata metadata;
  std::vector<VdbStoredGrid> grids;
};

struct VdbGrid;  // OpenVDB's, to be written
struct VdbGridDelete {
  void operator()(VdbGrid* grid) const;
};
using VdbGridPtr = std::unique_ptr<VdbGrid, VdbGridDelete>;

// What the module exports. Functions that read or write throw exceptions of the standard library and of OpenVDB's that
// derive from them; others throw std::bad_alloc at most.
struct VdbFunctions {
  VdbGridPtr (*create)(const char* name, int32_t background);
  void (*destroy)(VdbGrid* grid);
  // Adds an active tile of 8^3 voxels. Unchecked, here and below: `origin` is a multiple of 8.
  void (*add_tile)(VdbGrid& grid, const VoxelCoord& origin, int32_t value);
  // Sets the leaf's active voxels.
  void (*add_leaf)(VdbGrid& grid, const VoxelCoord& origin, const VdbLeaf& leaf);
  // The file whose bytes these are; throws if that is anything but a file of at most `most_grids` such grids.
  VdbFile (*read)(std::string bytes, int most_grids);
  // Writes the grids that are not empty, each with the metadata, which the file has too, to an existing file.
  void (*write)(const std::string& path, std::span<const VdbGrid* const> grids, const VdbMetadata& metadata);
};

inline constexpr const char* k_vdb_module = "vdb";
inline constexpr const char* k_vdb_function = "fieldtrace_vdb";  // a VdbEntry
using VdbEntry = const VdbFunctions*();

// The module's functions. Throws Error if it cannot be opened: long work that is to be written calls this before it
// starts.
const VdbFunctions& vdb();

// The part that begins at `origin`, of parts by ascending origin; null if there is none.
template <class T>
const T* find_by_origin(const std::vector<T>& parts, const VoxelCoord& origin) {
  const auto part = std::lower_bound(parts.begin(), parts.end(), origin,
                                     [](const T& p, const VoxelCoord& at) { return p.origin < at; });
  return part != parts.end() && part->origin == origin ? &*part : nullptr;
}

// Puts a grid's leaves and tiles in order.
inline void sort_by_origin(VdbStoredGrid& grid) {
  const auto is_before = [](const auto& a, const auto& b) { return a.origin < b.origin; };
  std::sort(grid.leaves.begin(), grid.leaves.end(), is_before);
  std::sort(grid.tiles.begin(), grid.tiles.end(), is_before);
}

}  // namespace fieldtrace
