#include "core/platform/machine_memory.h"

#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <limits>
#include <string>

#include "core/platform/address_space.h"

namespace fieldtrace {
namespace {

constexpr uint64_t k_least_bytes = uint64_t(256) << 20;

constexpr uint64_t k_no_limit = std::numeric_limits<uint64_t>::max();

// Without a limit the file reads "max", which does not parse as a number.
uint64_t limit_in(const std::string& path) {
  std::ifstream file(path);
  uint64_t bytes = 0;
  return file >> bytes && bytes > 0 ? bytes : k_no_limit;
}

// This process' group in the unified hierarchy, below its mount: "/user.slice"; "/" if it is not known.
std::string control_group() {
  std::ifstream file("/proc/self/cgroup");
  for (std::string line; std::getline(file, line);) {
    if (line.rfind("0::/", 0) == 0) return line.substr(3);
  }
  return "/";
}

// Groups lie within groups, and each may have a limit.
uint64_t control_group_limit() {
  uint64_t least = k_no_limit;
  for (std::filesystem::path group = control_group();; group = group.parent_path()) {
    least = std::min(least, limit_in("/sys/fs/cgroup" + group.string() + "/memory.max"));
    if (group == group.parent_path()) return least;
  }
}

}  // namespace

uint64_t machine_memory_bytes() {
  const long pages = sysconf(_SC_PHYS_PAGES), page = sysconf(_SC_PAGESIZE);
  const uint64_t physical = pages > 0 && page > 0 ? uint64_t(pages) * uint64_t(page) : 0;
  return std::max(std::min({physical, control_group_limit(), process_address_limit()}), k_least_bytes);
}

}  // namespace fieldtrace
