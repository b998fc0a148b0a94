// Tests for finite vectors. Thread-safety: pure functions.
#pragma once

#include <cmath>

#include "core/math/math.h"

namespace fieldtrace {

inline bool is_finite(const Vec3& v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

}  // namespace fieldtrace
