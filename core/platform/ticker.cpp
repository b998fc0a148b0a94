#include "core/platform/ticker.h"

#include <utility>

namespace fieldtrace {

Ticker::Ticker(std::chrono::milliseconds interval, std::function<bool()> tick) {
  thread_ = std::thread([this, interval, tick = std::move(tick)] {
    std::unique_lock lock(mutex_);
    while (!changed_.wait_for(lock, interval, [&] { return ends_; })) {
      lock.unlock();
      if (!tick()) return;
      lock.lock();
    }
  });
}

Ticker::~Ticker() {
  {
    const std::lock_guard lock(mutex_);
    ends_ = true;
  }
  changed_.notify_one();
  thread_.join();
}

}  // namespace fieldtrace
