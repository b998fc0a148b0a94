// Affine functions of a point as rows of four, from 3 x 4 matrices by columns. Thread-safety: pure functions.
#pragma once

#include "core/math/math.h"

namespace fieldtrace {

inline Vec3 row_of(const float m[12], int r) { return {m[r], m[3 + r], m[6 + r]}; }

// The function scale a . (M x + b) + shift of x, of the twelve values of M and b.
inline void write_row(const float m[12], const Vec3& a, float scale, float shift, float row[4]) {
  for (int c = 0; c < 4; ++c) row[c] = scale * (a.x * m[3 * c] + a.y * m[3 * c + 1] + a.z * m[3 * c + 2]);
  row[3] += shift;
}

inline Vec3 transform_by(const float m[12], const Vec3& p) {
  return Vec3(m[0], m[1], m[2]) * p.x + Vec3(m[3], m[4], m[5]) * p.y + Vec3(m[6], m[7], m[8]) * p.z +
         Vec3(m[9], m[10], m[11]);
}
// Of a point on a box, by its coordinates, which are 1 or -1 on the faces, or of a direction: the face, 2 a + s as in
// BoxFaces.
inline int box_face_at(const Vec3& at) {
  const Vec3 off = glm::abs(at);
  const int axis = off.x >= off.y && off.x >= off.z ? 0 : off.y >= off.z ? 1 : 2;
  return 2 * axis + (at[axis] < 0.0f ? 1 : 0);
}
// The part of a coordinate's gradient that lies in the plane of a normal of any length.
inline Vec3 gradient_within(const Vec3& gradient, const Vec3& normal) {
  return gradient - normal * (glm::dot(gradient, normal) / glm::dot(normal, normal));
}
inline Vec3 rotate_by(const float m[12], const Vec3& d) {
  return Vec3(m[0], m[1], m[2]) * d.x + Vec3(m[3], m[4], m[5]) * d.y + Vec3(m[6], m[7], m[8]) * d.z;
}

}  // namespace fieldtrace
