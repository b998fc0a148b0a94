#include "core/io/scratch_folder.h"

#include <unistd.h>

#include <filesystem>

#include "core/platform/error.h"

namespace fieldtrace {

namespace fs = std::filesystem;

ScratchFolder::ScratchFolder(const std::string& parent, const std::string& prefix) {
  // create_directory() tells whether the folder is new; the process id only spares attempts.
  for (unsigned i = 0; path_.empty(); ++i) {
    const fs::path name =
        fs::path(parent) / (prefix + "-" + std::to_string(getpid()) + "-" + std::to_string(i) + ".tmp");
    std::error_code failed;
    if (fs::create_directory(name, failed)) path_ = name.string();
    if (failed && failed != std::errc::file_exists) {
      throw Error({parent}, "cannot hold a temporary folder: " + failed.message());
    }
  }
}

ScratchFolder::~ScratchFolder() {
  std::error_code ignored;
  fs::remove_all(path_, ignored);
}

}  // namespace fieldtrace
