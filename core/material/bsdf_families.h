// The BSDF families behind bsdf.h: each evaluates, gives its density, and samples materials of its kinds, without their
// mask. Directions, units and conventions: bsdf.h. Opaque families require wi.z > 0, and wo.z > 0 to evaluate.
// Thread-safety: pure functions.
#pragma once

#include "core/material/bsdf.h"

namespace fieldtrace::bsdf {

// Smooth and rough metals: bsdf_conductor.cpp.
BsdfSample sample_conductor(const Material& material, const Vec3& wi);
Rgb evaluate_rough_conductor(const Material& material, const Vec3& wi, const Vec3& wo);
float rough_conductor_pdf(const Material& material, const Vec3& wi, const Vec3& wo);
BsdfSample sample_rough_conductor(const Material& material, const Vec3& wi, const Vec2& u);

// Interfaces that transmit light: bsdf_dielectric.cpp. Any wi and wo.
BsdfSample sample_dielectric(const Material& material, const Vec3& wi, float u_lobe);
BsdfSample sample_thin_dielectric(const Material& material, const Vec3& wi, float u_lobe);
Rgb evaluate_rough_dielectric(const Material& material, const Vec3& wi, const Vec3& wo);
float rough_dielectric_pdf(const Material& material, const Vec3& wi, const Vec3& wo);
BsdfSample sample_rough_dielectric(const Material& material, const Vec3& wi, const Vec2& u, float u_lobe);

// Diffuse body under a smooth or rough interface: bsdf_plastic.cpp.
Rgb evaluate_plastic(const Material& material, const Vec3& wi, const Vec3& wo);
float plastic_pdf(const Material& material, const Vec3& wi, const Vec3& wo);
BsdfSample sample_plastic(const Material& material, const Vec3& wi, const Vec2& u, float u_lobe);
Rgb evaluate_rough_plastic(const Material& material, const Vec3& wi, const Vec3& wo);
float rough_plastic_pdf(const Material& material, const Vec3& wi, const Vec3& wo);
BsdfSample sample_rough_plastic(const Material& material, const Vec3& wi, const Vec2& u, float u_lobe);

// bsdf_principled.cpp
Rgb evaluate_principled(const Material& material, const Vec3& wi, const Vec3& wo);
float principled_pdf(const Material& material, const Vec3& wi, const Vec3& wo);
BsdfSample sample_principled(const Material& material, const Vec3& wi, const Vec2& u, float u_lobe);

// Samples a direction about +z with density z / pi.
Vec3 sample_cosine(const Vec2& u);

// Microfacet reflection: h is the unit half vector of wi and wo, with wi.h > 0. Walter et al., "Microfacet Models for
// Refraction through Rough Surfaces", EGSR 2007, equation 20, times |wo.z|. `fresnel`: the reflectance at h.
inline float reflection_value(const Microfacet& microfacet, const Vec3& wi, const Vec3& wo, const Vec3& h,
                              float fresnel = 1.0f) {
  const float d = microfacet.d(h);
  if (!(d > 0.0f)) return 0.0f;
  const float g = microfacet.g1(wi, h) * microfacet.g1(wo, h);
  return fresnel * d * g / (4.0f * wi.z);
}

// Solid-angle density of wo for a half vector h sampled from the normals visible from wi: visible_pdf / (4 wi.h), with
// wi.h cancelled. `probability`: of sampling the lobe at all.
inline float reflection_pdf(const Microfacet& microfacet, const Vec3& wi, const Vec3& h, float probability = 1.0f) {
  return probability * microfacet.g1(wi, h) * microfacet.d(h) / (4.0f * wi.z);
}

}  // namespace fieldtrace::bsdf
