#include "core/platform/module.h"

#include <dlfcn.h>
#include <link.h>

#include <filesystem>

#include "core/platform/error.h"

namespace fieldtrace {
namespace {

namespace fs = std::filesystem;

// Where the module lies beside what holds this code: the program, or a library in other programs.
fs::path expected_path(const std::string& file) {
  Dl_info info;
  link_map* object = nullptr;
  const bool known = dladdr1(reinterpret_cast<const void*>(&module_function), &info, reinterpret_cast<void**>(&object),
                             RTLD_DL_LINKMAP) != 0;
  // The program's own name is empty there.
  if (known && object && object->l_name[0] != '\0') {
    return (fs::absolute(object->l_name).parent_path() / "fieldtrace" / file).lexically_normal();
  }
  return (fs::read_symlink("/proc/self/exe").parent_path() / FIELDTRACE_MODULE_DIR / file).lexically_normal();
}

// A path that exists, or `file` for the loader to find. Not by a run path where that can be helped: the address
// sanitizer's dlopen() would look in its own.
std::string module_path(const std::string& file) {
  std::error_code ignored;
  if (const fs::path expected = expected_path(file); fs::exists(expected, ignored)) return expected.string();
  // Linked statically into another program: where the build was to be installed, or on that program's run path.
  const fs::path installed = fs::path(FIELDTRACE_INSTALLED_MODULES) / file;
  return fs::exists(installed, ignored) ? installed.string() : file;
}

std::string file_of(const std::string& name) { return "libfieldtrace_" + name + ".so"; }

// Opens the module; null: the system says why not.
void* open(const std::string& path) { return dlopen(path.c_str(), RTLD_LAZY | RTLD_LOCAL); }

[[noreturn]] void fail(const std::string& file, const std::string& path) {
  const char* const reason = dlerror();
  throw Error({path == file ? expected_path(file).string() : path},
              "a part of this program that must lie there cannot be opened (" +
                  std::string(reason ? reason : "no reason given") + "); build or install the program again");
}

}  // namespace

void* module_function(const std::string& name, const char* function) {
  const std::string file = file_of(name), path = module_path(file);
  void* const module = open(path);
  void* const address = module ? dlsym(module, function) : nullptr;
  if (!address) fail(file, path);
  return address;
}

void require_module(const std::string& name) {
  const std::string file = file_of(name), path = module_path(file);
  if (path == file && !open(path)) fail(file, path);
}

}  // namespace fieldtrace
