// How much memory this process may use.
// Thread-safety: pure functions.
#pragma once

#include <cstdint>

namespace fieldtrace {

// Bytes of main memory of the machine, or of the process' control group (Linux, cgroup version 2) or of its address
// space
// (`ulimit -v`) if that is less. At least 256 MiB, where none can be told.
uint64_t machine_memory_bytes();

}  // namespace fieldtrace
