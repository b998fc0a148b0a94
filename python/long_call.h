// Calls of the C interface that take long, tell their progress and can be cancelled, as Python wants them.
//
// The library works on a thread of its own. The caller's, without the GIL, waits for it, and takes the GIL now and then
// to run signal handlers (Ctrl-C raises KeyboardInterrupt) and to call `progress`: Python code never runs on a thread
// of the library. Thread-safety: one such call of a device at a time; others wait for it, and can be cancelled
// meanwhile.
#pragma once

#include <nanobind/nanobind.h>

#include <functional>
#include <mutex>

#include "fieldtrace/fieldtrace.hpp"

namespace fieldtrace::python {

class LongCalls {
 public:
  // Calls work(), and from time to time progress(share), a float in [0, 1], unless it is None; at last progress(1.0).
  // With the GIL. Throws what a signal handler or
  // `progress` raised, which cancels the work, or else what work() threw.
  void run(FTDevice device, const nanobind::object& progress, const std::function<void()>& work);

 private:
  std::mutex one_at_a_time_;
};

}  // namespace fieldtrace::python
