// Thread-safety: pure functions.
#pragma once

#include <cmath>

#include "core/math/math.h"

namespace fieldtrace {

// No component is infinite or not a number.
inline bool is_finite(const Vec3& v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

}  // namespace fieldtrace
