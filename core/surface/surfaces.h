// Surfaces at all hits of a batch, in SIMD lanes: hits are grouped by mesh instance; analytic shapes are evaluated one
// by one. Thread-safety: a Surfaces belongs to one thread.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/material/material_table.h"
#include "core/simd/isa.h"
#include "core/surface/surface.h"

namespace fieldtrace {

// Rays [begin, end) of a batch, which hit the same instance.
struct HitRun {
  uint32_t begin = 0, end = 0;
};

// Fills `runs` with the runs among the first `count` hits, as long as can be and without misses.
void find_runs(const HitBatch& hits, size_t count, std::vector<HitRun>& runs);

class Surfaces {
 public:
  // `scene` and its `materials` must outlive the object. Throws UsageError if this processor cannot run `isa`.
  Surfaces(const Scene& scene, const MaterialTable& materials, Isa isa);

  // Fills batch() for the rays of `runs`, which ascend, as surface_at() does, bit-identically for every instruction
  // set, but uv only if the instance's material varies with it. Other rays' surfaces are unspecified afterwards.
  void evaluate(const RayBatch& rays, const HitBatch& hits, std::span<const HitRun> runs);

  const SurfaceBatch& batch() const { return surfaces_; }
  // Overrides the surface of ray i of the last evaluate()'s batch, where it is known otherwise than from the scene's
  // triangles.
  void put(size_t i, const SurfacePoint& surface) { surfaces_.set(i, surface); }

 private:
  void group_by_instance(const HitBatch& hits, std::span<const HitRun> runs);

  const Scene& scene_;
  const MaterialTable& materials_;
  Isa isa_;
  SurfaceBatch surfaces_;
  std::vector<uint32_t> group_size_;  // by instance; zero between calls
  std::vector<uint32_t> met_;         // instances that were hit
  std::vector<int32_t> places_;       // hits grouped by instance, in the order of met_
};

}  // namespace fieldtrace
