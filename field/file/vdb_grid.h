// Int32 grids of OpenVDB files behind plain functions: OpenVDB lies in a module (core/platform/module.h), which is
// opened when the first field file is read or written.
//
// Thread-safety: distinct grids are independent; one may be read by any number of threads.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <future>
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

// 8^3 voxels: voxel (x, y, z) from the origin is number 64 x + 8 y + z.
struct VdbLeaf {
  std::array<int32_t, k_vdb_leaf_voxels> values;
  VdbMask active = {};
};

// A part of a grid: a leaf, or a tile, which is a cube of equal active voxels.
struct VdbNode {
  VoxelCoord origin = {};           // its lowest voxel
  int side = 0;                     // voxels; 0: nothing that is active
  int32_t value = 0;                // a tile's
  const int32_t* values = nullptr;  // a leaf's, as in VdbLeaf; null for a tile
  VdbMask active = {};              // a leaf's
};

using VdbMetadata = std::map<std::string, std::variant<int32_t, int64_t, float, std::string, std::array<float, 3>>>;

struct VdbGrid;  // OpenVDB's
struct VdbGridDelete {
  void operator()(VdbGrid* grid) const;
};
using VdbGridPtr = std::unique_ptr<VdbGrid, VdbGridDelete>;

struct VdbFile {
  VdbMetadata metadata;
  std::vector<VdbGridPtr> grids;
};

// What the module exports. Functions that read or write throw exceptions of the standard library and of OpenVDB's that
// derive from them; others throw std::bad_alloc at most.
struct VdbFunctions {
  VdbGridPtr (*create)(const char* name, int32_t background);
  void (*destroy)(VdbGrid* grid);
  std::string (*name)(const VdbGrid& grid);
  int32_t (*background)(const VdbGrid& grid);
  // Adds an active tile of 8^3 voxels. Unchecked, here and below: `origin` is a multiple of 8.
  void (*add_tile)(VdbGrid& grid, const VoxelCoord& origin, int32_t value);
  // Sets the leaf's active voxels.
  void (*add_leaf)(VdbGrid& grid, const VoxelCoord& origin, const VdbLeaf& leaf);
  // What the 8^3 voxels from `origin` on belong to. Of a tile, only whether it is active (side 8) and its value.
  VdbNode (*find)(const VdbGrid& grid, const VoxelCoord& origin);
  // Shows all leaves, then all tiles, until `visit` returns false; returns what it returned last.
  bool (*visit)(const VdbGrid& grid, const std::function<bool(const VdbNode&)>& visit);
  // The file whose bytes these are; throws if that is anything but a file of at most `most_grids` such grids.
  VdbFile (*read)(std::string bytes, int most_grids);
  // Writes the grids that are not empty, each with the metadata, which the file has too, to an existing file.
  void (*write)(const std::string& path, std::span<const VdbGrid* const> grids, const VdbMetadata& metadata);
};

inline constexpr const char* k_vdb_module = "vdb";
inline constexpr const char* k_vdb_function = "fieldtrace_vdb";  // a VdbEntry
using VdbEntry = const VdbFunctions*();

// The module's functions. Throws Error if it cannot be opened: long work calls this before it starts.
const VdbFunctions& vdb();

// Opens the module on another thread; the future waits for it. A failure is told by the next vdb().
std::future<void> open_vdb_early();

}  // namespace fieldtrace
