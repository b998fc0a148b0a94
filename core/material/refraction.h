// Reflected and refracted directions at smooth interfaces and microfacets. Normals m are unit and otherwise arbitrary;
// all directions point away from the surface. Thread-safety: pure functions.
#pragma once

#include "core/material/fresnel.h"

namespace fieldtrace {

// Reflection about the local normal +z.
inline Vec3 mirror(const Vec3& w) { return {-w.x, -w.y, w.z}; }

inline Vec3 reflect(const Vec3& wi, const Vec3& m) { return glm::normalize(2.0f * glm::dot(wi, m) * m - wi); }

// `f` = fresnel_dielectric(dot(wi, m), ...). Undefined under total internal reflection.
inline Vec3 refract(const Vec3& wi, const Vec3& m, const DielectricFresnel& f) {
  const float ratio = f.eta_incident_over_transmitted;
  return glm::normalize(m * (glm::dot(wi, m) * ratio + f.cos_transmitted) - wi * ratio);
}

}  // namespace fieldtrace
