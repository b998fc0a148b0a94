// How much memory this process may use.
// Thread-safety: pure functions.
#pragma once

#include <cstdint>

namespace fieldtrace {

// Bytes of main memory of the machine, or of the process' control group if that is less (Linux, cgroup version 2). At
// least 256 MiB, where neither can be told.
uint64_t machine_memory_bytes();

}  // namespace fieldtrace
