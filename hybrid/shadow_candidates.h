// Which instances can stand between a group of receivers and a light: conservative culling for whole batches of rays.
//
// Space: world. Memory layout: one array per coordinate, so that the tests over thousands of instances vectorise.
// Thread-safety: const after construction.
#pragma once

#include <cstdint>
#include <vector>

#include "core/math.h"
#include "core/scene.h"

namespace fieldtrace {

// Where a batch's rays end: in a box (area and point lights), or at infinity in one direction or in all.
struct LightExtent {
  enum class Kind { bounded, directional, everywhere };
  Kind kind = Kind::bounded;
  Bounds3 bounds;              // bounded
  Vec3 towards = Vec3(0.0f);   // directional: unit, from the receivers to the light
  uint32_t instance = k_none;  // the light's own instance where it cannot block its own samples, else none
};

LightExtent light_extent(const Scene& scene, uint32_t emitter, const Bounds3& bounds);

class ShadowCandidates {
 public:
  explicit ShadowCandidates(const Scene& scene);

  // Instances whose bounding sphere and box meet the hull of `receivers` and the light, in index order. Stops after
  // `limit` + 1 of them: the caller then treats the batch as having too many.
  void select(const Bounds3& receivers, const LightExtent& light, size_t limit, std::vector<uint32_t>& instances) const;

 private:
  std::vector<float> cx_, cy_, cz_, radius_;
  std::vector<Bounds3> bounds_;
};

}  // namespace fieldtrace
