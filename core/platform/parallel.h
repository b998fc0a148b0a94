// Parallel loops over TBB.
//
// TBB promises that what a thread wrote before a loop is seen inside it, and what the loop wrote is seen after it. Its
// library holds those promises where a thread sanitizer cannot look, so they are repeated here in atomics that it can.
// Thread-safety: loops may be nested and may run side by side.
#pragma once

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <atomic>
#include <cstddef>

namespace fieldtrace {

// What a thread wrote before give() is seen by every thread whose take() comes after it in time.
class Handover {
 public:
  void give() { turns_.fetch_add(1, std::memory_order_release); }
  void take() const { turns_.load(std::memory_order_acquire); }

 private:
  std::atomic<unsigned> turns_ = 0;
};

// Calls body(i) for i in [0, count), each as a task of its own: worth it from some 100 microseconds a call. Returns
// when all are done; rethrows the first exception, after which some calls may not have been made.
template <class Body>
void parallel_for(size_t count, const Body& body) {
  Handover begun, done;
  begun.give();
  tbb::parallel_for(
      tbb::blocked_range<size_t>(0, count, 1),
      [&](const tbb::blocked_range<size_t>& range) {
        begun.take();
        for (size_t i = range.begin(); i < range.end(); ++i) body(i);
        done.give();
      },
      tbb::simple_partitioner());
  done.take();
}

}  // namespace fieldtrace
