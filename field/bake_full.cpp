#include "field/bake_full.h"

#include <algorithm>
#include <mutex>
#include <vector>

#include "core/parallel.h"

namespace fieldtrace {
namespace {

// Slices that one task bakes: some milliseconds of work, so that stopping is prompt.
constexpr size_t k_slices_per_task = 64;

// Cells between cell i of n and the middle of its axis: 0 for the two in the middle.
int cells_from_middle(int i, int n) { return i >= n / 2 ? i - n / 2 : n / 2 - 1 - i; }

// The same for the nearest of `count` cells from i on; they never straddle the middle.
int nearest_from_middle(int i, int count, int n) {
  return std::min(cells_from_middle(i, n), cells_from_middle(i + count - 1, n));
}

// The upper half of the directions is the diamond |u| + |v| <= 1: reached if the cell's nearest corner lies in it.
bool direction_reachable(const FieldParameters& p, FieldLayer layer, int u, int v) {
  if (layer == FieldLayer::depth) return true;
  return cells_from_middle(u, p.directions) + cells_from_middle(v, p.directions) <= p.directions / 2;
}

// Of the plane, the unit disk.
bool plane_reachable(const FieldParameters& p, int a0, int b0) {
  const int64_t a = nearest_from_middle(a0, 4, p.plane), b = nearest_from_middle(b0, 8, p.plane);
  return a * a + b * b <= int64_t(p.plane / 2) * (p.plane / 2);
}

}  // namespace

bool slice_reachable(const FieldParameters& p, FieldLayer layer, const SliceAddress& slice) {
  return direction_reachable(p, layer, slice.u, slice.v) && plane_reachable(p, slice.a0, slice.b0);
}

uint64_t reachable_cells(const FieldParameters& p, FieldLayer layer) {
  uint64_t directions = 0, slices = 0;
  for (int u = 0; u < p.directions; ++u) {
    for (int v = 0; v < p.directions; ++v) directions += direction_reachable(p, layer, u, v);
  }
  for (int a = 0; a < p.plane; a += 4) {
    for (int b = 0; b < p.plane; b += 8) slices += plane_reachable(p, a, b);
  }
  return directions * slices * uint64_t(scalar::k_slice_cells);
}

bool bake_full(Field& field, const Accel& accel, uint32_t shape, BakeCounters& counters,
               const FullBakeCallbacks& callbacks) {
  const double total = double(reachable_cells(field.parameters(), FieldLayer::visibility) +
                              reachable_cells(field.parameters(), FieldLayer::depth));
  std::mutex mutex;
  double done = 0.0;
  std::atomic<bool> stopped = false;
  for (const FieldLayer layer : {FieldLayer::visibility, FieldLayer::depth}) {
    const size_t tasks = (field.slice_count() + k_slices_per_task - 1) / k_slices_per_task;
    parallel_for(tasks, [&](size_t task) {
      if (stopped || field.pool_full()) return;
      if (callbacks.stop && callbacks.stop->load(std::memory_order_relaxed)) {
        stopped = true;
        return;
      }
      std::vector<uint32_t> slices;
      const size_t end = std::min<size_t>((task + 1) * k_slices_per_task, field.slice_count());
      for (size_t s = task * k_slices_per_task; s < end; ++s) {
        if (slice_reachable(field.parameters(), layer, field.slice_address(uint32_t(s)))) slices.push_back(uint32_t(s));
      }
      BakeCounters mine;
      bake_slices(field, layer, slices, accel, shape, mine);
      const std::lock_guard lock(mutex);
      counters.rays += mine.rays;
      counters.seconds += mine.seconds;
      done += double(slices.size()) * scalar::k_slice_cells;
      if (callbacks.progress) callbacks.progress(done / total);
    });
  }
  if (field.pool_full()) throw Error("a field of this size does not fit; use a smaller --directions or --plane");
  return !stopped;
}

}  // namespace fieldtrace
