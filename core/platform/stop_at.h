// A stop flag that is set at a time. Thread-safety: made and destroyed by one thread; any number may read the flag.
#pragma once

#include <atomic>
#include <chrono>
#include <optional>

#include "core/platform/ticker.h"

namespace fieldtrace {

class StopAt {
 public:
  using Clock = std::chrono::steady_clock;

  // Its flag is `other` (may be null) without a time; else one that is set soon after `other` is, or at `time`.
  StopAt(const std::atomic<bool>* other, std::optional<Clock::time_point> time);
  StopAt(const StopAt&) = delete;
  StopAt& operator=(const StopAt&) = delete;

  const std::atomic<bool>* flag() const { return watch_ ? &flag_ : other_; }
  bool is_set() const { return flag() && flag()->load(std::memory_order_relaxed); }

 private:
  const std::atomic<bool>* other_;
  std::atomic<bool> flag_ = false;
  std::optional<Ticker> watch_;
};

}  // namespace fieldtrace
