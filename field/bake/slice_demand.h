// When to bake a slice for rays that may not come again: once those that asked for it in vain have cost about what its
// bake costs. So whatever rays come, asking and baking together cost at most about twice what the better of tracing all
// of them and baking first would (the ski-rental rule). Of lights, whose rays come back to the same slices, that is a
// few per cent more than baking at once; of rays all over the place it is the difference between a ray and a bake.
//
// Thread-safety: count() may be called from any number of threads. Which of them finds a slice due depends on their
// order.
#pragma once

#include <atomic>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <vector>

#include "field/store/field.h"

namespace fieldtrace {

// Rays of a bake, which go in packets of one direction, that cost as much as one exact ray of a batch
// (docs/decisions/035-bakes-that-wait.md).
inline constexpr uint32_t k_bake_rays_of_ray = 4;

class SliceDemand {
 public:
  // Throws std::bad_alloc. 6 bytes a slice of the chart, of which the system provides pages as they are written.
  explicit SliceDemand(const Field& field);

  // `slices`: one entry for each ray that asked. Counts them and keeps those that are due, sorted, without repeats.
  void count(FieldLayer layer, std::vector<uint32_t>& slices);
  // From now on all slices are due: of a field that was baked ahead of its rays.
  void stop_waiting() { waits_.store(false, std::memory_order_relaxed); }

 private:
  struct Free {
    void operator()(uint16_t* p) const { std::free(p); }
  };
  uint32_t slices_ = 0;
  uint32_t due_[k_field_layers] = {};  // by layer: from this many rays on
  std::unique_ptr<uint16_t[], Free> asked_;
  std::atomic<bool> waits_ = true;
};

}  // namespace fieldtrace
