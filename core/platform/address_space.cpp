#include "core/platform/address_space.h"

#include <sys/resource.h>

#include <algorithm>
#include <fstream>
#include <string>

namespace fieldtrace {
namespace {

constexpr uint64_t k_reservable_part = 8;

}  // namespace

uint64_t process_address_limit() {
  rlimit limit{};
  if (getrlimit(RLIMIT_AS, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY) return k_no_address_limit;
  return uint64_t(limit.rlim_cur);
}

uint64_t machine_address_limit() {
  int mode = 0;
  if (!(std::ifstream("/proc/sys/vm/overcommit_memory") >> mode) || mode != 2) return k_no_address_limit;
  std::ifstream file("/proc/meminfo");
  for (std::string word; file >> word;) {
    uint64_t kibibytes = 0;
    if (word == "CommitLimit:" && file >> kibibytes) return kibibytes << 10;
  }
  return k_no_address_limit;
}

uint64_t reservable_bytes() {
  const uint64_t limit = std::min(process_address_limit(), machine_address_limit());
  return limit == k_no_address_limit ? limit : limit / k_reservable_part;
}

}  // namespace fieldtrace
