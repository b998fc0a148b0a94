// Metals. Rough: microfacet reflection with the conductor's Fresnel term, sampled by visible normals.

#include "core/material/bsdf_families.h"
#include "core/material/conductor.hd.h"
#include "core/material/refraction.h"
#include "core/simd/vec_lanes.h"

namespace fieldtrace::bsdf {
namespace {

// Bit-identical to the batch version (core/material/conductor_samples.h).
BsdfSample sample_ggx(const Material& material, const Vec3& wi, const Vec2& u) {
  const Microfacet& microfacet = material.microfacet;
  const auto view = scalar::ggx_view(microfacet.alpha_u, microfacet.alpha_v, lanes(wi));
  const auto sampled =
      scalar::sample_conductor_lobe<float>(view, lanes(wi), lanes(material.eta), lanes(material.k), {u.x, u.y});
  BsdfSample s;
  if (!(sampled.pdf > 0.0f)) return s;
  s.wo = to_vec(sampled.wo);
  s.pdf = sampled.pdf;
  s.weight = material.reflectance * to_vec(sampled.weight);
  return s;
}

}  // namespace

BsdfSample sample_conductor(const Material& material, const Vec3& wi) {
  BsdfSample s;
  s.wo = mirror(wi);
  s.weight = material.reflectance * fresnel_conductor(wi.z, material.eta, material.k);
  s.pdf = 1.0f;
  s.delta = true;
  return s;
}

Rgb evaluate_rough_conductor(const Material& material, const Vec3& wi, const Vec3& wo) {
  const Vec3 h = glm::normalize(wi + wo);
  const float value = reflection_value(material.microfacet, wi, wo, h);
  if (!(value > 0.0f)) return Rgb(0.0f);
  return material.reflectance * fresnel_conductor(glm::dot(wi, h), material.eta, material.k) * value;
}

float rough_conductor_pdf(const Material& material, const Vec3& wi, const Vec3& wo) {
  return reflection_pdf(material.microfacet, wi, glm::normalize(wi + wo));
}

BsdfSample sample_rough_conductor(const Material& material, const Vec3& wi, const Vec2& u) {
  if (material.microfacet.kind == MicrofacetKind::ggx) return sample_ggx(material, wi, u);
  BsdfSample s;
  const Vec3 m = material.microfacet.sample_visible(wi, u);
  const float wi_m = glm::dot(wi, m);
  s.wo = reflect(wi, m);
  if (!(s.wo.z > 0.0f) || !(wi_m > 0.0f)) return s;
  s.pdf = rough_conductor_pdf(material, wi, s.wo);
  if (!(s.pdf > 0.0f)) return s;
  s.weight = material.reflectance * fresnel_conductor(wi_m, material.eta, material.k) * material.microfacet.g1(s.wo, m);
  return s;
}

}  // namespace fieldtrace::bsdf
