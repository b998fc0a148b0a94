// Points that hardly see the sky: cells do not quite add up to it, and where they take all of it nothing must be left.
//
// Thread-safety: distinct objects are independent.
#pragma once

#include <span>
#include <vector>

#include "core/light/shading_points.h"
#include "core/platform/aligned_vector.h"
#include "core/simd/isa.h"
#include "field/maps/cell_lights.h"
#include "hybrid/sky/sky.h"

namespace fieldtrace {

class EnclosedPoints {
 public:
  // Scales `hidden`, the irradiance that cells take from the points of one instance, so that all cells together take
  // all of the sky: fully where they take half of it. `open`: the luminance of the open sky's irradiance, by point;
  // `isa` must be resolved.
  void scale(const Sky& sky, const ShadingPointBatch& points, std::span<const float> open, Isa isa,
             const CellLightSums& hidden);

 private:
  std::vector<uint32_t> points_;
  AlignedVector<float> normals_[3], sums_[3];  // of these: the sums of all cells' irradiance
};

}  // namespace fieldtrace
