// Closed-form irradiance of whole, unoccluded lights, for diffuse surfaces, many at once in SIMD lanes.
//
// Method: light_irradiance.hd.h. Thread-safety: pure functions.
#pragma once

#include "core/light/light.hd.h"
#include "core/light/shading_points.h"
#include "core/platform/aligned_vector.h"
#include "core/simd/isa.h"

namespace fieldtrace {

// irradiance[r] receives the irradiance (integral of the cosine over solid angle, sr) at shading point r from the
// unoccluded light, of radiance 1: for spheres seen from outside and for rectangles. Below 0 for other kinds, and where
// the light is not wholly above the horizons of both normals. Resized to the batch, padded. Relative error below 1e-7,
// most of it the rounding to floats; the same bits for every `isa`, which must be resolved.
void whole_irradiance(const Light& light, const ShadingPointBatch& points, Isa isa, AlignedVector<float>& irradiance);

}  // namespace fieldtrace
