// Places on triangles. Thread-safety: pure functions.
#pragma once

#include <algorithm>

#include "core/math/math.h"

namespace fieldtrace {

// Barycentric coordinates, of the corners p0 + e1 and p0 + e2, of the place on a triangle that is nearest to `p` in its
// plane, clamped to the triangle against rounding; its middle if it has no area.
inline Vec2 barycentric(const DVec3& p0, const DVec3& e1, const DVec3& e2, const DVec3& p) {
  const DVec3 n = glm::cross(e1, e2), d = p - p0;
  const double area = glm::dot(n, n);
  if (!(area > 0.0)) return Vec2(1.0f / 3.0f);
  const double u = std::clamp(glm::dot(glm::cross(d, e2), n) / area, 0.0, 1.0);
  return {float(u), float(std::clamp(glm::dot(glm::cross(e1, d), n) / area, 0.0, 1.0 - u))};
}

}  // namespace fieldtrace
