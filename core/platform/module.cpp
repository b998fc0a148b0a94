#include "core/platform/module.h"

#include <dlfcn.h>

#include "core/platform/error.h"

namespace fieldtrace {

void* module_function(const std::string& name, const char* function) {
  const std::string file = "libfieldtrace_" + name + ".so";
  // The loader looks for it in the run path of the object that calls: the program, which this file is linked into.
  void* const module = dlopen(file.c_str(), RTLD_LAZY | RTLD_LOCAL);
  void* const address = module ? dlsym(module, function) : nullptr;
  if (address) return address;
  const char* const reason = dlerror();
  throw Error({file}, std::string("a part of this program cannot be opened: ") + (reason ? reason : "no reason given") +
                          "; it belongs in ../lib/fieldtrace beside the program: build or install it again");
}

}  // namespace fieldtrace
