// Collects warnings that any thread gives.
#pragma once

#include <chrono>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "core/platform/error.h"

namespace fieldtrace::test {

struct Warnings {
  std::mutex mutex;
  std::vector<std::string> texts;

  WarningSink sink() {
    return [this](const std::string& text) {
      const std::lock_guard lock(mutex);
      texts.push_back(text);
    };
  }
  size_t count() {
    const std::lock_guard lock(mutex);
    return texts.size();
  }
  // Waits for the first one for up to 20 s.
  bool wait() {
    for (int i = 0; i < 2000 && count() == 0; ++i) std::this_thread::sleep_for(std::chrono::milliseconds(10));
    return count() > 0;
  }
};

}  // namespace fieldtrace::test
