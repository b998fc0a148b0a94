#include "core/platform/stop_at.h"

namespace fieldtrace {
namespace {

constexpr std::chrono::milliseconds k_poll{5};

}  // namespace

StopAt::StopAt(const std::atomic<bool>* other, std::optional<Clock::time_point> time) : other_(other) {
  if (!time) return;
  flag_ = Clock::now() >= *time;
  watch_.emplace(k_poll, [this, end = *time] {
    const bool stops = Clock::now() >= end || (other_ && other_->load(std::memory_order_relaxed));
    if (stops) flag_.store(true, std::memory_order_relaxed);
    return !stops;
  });
}

}  // namespace fieldtrace
