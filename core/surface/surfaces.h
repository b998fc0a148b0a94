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

class Surfaces {
 public:
  // `scene` and its `materials` must outlive the object. Throws UsageError if this processor cannot run `isa`.
  Surfaces(const Scene& scene, const MaterialTable& materials, Isa isa);

  // Fills at(i) for each ray i of `indices` as surface_at() does, bit-identically for every instruction set, but uv
  // only if the instance's material varies with it. Unchecked: the caller guarantees a hit there. at() of other rays is
  // unspecified afterwards.
  void evaluate(const RayBatch& rays, const HitBatch& hits, std::span<const uint32_t> indices);

  const SurfacePoint& at(size_t i) const { return surfaces_[i]; }
  // Overrides the surface of ray i of the last evaluate()'s batch, where it is known otherwise than from the scene's
  // triangles.
  void put(size_t i, const SurfacePoint& surface) { surfaces_[i] = surface; }

 private:
  void group_by_instance(const HitBatch& hits, std::span<const uint32_t> indices);

  const Scene& scene_;
  const MaterialTable& materials_;
  Isa isa_;
  std::vector<SurfacePoint> surfaces_;
  std::vector<uint32_t> group_size_;  // by instance; zero between calls
  std::vector<uint32_t> met_;         // instances that were hit
  std::vector<int32_t> places_;       // hits grouped by instance, in the order of met_
};

}  // namespace fieldtrace
