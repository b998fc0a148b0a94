// Vector, matrix and bounds types (GLM) and the few affine helpers that GLM lacks.
//
// Conventions: right-handed; a transform is column-major and acts on column vectors; `Affine` is a 3x4
// matrix whose columns 0..2 are the linear part and whose column 3 is the translation.
// Thread-safety: everything here is a value or a pure function.
#pragma once

#include <cmath>
#include <cstdint>
#include <limits>

#include <glm/glm.hpp>

namespace fieldtrace {

using Vec2 = glm::vec2;
using Vec3 = glm::vec3;
using Mat3 = glm::mat3;
using UVec3 = glm::uvec3;
using DVec3 = glm::dvec3;
using DMat3 = glm::dmat3;

// 3x4 affine transforms; glm::mat4x3 has four columns of three rows.
using Affine = glm::mat4x3;
using DAffine = glm::dmat4x3;

// Linear sRGB (Rec. 709) radiance, reflectance or intensity.
using Rgb = glm::vec3;

inline constexpr float k_infinity = std::numeric_limits<float>::infinity();
inline constexpr float k_pi = 3.14159265358979323846f;

// Bound on the relative error of n consecutive rounded float operations: n u / (1 - n u), with u = 2^-24 (Higham,
// "Accuracy and Stability of Numerical Algorithms", 2002, lemma 3.1).
constexpr float gamma_bound(int n) {
  constexpr float u = 0x1p-24f;
  return (float(n) * u) / (1.0f - float(n) * u);
}

inline float luminance(const Rgb& c) { return 0.2126f * c.x + 0.7152f * c.y + 0.0722f * c.z; }  // IEC 61966-2-1

inline Vec3 transform_point(const Affine& a, const Vec3& p) { return a[0] * p.x + a[1] * p.y + a[2] * p.z + a[3]; }
inline DVec3 transform_point(const DAffine& a, const DVec3& p) { return a[0] * p.x + a[1] * p.y + a[2] * p.z + a[3]; }
inline Vec3 transform_vector(const Affine& a, const Vec3& v) { return a[0] * v.x + a[1] * v.y + a[2] * v.z; }

// a after b: transform_point(compose(a, b), p) == transform_point(a, transform_point(b, p)).
inline DAffine compose(const DAffine& a, const DAffine& b) {
  const DMat3 la(a[0], a[1], a[2]);
  return DAffine(la * b[0], la * b[1], la * b[2], la * b[3] + a[3]);
}

// Inverse of an affine transform. Unchecked: the caller guarantees a linear part of full rank.
inline DAffine inverse_affine(const DAffine& a) {
  const DMat3 inv = glm::inverse(DMat3(a[0], a[1], a[2]));
  return DAffine(inv[0], inv[1], inv[2], -(inv * a[3]));
}

// Axis-aligned box. Empty until a point is added: lower > upper.
struct Bounds3 {
  Vec3 lower = Vec3(k_infinity);
  Vec3 upper = Vec3(-k_infinity);

  bool empty() const { return !(lower.x <= upper.x); }
  void extend(const Vec3& p) {
    lower = glm::min(lower, p);
    upper = glm::max(upper, p);
  }
  void extend(const Bounds3& b) {
    lower = glm::min(lower, b.lower);
    upper = glm::max(upper, b.upper);
  }
  void extend(const Affine& a, const Bounds3& b) {  // by the box b, transformed
    for (int c = 0; c < 8; ++c) extend(transform_point(a, b.corner(c)));
  }
  Vec3 centre() const { return 0.5f * (lower + upper); }
  Vec3 diagonal() const { return upper - lower; }
  // Corner 0 ... 7: bit i of `index` chooses the upper end along axis i.
  Vec3 corner(int index) const {
    return {index & 1 ? upper.x : lower.x, index & 2 ? upper.y : lower.y, index & 4 ? upper.z : lower.z};
  }
};

struct Sphere {
  Vec3 centre = Vec3(0.0f);
  float radius = 0.0f;
};

}  // namespace fieldtrace
