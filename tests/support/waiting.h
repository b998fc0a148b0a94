// Waiting for what another thread or process is about to do.
#pragma once

#include <chrono>
#include <functional>
#include <thread>

namespace fieldtrace::test {

// Waits until the condition holds. False if it does not within a minute.
inline bool comes_true(const std::function<bool()>& condition) {
  for (int i = 0; i < 6000; ++i) {
    if (condition()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  return false;
}

}  // namespace fieldtrace::test
