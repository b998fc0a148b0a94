// Numbers of threads. Thread-safety: pure functions.
#pragma once

#include <algorithm>
#include <thread>

namespace fieldtrace {

// As many threads as are asked for; for 0, as many as the machine runs at once.
inline int threads_or_all(int asked) {
  return asked > 0 ? asked : std::max(int(std::thread::hardware_concurrency()), 1);
}

}  // namespace fieldtrace
