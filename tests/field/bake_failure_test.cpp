// A baking thread that runs out of memory must not leave the threads that wait for its slices waiting forever.
#include <gtest/gtest.h>

#include <chrono>
#include <cstdlib>
#include <future>
#include <new>
#include <numeric>
#include <thread>

#include "core/mesh/mesh_procedural.h"
#include "field/bake/bake.h"
#include "tests/support/field_fixture.h"

namespace {
// Allocations that this thread may still make; negative: any number.
thread_local int allocations_left = -1;
}  // namespace

// Not inlined: GCC would take the pairs of malloc and delete that it then sees for a mistake.
[[gnu::noinline]] void* operator new(std::size_t size) {
  if (allocations_left == 0) throw std::bad_alloc();
  if (allocations_left > 0) --allocations_left;
  if (void* p = std::malloc(size)) return p;
  throw std::bad_alloc();
}
[[gnu::noinline]] void operator delete(void* p) noexcept { std::free(p); }
[[gnu::noinline]] void operator delete(void* p, std::size_t) noexcept { std::free(p); }

namespace fieldtrace {
namespace {

TEST(BakeFailure, SlicesOfAFailedBakerAreBakedByOthers) {
  for (const FieldLayer layer : {FieldLayer::visibility, FieldLayer::depth}) {
    FieldFixture f(make_sphere({.around = 32, .along = 16}), {.directions = 32, .plane = 64});
    std::vector<uint32_t> slices(64);
    std::iota(slices.begin(), slices.end(), f.field().slice_count() / 2);
    int failures = 0;
    for (int allocations = 0; allocations < 12; ++allocations) {
      BakeCounters counters;
      allocations_left = allocations;
      try {
        bake_slices(f.field(), layer, slices, f.accel(), 0, counters);
      } catch (const std::bad_alloc&) {
        ++failures;
      }
      allocations_left = -1;
    }
    EXPECT_GT(failures, 0);
    auto done = std::async(std::launch::async, [&] {
      BakeCounters counters;
      bake_slices(f.field(), layer, slices, f.accel(), 0, counters);
    });
    if (done.wait_for(std::chrono::seconds(20)) != std::future_status::ready) {
      std::fputs("a thread waits for slices that nobody bakes\n", stderr);
      std::_Exit(1);
    }
    for (const uint32_t slice : slices) EXPECT_TRUE(f.field().finished(layer, slice));
  }
}

}  // namespace
}  // namespace fieldtrace
