#include "field/bake/bake_full.h"

#include <algorithm>
#include <mutex>
#include <numeric>
#include <vector>

#include "core/platform/parallel.h"
#include "field/bake/bake_coverage.h"

namespace fieldtrace {
namespace {

// Slices that one task bakes: some milliseconds of work, so that stopping is prompt.
constexpr size_t k_slices_per_task = 64;

// Tiles between two checks of the budget, and tiles of one task.
constexpr uint32_t k_tiles_at_once = 1024;
constexpr uint32_t k_tiles_per_task = 16;

// Cells between cell i of n and the middle of its axis: 0 for the two in the middle.
int cells_from_middle(int i, int n) { return i >= n / 2 ? i - n / 2 : n / 2 - 1 - i; }

// The same for the nearest of `count` cells from i on; they never straddle the middle.
int nearest_from_middle(int i, int count, int n) {
  return std::min(cells_from_middle(i, n), cells_from_middle(i + count - 1, n));
}

// The upper hemisphere is the diamond |u| + |v| <= 1: a cell is reached if its corner nearest to the middle lies in it.
bool direction_reachable(const FieldParameters& p, FieldLayer layer, int u, int v) {
  if (layer == FieldLayer::depth) return true;
  return cells_from_middle(u, p.directions) + cells_from_middle(v, p.directions) <= p.directions / 2;
}

// Of the plane, only the unit disk is reached.
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

uint64_t full_brick_bytes(const FieldParameters& p) {
  uint64_t plane_bricks = 0;
  for (int a = 0; a < p.plane; a += 4) {
    for (int b = 0; b < p.plane; b += 8) plane_bricks += plane_reachable(p, a, b);
  }
  const uint64_t tables_of_page = uint64_t(p.plane / 4) * uint64_t(p.plane / 8) * sizeof(int32_t);
  uint64_t bytes = 0;
  for (int u = 0; u < p.directions; u += 4) {
    for (int v = 0; v < p.directions; v += 4) {
      bool has_visibility = false;
      for (int i = 0; i < 16; ++i) {
        has_visibility = has_visibility || direction_reachable(p, FieldLayer::visibility, u + i / 4, v + i % 4);
      }
      bytes += sizeof(int32_t) + tables_of_page + plane_bricks * Field::brick_bytes(FieldLayer::depth);
      if (has_visibility) bytes += plane_bricks * Field::brick_bytes(FieldLayer::visibility);
    }
  }
  return bytes;
}

namespace {

// One full bake. Progress counts lines, those of cells and those of tiles.
class FullBaker {
 public:
  FullBaker(Field& field, const Accel& accel, uint32_t shape, BakeCounters& counters,
            const FullBakeCallbacks& callbacks)
      : field_(field), accel_(accel), shape_(shape), counters_(counters), callbacks_(callbacks) {
    const FieldParameters& p = field.parameters();
    total_ =
        double(p.lines) * double(reachable_cells(p, FieldLayer::visibility) + reachable_cells(p, FieldLayer::depth));
    total_ += double(field.coverage().slot_count()) * CoverageTiles::k_lines_per_tile;
  }

  void bake_layer(FieldLayer layer) {
    const size_t tasks = (field_.slice_count() + k_slices_per_task - 1) / k_slices_per_task;
    parallel_for(tasks, [&](size_t task) {
      if (is_stopped() || field_.pool_full()) return;
      std::vector<uint32_t> slices;
      const size_t end = std::min<size_t>((task + 1) * k_slices_per_task, field_.slice_count());
      for (size_t s = task * k_slices_per_task; s < end; ++s) {
        if (slice_reachable(field_.parameters(), layer, field_.slice_address(uint32_t(s)))) {
          slices.push_back(uint32_t(s));
        }
      }
      BakeCounters mine;
      bake_slices(field_, layer, slices, accel_, shape_, mine);
      add(mine, double(slices.size()) * scalar::k_slice_cells * field_.parameters().lines);
    });
  }

