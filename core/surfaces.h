// Surfaces at all hits of a batch at once, in SIMD lanes: hits on one instance of a mesh side by side, analytic shapes
// one by one. Thread-safety: a Surfaces belongs to one thread.
#pragma once

#include <cstdint>
#include <vector>

#include "core/isa.h"
#include "core/surface.h"

namespace fieldtrace {

class Surfaces {
 public:
  // `scene` must outlive the object. Throws UsageError if this processor cannot run `isa`.
  Surfaces(const Scene& scene, Isa isa);

  // Fills at(i) for every ray i that hit something, as surface_at() does, the same bits for every instruction set; but
  // uv only where the instance's material looks at it.
  void evaluate(const RayBatch& rays, const HitBatch& hits);

  const SurfacePoint& at(size_t i) const { return surfaces_[i]; }  // until the next evaluate()
  // For what is known of a hit better than from the scene.
  void put(size_t i, const SurfacePoint& surface) { surfaces_[i] = surface; }
  size_t count() const { return places_.size(); }  // of the rays that hit something

 private:
  void group_by_instance(size_t count, const HitBatch& hits);

  const Scene& scene_;
  Isa isa_;
  std::vector<uint8_t> textured_;     // by material
  std::vector<SurfacePoint> surfaces_;
  std::vector<uint32_t> group_size_;  // by instance; zero between calls
  std::vector<uint32_t> met_;         // instances that were hit
  std::vector<int32_t> places_;       // hits in the order of met_
};

}  // namespace fieldtrace
