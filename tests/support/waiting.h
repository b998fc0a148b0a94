// Waiting for what another thread or process is about to do.
#pragma once

#include <chrono>
#include <functional>
#include <thread>

namespace fieldtrace::test {

// Waits until the condition holds. False if it does not in that time.
inline bool comes_true(const std::function<bool()>& condition, int seconds = 20) {
  for (int i = 0; i < 100 * seconds; ++i) {
    if (condition()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  return false;
}

}  // namespace fieldtrace::test
