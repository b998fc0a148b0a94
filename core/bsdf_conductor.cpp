// Metals. Rough: Walter et al., "Microfacet Models for Refraction through Rough Surfaces", EGSR 2007, equation 20, with
// the conductor's Fresnel term and visible normals.

#include "core/bsdf_families.h"
#include "core/conductor.hd.h"
#include "core/refraction.h"

namespace fieldtrace::bsdf {
namespace {

// As a batch does it (core/conductor_samples.h), bit for bit.
BsdfSample sample_ggx(const Material& material, const Vec3& wi, const Vec2& u) {
  const auto lanes = [](const Vec3& v) { return scalar::Vec3Lanes<float>{v.x, v.y, v.z}; };
  const Microfacet& microfacet = material.microfacet;
  const auto view = scalar::ggx_view(microfacet.alpha_u, microfacet.alpha_v, lanes(wi));
  const auto sampled =
      scalar::sample_conductor_lobe<float>(view, lanes(wi), lanes(material.eta), lanes(material.k), {u.x, u.y});
  BsdfSample s;
  if (!(sampled.pdf > 0.0f)) return s;
  s.wo = {sampled.wo.x, sampled.wo.y, sampled.wo.z};
  s.pdf = sampled.pdf;
  s.weight = material.reflectance * Rgb(sampled.weight.x, sampled.weight.y, sampled.weight.z);
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
  const float d = material.microfacet.d(h);
  if (!(d > 0.0f)) return Rgb(0.0f);
  const float g = material.microfacet.g1(wi, h) * material.microfacet.g1(wo, h);
  return material.reflectance * fresnel_conductor(glm::dot(wi, h), material.eta, material.k) * (d * g / (4.0f * wi.z));
}

float rough_conductor_pdf(const Material& material, const Vec3& wi, const Vec3& wo) {
  const Vec3 h = glm::normalize(wi + wo);
  // visible_pdf / (4 wi.h), with wi.h cancelled.
  return material.microfacet.g1(wi, h) * material.microfacet.d(h) / (4.0f * wi.z);
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
