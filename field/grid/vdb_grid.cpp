#include "field/grid/vdb_grid.h"

#include "core/platform/module.h"

namespace fieldtrace {

const VdbFunctions& vdb() {
  static const VdbFunctions& functions = *reinterpret_cast<VdbEntry*>(module_function(k_vdb_module, k_vdb_function))();
  return functions;
}

void VdbGridDelete::operator()(VdbGrid* grid) const { vdb().destroy(grid); }

}  // namespace fieldtrace
