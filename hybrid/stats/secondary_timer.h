// Adds the wall time of a scope, less what is baked within it, to a thread's Stats::time_secondary.
#pragma once

#include "core/platform/stopwatch.h"
#include "hybrid/stats/stats.h"

namespace fieldtrace {

class SecondaryTimer {
 public:
  explicit SecondaryTimer(Stats& stats) : stats_(stats), bake_before_(stats.time_bake), timer_(stats.time_secondary) {}
  ~SecondaryTimer() { stats_.time_secondary -= stats_.time_bake - bake_before_; }
  SecondaryTimer(const SecondaryTimer&) = delete;
  SecondaryTimer& operator=(const SecondaryTimer&) = delete;

 private:
  Stats& stats_;
  double bake_before_;
  ScopedTimer timer_;
};

}  // namespace fieldtrace
