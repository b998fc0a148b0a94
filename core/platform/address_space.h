// How much address space this process may reserve.
//
// Fields reserve far more than they touch (core/platform/virtual_buffer.h). Two kinds of limit refuse that: the
// process' own (RLIMIT_AS, `ulimit -v`), and strict overcommit (/proc/sys/vm/overcommit_memory is 2), under which the
// system counts reserved address space as memory. Linux; other systems are taken to have no limit. Thread-safety: pure
// functions.
#pragma once

#include <cstdint>
#include <limits>

namespace fieldtrace {

inline constexpr uint64_t k_no_address_limit = std::numeric_limits<uint64_t>::max();

// Bytes: of the process, and under strict overcommit of the whole machine.
uint64_t process_address_limit();
uint64_t machine_address_limit();

// What fields may reserve: 1/8 of the lower limit, k_no_address_limit without one. A share of the limit rather than of
// what is free: that depends on the threads, which must not decide what fields hold. So small a share is nearly always
// free: the program with its libraries takes half a gigabyte, and runs under no limit much lower.
uint64_t reservable_bytes();

}  // namespace fieldtrace
