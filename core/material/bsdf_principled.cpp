// The principled material, reduced to its opaque lobes: diffuse with retro-reflection, main specular (GGX), clearcoat.
//
// Source: Burley, "Physically Based Shading at Disney", SIGGRAPH 2012 courses, and "Extending the Disney BRDF to a BSDF
// with Integrated Subsurface Scattering", SIGGRAPH 2015 courses, sections 5.3 and 5.4. Where these leave a choice, it
// follows Mitsuba's plugin `principled`: the dielectric part of the main lobe has the exact Fresnel term, and the
// clearcoat lacks the factor 1 / (4 cos cos).

#include <algorithm>
#include <cmath>

#include "core/material/bsdf_families.h"
#include "core/material/refraction.h"

namespace fieldtrace::bsdf {
namespace {

// The clearcoat's masking has a fixed roughness, and its energy is scaled by a quarter.
constexpr float k_clearcoat_masking = 0.25f, k_clearcoat_share = 0.25f, k_clearcoat_specular = 0.04f;

float schlick_weight(float cosine) {
  const float m = std::clamp(1.0f - cosine, 0.0f, 1.0f), m2 = m * m;
  return m2 * m2 * m;
}

// Schlick's weight at the larger of the two angles, as the approximation requires.
float schlick_weight_at(float cosine, float ior) {
  if (ior > 1.0f) return schlick_weight(cosine);
  const float sin2 = (1.0f - cosine * cosine) / (ior * ior);
  return schlick_weight(std::sqrt(std::max(1.0f - sin2, 0.0f)));
}

// Generalised Trowbridge-Reitz with exponent 1, as a density per projected solid angle.
float clearcoat_d(float alpha, float cosine) {
  const float a2 = alpha * alpha;
  return (a2 - 1.0f) / (k_pi * std::log(a2) * (1.0f + (a2 - 1.0f) * cosine * cosine));
}

Vec3 sample_clearcoat(float alpha, const Vec2& u) {
  const float a2 = alpha * alpha;
  const float cos2 = std::clamp((1.0f - std::pow(a2, 1.0f - u.y)) / (1.0f - a2), 0.0f, 1.0f);
  const float sine = std::sqrt(1.0f - cos2), phi = 2.0f * k_pi * u.x;
  return {sine * std::cos(phi), sine * std::sin(phi), std::sqrt(cos2)};
}

struct LobeProbabilities {
  float diffuse, clearcoat, specular;
};

LobeProbabilities lobe_probabilities(const Material& material) {
  const float diffuse = 1.0f - material.metallic, clearcoat = k_clearcoat_share * material.clearcoat;
  const float total = diffuse + clearcoat + 1.0f;
  return {diffuse / total, clearcoat / total, 1.0f / total};
}

Rgb diffuse_value(const Material& material, const Vec3& wi, const Vec3& wo, float wo_h) {
  const float in = schlick_weight(wi.z), out = schlick_weight(wo.z);
  const float base = (1.0f - 0.5f * in) * (1.0f - 0.5f * out);
  const float r = 2.0f * material.roughness * wo_h * wo_h;
  const float retro = r * (out + in + out * in * (r - 1.0f));
  return material.reflectance * ((1.0f - material.metallic) * (base + retro) * wo.z / k_pi);
}

Rgb specular_value(const Material& material, const Vec3& wi, const Vec3& wo, const Vec3& h, float wi_h) {
  const float dielectric = fresnel_dielectric(wi_h, material.relative_ior).reflectance;
  // As in Mitsuba, an index of 1 disables the lobe, metal included.
  if (!(dielectric > 0.0f)) return Rgb(0.0f);
  const float w = schlick_weight_at(wi_h, material.relative_ior);
  const Rgb metal = material.reflectance + (Rgb(1.0f) - material.reflectance) * w;
  const Rgb fresnel = metal * material.metallic + Rgb((1.0f - material.metallic) * dielectric);
  const Microfacet& microfacet = material.microfacet;
  return fresnel * (microfacet.d(h) * microfacet.g1(wi, h) * microfacet.g1(wo, h) / (4.0f * wi.z));
}

float clearcoat_value(const Material& material, const Vec3& wi, const Vec3& wo, const Vec3& h, float wi_h) {
  const float w = schlick_weight_at(wi_h, material.relative_ior);
  const float fresnel = k_clearcoat_specular + (1.0f - k_clearcoat_specular) * w;
  const Microfacet masking{MicrofacetKind::ggx, k_clearcoat_masking, k_clearcoat_masking};
  const float g = masking.g1(wi, h) * masking.g1(wo, h);
  return k_clearcoat_share * material.clearcoat * fresnel * clearcoat_d(material.clearcoat_alpha, h.z) * g * wo.z;
}

}  // namespace

Rgb evaluate_principled(const Material& material, const Vec3& wi, const Vec3& wo) {
  const Vec3 h = glm::normalize(wi + wo);
  const float wi_h = glm::dot(wi, h);
  Rgb value = diffuse_value(material, wi, wo, wi_h);
  if (!(wi_h > 0.0f)) return value;
  value += specular_value(material, wi, wo, h, wi_h);
  if (material.clearcoat > 0.0f) value += Rgb(clearcoat_value(material, wi, wo, h, wi_h));
  return value;
}

float principled_pdf(const Material& material, const Vec3& wi, const Vec3& wo) {
  const LobeProbabilities p = lobe_probabilities(material);
  const Vec3 h = glm::normalize(wi + wo);
  float pdf = p.diffuse * wo.z / k_pi;
  const float wi_h = glm::dot(wi, h);
  if (!(wi_h > 0.0f)) return pdf;
  pdf += reflection_pdf(material.microfacet, wi, h, p.specular);
  if (p.clearcoat > 0.0f) pdf += p.clearcoat * clearcoat_d(material.clearcoat_alpha, h.z) * h.z / (4.0f * wi_h);
  return pdf;
}

BsdfSample sample_principled(const Material& material, const Vec3& wi, const Vec2& u, float u_lobe) {
  BsdfSample s;
  const LobeProbabilities p = lobe_probabilities(material);
  if (u_lobe < p.diffuse) {
    s.wo = sample_cosine(u);
  } else if (u_lobe < p.diffuse + p.clearcoat) {
    s.wo = reflect(wi, sample_clearcoat(material.clearcoat_alpha, u));
  } else {
    s.wo = reflect(wi, material.microfacet.sample_visible(wi, u));
  }
  if (!(s.wo.z > 0.0f)) return s;
  s.pdf = principled_pdf(material, wi, s.wo);
  if (s.pdf > 0.0f) s.weight = evaluate_principled(material, wi, s.wo) / s.pdf;
  return s;
}

}  // namespace fieldtrace::bsdf
