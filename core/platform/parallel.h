// Parallel loops over TBB, and work in arenas.
//
// TBB guarantees that writes before a loop are visible inside it, and writes inside it after it. TBB's own
// synchronisation is invisible to a thread sanitizer, so these guarantees are repeated in instrumented atomics.
// Thread-safety: loops may be nested and may run concurrently.
#pragma once

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <cstddef>

namespace fieldtrace {

// Everything written before give() is visible after a later take() on any thread.
class Handover {
 public:
  void give() { turns_.fetch_add(1, std::memory_order_release); }
  void take() const { turns_.load(std::memory_order_acquire); }

 private:
  std::atomic<unsigned> turns_ = 0;
};

// Calls body(i) for i in [0, count), each as a separate task, which pays off from about 100 microseconds per call.
// Returns when all are done; rethrows the first exception, after which some calls may not have been made.
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

// Calls body(first, end) for parts of [0, count), each as a separate task: for elements that take a microsecond or so.
template <class Body>
void parallel_for_parts(size_t count, const Body& body) {
  constexpr size_t k_part = 64;
  parallel_for((count + k_part - 1) / k_part,
               [&](size_t part) { body(part * k_part, std::min((part + 1) * k_part, count)); });
}

// As parallel_for, for bodies that use scratch memory of their thread and wait within, for a bake or an inner loop: a
// thread that waits begins no other call.
template <class Body>
void parallel_for_isolated(size_t count, const Body& body) {
  parallel_for(count, [&](size_t i) { tbb::this_task_arena::isolate([&] { body(i); }); });
}

// arena.execute(body): where the arena is full, another of its threads calls body() while this one waits. Rethrows what
// body() throws.
template <class Body>
void execute_in(tbb::task_arena& arena, const Body& body) {
  Handover begun, done;
  // Also where body() throws.
  struct Give {
    Handover& handover;
    ~Give() { handover.give(); }
  };
  struct Take {
    const Handover& handover;
    ~Take() { handover.take(); }
  };
  begun.give();
  const Take take{done};
  arena.execute([&] {
    begun.take();
    const Give give{done};
    body();
  });
}

}  // namespace fieldtrace
