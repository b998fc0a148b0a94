#include "field/file/vdb_grid.h"

#include "core/platform/module.h"
#include "core/platform/parallel.h"

namespace fieldtrace {

const VdbFunctions& vdb() {
  static const VdbFunctions& functions = *reinterpret_cast<VdbEntry*>(module_function(k_vdb_module, k_vdb_function))();
  return functions;
}

std::future<void> open_vdb_early() {
  // TBB opens libraries of its own when it is first used, which would have to wait until the module is open.
  parallel_for(2, [](size_t) {});
  return std::async(std::launch::async, [] {
    try {
      vdb();
    } catch (const std::exception&) {
    }
  });
}

void VdbGridDelete::operator()(VdbGrid* grid) const { vdb().destroy(grid); }

}  // namespace fieldtrace
