// Local shading frames. Thread-safety: values and pure functions.
#pragma once

#include <cmath>

#include "core/math/math.h"

namespace fieldtrace {

// An orthonormal right-handed basis: s x t = n. Local z is the shading normal.
struct Frame {
  Vec3 s = Vec3(1.0f, 0.0f, 0.0f), t = Vec3(0.0f, 1.0f, 0.0f), n = Vec3(0.0f, 0.0f, 1.0f);

  Vec3 to_local(const Vec3& v) const { return {glm::dot(v, s), glm::dot(v, t), glm::dot(v, n)}; }
  Vec3 to_world(const Vec3& v) const { return s * v.x + t * v.y + n * v.z; }
};

// An orthonormal right-handed basis whose third column is the unit vector n (Duff et al., "Building an Orthonormal
// Basis, Revisited", JCGT 6(1), 2017, listing 3); the same as Mitsuba's.
template <class T>
glm::mat<3, 3, T> basis_about(const glm::vec<3, T>& n) {
  using Column = glm::vec<3, T>;
  const T sign = std::copysign(T(1), n.z);
  const T a = T(-1) / (sign + n.z);
  const T b = n.x * n.y * a;
  return {Column(T(1) + sign * n.x * n.x * a, sign * b, -sign * n.x), Column(b, sign + n.y * n.y * a, -n.y), n};
}

inline Frame frame_about(const Vec3& n) {
  const Mat3 basis = basis_about(n);
  return {basis[0], basis[1], basis[2]};
}

// The frame about the unit vector n whose s lies in the plane of n and `tangent` (any length). Falls back to
// frame_about(n) where the tangent is zero or parallel to n.
inline Frame frame_along(const Vec3& n, const Vec3& tangent) {
  const Vec3 s = tangent - n * glm::dot(n, tangent);
  const float length2 = glm::dot(s, s);
  // Below this fraction of the tangent's length, s is all rounding error: 3 products and 4 sums on either side.
  constexpr float k_parallel = gamma_bound(8) * gamma_bound(8);
  if (!(length2 > k_parallel * glm::dot(tangent, tangent))) return frame_about(n);
  const Vec3 unit = s / std::sqrt(length2);
  return {unit, glm::cross(n, unit), n};
}

}  // namespace fieldtrace
