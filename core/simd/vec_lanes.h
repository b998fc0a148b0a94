// Conversion between vectors and single-lane values of generic code (core/simd/lanes.hd.h). Thread-safety: pure
// functions.
#pragma once

#include "core/math/math.h"
#include "core/simd/lanes.hd.h"

namespace fieldtrace {

inline scalar::Vec3Lanes<float> lanes(const Vec3& v) { return {v.x, v.y, v.z}; }
inline Vec3 to_vec(const scalar::Vec3Lanes<float>& v) { return {v.x, v.y, v.z}; }

}  // namespace fieldtrace
