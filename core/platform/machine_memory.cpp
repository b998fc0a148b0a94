#include "core/platform/machine_memory.h"

#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <limits>

#include "core/platform/address_space.h"

namespace fieldtrace {
namespace {

constexpr uint64_t k_least_bytes = uint64_t(256) << 20;

// Without a limit the file reads "max", which does not parse as a number.
uint64_t control_group_limit() {
  std::ifstream file("/sys/fs/cgroup/memory.max");
  uint64_t bytes = 0;
  return file >> bytes && bytes > 0 ? bytes : std::numeric_limits<uint64_t>::max();
}

}  // namespace

uint64_t machine_memory_bytes() {
  const long pages = sysconf(_SC_PHYS_PAGES), page = sysconf(_SC_PAGESIZE);
  const uint64_t physical = pages > 0 && page > 0 ? uint64_t(pages) * uint64_t(page) : 0;
  return std::max(std::min({physical, control_group_limit(), process_address_limit()}), k_least_bytes);
}

}  // namespace fieldtrace
