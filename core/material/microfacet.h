// Microfacet distributions (Beckmann and GGX, anisotropic) with sampling of the visible normals.
//
// Sources: D and G: Walter et al., "Microfacet Models for Refraction through Rough Surfaces", EGSR 2007. Masking with
// its exact Lambda: Heitz, "Understanding the Masking-Shadowing Function", JCGT 3(2), 2014. Visible normals: GGX:
// Heitz, "Sampling the GGX Distribution of Visible Normals", JCGT 7(4), 2018; Beckmann: Heitz and d'Eon, "Importance
// Sampling Microfacet-Based BSDFs using the Distribution of Visible Normals", EGSR 2014, with the slope's CDF inverted
// by a bracketed Newton iteration. Beckmann's masking is the exact one and not Walter's rational fit, so that
// sampling and density agree; the fit differs by less than 0.4 %.
// Space: local shading frame, normal +z. Thread-safety: values and pure functions.
#pragma once

#include "core/scene/scene.h"

namespace fieldtrace {

// The smallest roughness that differs from a mirror, as in Mitsuba. D reaches 1 / (pi alpha^2) = 3e7, and (m.x /
// alpha)^2 keeps 7 digits, so single precision suffices.
inline constexpr float k_min_alpha = 1e-4f;

struct Microfacet {
  MicrofacetKind kind = MicrofacetKind::ggx;
  float alpha_u = 0.1f, alpha_v = 0.1f;  // along local x and y, >= k_min_alpha

  bool operator==(const Microfacet&) const = default;

  // Density of microfacet normals per projected solid angle: the integral of D(m) m.z over the hemisphere is 1.
  float d(const Vec3& m) const;

  // Smith masking of direction w at microfacet m, in [0, 1]; 0 where w lies behind m or below the surface.
  float g1(const Vec3& w, const Vec3& m) const;

  // Density of visible normals: g1(w, m) |w.m| D(m) / w.z. Zero for w.z <= 0.
  float visible_pdf(const Vec3& w, const Vec3& m) const;

  // Samples a unit normal with density visible_pdf(w, .). w is unit with w.z > 0; u in [0, 1)^2.
  Vec3 sample_visible(const Vec3& w, const Vec2& u) const;
};

}  // namespace fieldtrace
