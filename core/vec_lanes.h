// Vectors as the single lane of generic code (core/lanes.hd.h), and back. Thread-safety: pure functions.
#pragma once

#include "core/lanes.hd.h"
#include "core/math.h"

namespace fieldtrace {

inline scalar::Vec3Lanes<float> lanes(const Vec3& v) { return {v.x, v.y, v.z}; }
inline Vec3 to_vec(const scalar::Vec3Lanes<float>& v) { return {v.x, v.y, v.z}; }

}  // namespace fieldtrace
