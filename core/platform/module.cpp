#include "core/platform/module.h"

#include <dlfcn.h>

#include <filesystem>

#include "core/platform/error.h"

namespace fieldtrace {
namespace {

namespace fs = std::filesystem;

fs::path beside_program(const std::string& file) {
  return (fs::read_symlink("/proc/self/exe").parent_path() / FIELDTRACE_MODULE_DIR / file).lexically_normal();
}

// A path that exists, or `file` for the loader to find. Not by a run path where that can be helped: the address
// sanitizer's dlopen() would look in its own.
std::string module_path(const std::string& file) {
  const fs::path of_program = beside_program(file);
  std::error_code ignored;
  if (fs::exists(of_program, ignored)) return of_program.string();
  // Within libfieldtrace.so, the folder that it lies in.
  Dl_info info;
  if (dladdr(reinterpret_cast<const void*>(&module_function), &info) && info.dli_fname) {
    const fs::path library = fs::absolute(info.dli_fname, ignored);
    const fs::path beside_library = (library.parent_path() / "fieldtrace" / file).lexically_normal();
    if (fs::exists(beside_library, ignored)) return beside_library.string();
  }
  // Linked statically into another program: where the build was to be installed, or on that program's run path.
  const fs::path installed = fs::path(FIELDTRACE_INSTALLED_MODULES) / file;
  return fs::exists(installed, ignored) ? installed.string() : file;
}

}  // namespace

void* module_function(const std::string& name, const char* function) {
  const std::string file = "libfieldtrace_" + name + ".so", path = module_path(file);
  void* const module = dlopen(path.c_str(), RTLD_LAZY | RTLD_LOCAL);
  void* const address = module ? dlsym(module, function) : nullptr;
  if (address) return address;
  const char* const reason = dlerror();
  throw Error({path == file ? beside_program(file).string() : path},
              "a part of this program that must lie there cannot be opened (" +
                  std::string(reason ? reason : "no reason given") + "); build or install the program again");
}

}  // namespace fieldtrace
