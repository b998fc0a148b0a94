// How much address space this process may reserve.
//
// Fields reserve far more than they touch (core/platform/virtual_buffer.h). Two kinds of limit can refuse that: the
// process' limit (RLIMIT_AS, `ulimit -v`), and strict overcommit (/proc/sys/vm/overcommit_memory is 2), under which the
// system counts reserved address space as memory. Linux only; other systems are assumed to have no limit.
// Thread-safety: pure functions.
#pragma once

#include <cstdint>
#include <limits>

namespace fieldtrace {

inline constexpr uint64_t k_no_address_limit = std::numeric_limits<uint64_t>::max();

// Bytes: of this process, and under strict overcommit of the whole machine.
uint64_t process_address_limit();
uint64_t machine_address_limit();

// What fields may reserve: 1/8 of the lower limit, or k_no_address_limit. A share of the limit rather than of the free
// space, since that depends on the threads, which must not determine what fields hold. So small a share is nearly
// always free: the program with its libraries takes half a gigabyte, and does not run under a much lower limit.
uint64_t reservable_bytes();

}  // namespace fieldtrace
