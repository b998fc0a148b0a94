// Closed-form irradiance of whole, unoccluded lights, for diffuse surfaces, many at once in SIMD lanes.
//
// Method: light_irradiance.hd.h. Memory layout: structures of arrays, padded as the batch. Thread-safety: pure
// functions.
#pragma once

#include "core/light/light.hd.h"
#include "core/light/shading_points.h"
#include "core/platform/aligned_vector.h"
#include "core/simd/isa.h"

namespace fieldtrace {

// Per shading point.
struct IrradianceVectors {
  AlignedVector<float> x, y, z;  // world space; 0 where not known
  AlignedVector<uint8_t> known;  // 1 or 0
};

// The vector irradiance at each point: the integral of the unit direction over the solid angle (sr) of the whole
// unoccluded light of radiance 1. A surface of unit normal n that has the whole light above its horizon receives
// max(0, dot(n, vector)). Reads the positions of `points` only, and resizes `out` to the batch.
//
// Known for spheres from outside, and for rectangles, parallelograms and disks (whose half axes are equal and
// orthogonal to rounding) off their plane: 0 strictly behind it, where they emit nothing. On the plane, to 2^-50 of the
// distance, nothing is known: beside the light the vector would be 0, on the light it has no limit. Unknown for other
// kinds.
//
// Error below 1e-7 of the vector's length, most of it the rounding to floats, for lights of any size (down to vectors
// of length 2^-125) seen from a height over their plane of at least 1/1000 of the distance to their farthest corner.
// (Lower down the arctangents, good to 1e-11, cancel: divide that by height over distance.) The same bits for every
// `isa`, which must be resolved.
void irradiance_vectors(const Light& light, const ShadingPointBatch& points, Isa isa, IrradianceVectors& out);

// irradiance[r] receives the irradiance (integral of the cosine over solid angle, sr) at shading point r from the
// unoccluded light, of radiance 1: for spheres seen from outside and for rectangles. Below 0 for other kinds, and where
// the light is not wholly above the horizons of both normals. Resized to the batch, padded. Relative error below 1e-7,
// most of it the rounding to floats; the same bits for every `isa`, which must be resolved.
void whole_irradiance(const Light& light, const ShadingPointBatch& points, Isa isa, AlignedVector<float>& irradiance);

}  // namespace fieldtrace
