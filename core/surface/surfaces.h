// Surfaces at all hits of a batch at once, in SIMD lanes: hits on one instance of a mesh side by side, analytic shapes
// one by one. Thread-safety: a Surfaces belongs to one thread.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/material/material_table.h"
#include "core/simd/isa.h"
#include "core/surface/surface.h"

namespace fieldtrace {

class Surfaces {
 public:
  // `scene` and `materials`, which are the scene's, must outlive the object. Throws UsageError if this processor cannot
  // run `isa`.
  Surfaces(const Scene& scene, const MaterialTable& materials, Isa isa);

  // Fills at(i) for each ray i of `indices` as surface_at() does, the same bits for every instruction set; but uv only
  // where the instance's material varies with it. Unchecked: the caller guarantees a hit there. What at() said of other
  // rays is no longer specified.
  void evaluate(const RayBatch& rays, const HitBatch& hits, std::span<const uint32_t> indices);

  const SurfacePoint& at(size_t i) const { return surfaces_[i]; }
  // For what is known of a hit better than from the scene: a ray of the batch of the last evaluate().
  void put(size_t i, const SurfacePoint& surface) { surfaces_[i] = surface; }

 private:
  void group_by_instance(const HitBatch& hits, std::span<const uint32_t> indices);

  const Scene& scene_;
  const MaterialTable& materials_;
  Isa isa_;
  std::vector<SurfacePoint> surfaces_;
  std::vector<uint32_t> group_size_;  // by instance; zero between calls
  std::vector<uint32_t> met_;         // instances that were hit
  std::vector<int32_t> places_;       // hits in the order of met_
};

}  // namespace fieldtrace
