#include "field/grid/vdb_grid.h"

#include <algorithm>

#include "core/platform/module.h"

namespace fieldtrace {
namespace {

template <class T>
const T* find(const std::vector<T>& parts, const VoxelCoord& origin) {
  const auto part = std::lower_bound(parts.begin(), parts.end(), origin,
                                     [](const T& p, const VoxelCoord& at) { return p.origin < at; });
  return part != parts.end() && part->origin == origin ? &*part : nullptr;
}

}  // namespace

const VdbFunctions& vdb() {
  static const VdbFunctions& functions = *reinterpret_cast<VdbEntry*>(module_function(k_vdb_module, k_vdb_function))();
  return functions;
}

const VdbStoredLeaf* VdbStoredGrid::find_leaf(const VoxelCoord& origin) const { return find(leaves, origin); }
const VdbTile* VdbStoredGrid::find_tile(const VoxelCoord& origin) const { return find(tiles, origin); }

void VdbGridDelete::operator()(VdbGrid* grid) const { vdb().destroy(grid); }

}  // namespace fieldtrace
