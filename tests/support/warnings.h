// Collects warnings that any thread gives.
#pragma once

#include <mutex>
#include <string>
#include <vector>

#include "core/platform/error.h"
#include "tests/support/waiting.h"

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
    return comes_true([&] { return count() > 0; });
  }
};

}  // namespace fieldtrace::test
