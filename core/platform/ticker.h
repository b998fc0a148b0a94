// Calls a function now and then. Thread-safety: made and destroyed by one thread.
#pragma once

#include <chrono>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <thread>

namespace fieldtrace {

class Ticker {
 public:
  // Calls tick() every `interval` on a thread of its own, until it returns false or this is destroyed, which waits for
  // the call under way. tick() throws nothing. Throws std::system_error if there is no thread to spare.
  Ticker(std::chrono::milliseconds interval, std::function<bool()> tick);
  ~Ticker();
  Ticker(const Ticker&) = delete;
  Ticker& operator=(const Ticker&) = delete;

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  bool ends_ = false;
  std::thread thread_;
};

}  // namespace fieldtrace