  // Returns the number of tiles left out for lack of memory.
  uint64_t bake_tiles() {
    const uint32_t count = field_.coverage().slot_count();
    for (uint32_t begin = 0; begin < count; begin += k_tiles_at_once) {
      const uint32_t end = std::min(begin + k_tiles_at_once, count);
      const uint32_t missing = missing_tiles(begin, end);
      // Which of these tiles take memory is known only once they are baked. Requiring room for all of them keeps what
      // is baked independent of the threads' timing.
      if (missing > 0 && !has_room(missing)) return missing_tiles(begin, count);
      parallel_for((end - begin + k_tiles_per_task - 1) / k_tiles_per_task, [&](size_t task) {
        if (is_stopped()) return;
        const uint32_t first = begin + uint32_t(task) * k_tiles_per_task;
        std::vector<uint32_t> slots(std::min(k_tiles_per_task, end - first));
        std::iota(slots.begin(), slots.end(), first);
        BakeCounters mine;
        bake_coverage(field_, slots, accel_, shape_, mine);
        add(mine, double(slots.size()) * CoverageTiles::k_lines_per_tile);
      });
      if (stopped_) return 0;
    }
    return 0;
  }

  bool stopped() const { return stopped_; }

 private:
  uint32_t missing_tiles(uint32_t begin, uint32_t end) const {
    uint32_t missing = 0;
    for (uint32_t slot = begin; slot < end; ++slot) missing += !field_.coverage().finished(slot);
    return missing;
  }
  bool is_stopped() {
    if (callbacks_.stop && callbacks_.stop->load(std::memory_order_relaxed)) stopped_ = true;
    return stopped_;
  }
  bool has_room(uint32_t tiles) const {
    const FieldBudget* const budget = field_.budget();
    const uint64_t bytes = uint64_t(tiles) * (CoverageTiles::k_tile_bytes + sizeof(int32_t));
    if (field_.coverage().room() < tiles) return false;
    return !field_.coverage().full() && (!budget || bytes <= budget->limit() - budget->used());
  }
  void add(const BakeCounters& mine, double lines) {
    const std::lock_guard lock(mutex_);
    counters_.rays += mine.rays;
    counters_.seconds += mine.seconds;
    done_ += lines;
    if (callbacks_.progress) callbacks_.progress(done_ / total_);
  }

  Field& field_;
  const Accel& accel_;
  uint32_t shape_;
  BakeCounters& counters_;
  const FullBakeCallbacks& callbacks_;
  std::mutex mutex_;
  double done_ = 0.0, total_ = 0.0;
  std::atomic<bool> stopped_ = false;
};

}  // namespace

FullBakeResult bake_full(Field& field, const Accel& accel, uint32_t shape, BakeCounters& counters,
                         const FullBakeCallbacks& callbacks) {
  const uint64_t needed = full_brick_bytes(field.parameters());
  const FieldBudget* const budget = field.budget();
  const auto fail = [&] {
    throw Error("all cells of a field of this size take " + std::to_string((needed + 999999) / 1000000) +
                " MB of memory, more than there is for them; use a smaller --directions or --plane, or raise "
                "--field-memory");
  };
  const auto fail_for_addresses = [] {
    throw Error(
        "all cells of a field of this size take more address space than may be reserved; raise the limit "
        "(ulimit -v), or use a smaller --directions or --plane");
  };
  // The field's own bricks are a part of what it needs.
  if (budget && needed > budget->limit() - std::min(budget->used(), budget->limit()) + field.bytes()) fail();
  FullBaker baker(field, accel, shape, counters, callbacks);
  baker.bake_layer(FieldLayer::visibility);
  baker.bake_layer(FieldLayer::depth);
  if (budget && budget->out_of_addresses()) fail_for_addresses();
  if (field.pool_full()) fail();
  FullBakeResult result;
  result.tiles_left_out = baker.bake_tiles();
  result.stopped = baker.stopped();
  return result;
}

}  // namespace fieldtrace
