#include "core/io/input_file.h"

#include <filesystem>

#include "core/platform/error.h"
#include "core/platform/machine_memory.h"

namespace fieldtrace {

namespace fs = std::filesystem;

bool is_special_file(const std::string& path) {
  std::error_code ignored;
  const fs::file_status status = fs::status(path, ignored);
  return fs::exists(status) && !fs::is_regular_file(status) && !fs::is_directory(status);
}

bool is_folder(const std::string& path) {
  std::error_code ignored;
  return fs::is_directory(path, ignored);
}

uint64_t require_regular_file(const std::string& path) {
  if (is_special_file(path)) throw Error({path}, k_special_file_message);
  std::error_code failed;
  const uint64_t bytes = fs::file_size(path, failed);
  if (failed) throw Error({path}, "cannot be read: " + failed.message());
  if (bytes > machine_memory_bytes()) {
    throw Error({path}, "is larger than the memory of this machine (" + std::to_string(bytes >> 20) +
                            " MiB); use a smaller file");
  }
  return bytes;
}

}  // namespace fieldtrace
