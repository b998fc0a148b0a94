#include "core/platform/module.h"

#include <dlfcn.h>

#include <filesystem>

#include "core/platform/error.h"

namespace fieldtrace {

void* module_function(const std::string& name, const char* function) {
  // Not by a run path: the address sanitizer's dlopen() would look in its own.
  const std::filesystem::path program = std::filesystem::read_symlink("/proc/self/exe");
  const std::string path =
      (program.parent_path() / FIELDTRACE_MODULE_DIR / ("libfieldtrace_" + name + ".so")).lexically_normal().string();
  void* const module = dlopen(path.c_str(), RTLD_LAZY | RTLD_LOCAL);
  void* const address = module ? dlsym(module, function) : nullptr;
  if (address) return address;
  const char* const reason = dlerror();
  throw Error({path}, "a part of this program that must lie there cannot be opened (" +
                          std::string(reason ? reason : "no reason given") + "); build or install the program again");
}

}  // namespace fieldtrace
