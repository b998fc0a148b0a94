// How much memory this process may use.
// Thread-safety: pure functions.
#pragma once

#include <cstdint>

namespace fieldtrace {

// The least of the machine's main memory, the limit of the process' control group (Linux, cgroup v2) and that of its
// address space (`ulimit -v`), in bytes. At least 256 MiB, also where nothing can be determined.
uint64_t machine_memory_bytes();

}  // namespace fieldtrace
