#include "core/platform/stop_at.h"

#include <algorithm>

namespace fieldtrace {
namespace {

constexpr std::chrono::milliseconds k_poll{5};

}  // namespace

StopAt::StopAt(const std::atomic<bool>* other, std::optional<Clock::time_point> time) : other_(other) {
  if (!time) return;
  watch_ = std::thread([this, end = *time] {
    std::unique_lock lock(mutex_);
    while (!ends_) {
      const Clock::time_point now = Clock::now();
      if (now >= end || (other_ && other_->load(std::memory_order_relaxed))) {
        flag_.store(true, std::memory_order_relaxed);
        return;
      }
      changed_.wait_until(lock, std::min(now + k_poll, end));
    }
  });
}

StopAt::~StopAt() {
  if (!watch_.joinable()) return;
  {
    const std::lock_guard lock(mutex_);
    ends_ = true;
  }
  changed_.notify_one();
  watch_.join();
}

}  // namespace fieldtrace
