// One line on a terminal with the progress of long work and an estimate of the remaining time.
//
// Thread-safety: one thread at a time.
#pragma once

#include <chrono>
#include <string>

namespace fieldtrace {

class ProgressLine {
 public:
  // Shows nothing unless stderr is a terminal and `enabled`.
  explicit ProgressLine(bool enabled);
  ~ProgressLine() { clear(); }
  ProgressLine(const ProgressLine&) = delete;
  ProgressLine& operator=(const ProgressLine&) = delete;

  // share: fraction of the whole work done, in [0, 1]. Redraws at most ten times a second.
  void update(double share, const std::string& stage);

  // Removes the line so that something else can be printed; the next update draws it again.
  void clear();

  // Restarts the estimate for a second piece of work.
  void restart();

 private:
  using Clock = std::chrono::steady_clock;

  bool enabled_ = false;
  bool drawn_ = false;
  Clock::time_point start_ = Clock::now();
  Clock::time_point last_draw_ = {};
};

}  // namespace fieldtrace
