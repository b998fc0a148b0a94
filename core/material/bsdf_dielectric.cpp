// Interfaces that transmit light: smooth, thin, rough.
//
// Rough: Walter et al., "Microfacet Models for Refraction through Rough Surfaces", EGSR 2007, equations 16 to 21, with
// visible normals. Radiance is scaled by the inverse square of the index ratio (Veach, "Robust Monte Carlo Methods for
// Light Transport Simulation", 1997, section 5.2), which cancels against eta_o^2 in equation 21. Thin: the geometric
// series of reflections between two parallel interfaces, R' = R + T R T + T R^3 T + ... = 2 R / (1 + R).

#include <cmath>

#include "core/material/bsdf_families.h"
#include "core/material/refraction.h"

namespace fieldtrace::bsdf {
namespace {

// The microfacet that maps wi to wo, and the terms shared by evaluation and density.
struct Facet {
  bool exists = false, reflects = true;
  Vec3 m = Vec3(0.0f, 0.0f, 1.0f);  // m.z > 0
  float wi_m = 0.0f, wo_m = 0.0f;
  float eta = 1.0f;      // index on the side of wo / index on the side of wi, for transmission
  float mapping = 0.0f;  // (wi.m + eta wo.m)^2, for transmission
};

Facet facet_between(const Material& material, const Vec3& wi, const Vec3& wo) {
  Facet f;
  if (wi.z == 0.0f || wo.z == 0.0f) return f;
  f.reflects = (wi.z > 0.0f) == (wo.z > 0.0f);
  f.eta = wi.z > 0.0f ? material.relative_ior : 1.0f / material.relative_ior;
  const Vec3 sum = f.reflects ? wi + wo : wi + f.eta * wo;
  const float length2 = glm::dot(sum, sum);
  if (!(length2 > 0.0f)) return f;
  f.m = sum / std::sqrt(length2);
  if (f.m.z < 0.0f) f.m = -f.m;
  f.wi_m = glm::dot(wi, f.m);
  f.wo_m = glm::dot(wo, f.m);
  const float crossing = f.wi_m + f.eta * f.wo_m;
  f.mapping = crossing * crossing;
  f.exists = f.reflects || f.mapping > 0.0f;
  return f;
}

// Smith masking on either side of the surface.
float masking(const Microfacet& microfacet, const Vec3& w, const Vec3& m) {
  return w.z < 0.0f ? microfacet.g1(-w, m) : microfacet.g1(w, m);
}

}  // namespace

BsdfSample sample_dielectric(const Material& material, const Vec3& wi, float u_lobe) {
  BsdfSample s;
  s.delta = true;
  const DielectricFresnel f = fresnel_dielectric(wi.z, material.relative_ior);
  if (u_lobe < f.reflectance) {
    s.wo = mirror(wi);
    s.pdf = f.reflectance;
    s.weight = material.reflectance;
    return s;
  }
  const float ratio = f.eta_incident_over_transmitted;
  s.wo = glm::normalize(Vec3(-ratio * wi.x, -ratio * wi.y, f.cos_transmitted));
  s.pdf = 1.0f - f.reflectance;
  s.weight = material.transmittance * (ratio * ratio);
  s.eta = 1.0f / ratio;
  return s;
}

BsdfSample sample_thin_dielectric(const Material& material, const Vec3& wi, float u_lobe) {
  BsdfSample s;
  s.delta = true;
  const float once = fresnel_dielectric(std::abs(wi.z), material.relative_ior).reflectance;
  const float reflectance = 2.0f * once / (1.0f + once);
  if (u_lobe < reflectance) {
    s.wo = mirror(wi);
    s.pdf = reflectance;
    s.weight = material.reflectance;
    return s;
  }
  s.wo = -wi;
  s.pdf = 1.0f - reflectance;
  s.weight = material.transmittance;
  s.straight = true;
  return s;
}

Rgb evaluate_rough_dielectric(const Material& material, const Vec3& wi, const Vec3& wo) {
  const Facet f = facet_between(material, wi, wo);
  if (!f.exists) return Rgb(0.0f);
  const float g = masking(material.microfacet, wi, f.m) * masking(material.microfacet, wo, f.m);
  const float value = material.microfacet.d(f.m) * g;
  if (!(value > 0.0f)) return Rgb(0.0f);
  const float reflectance = fresnel_dielectric(f.wi_m, material.relative_ior).reflectance;
  if (f.reflects) return material.reflectance * (reflectance * value / (4.0f * std::abs(wi.z)));
  return material.transmittance *
         ((1.0f - reflectance) * value * std::abs(f.wi_m * f.wo_m) / (std::abs(wi.z) * f.mapping));
}

float rough_dielectric_pdf(const Material& material, const Vec3& wi, const Vec3& wo) {
  const Facet f = facet_between(material, wi, wo);
  if (!f.exists) return 0.0f;
  // Sampling never produces a wo from which the facet faces away.
  if (!(masking(material.microfacet, wo, f.m) > 0.0f)) return 0.0f;
  // Density of the visible normal, without its factor |wi.m|.
  const float visible = masking(material.microfacet, wi, f.m) * material.microfacet.d(f.m) / std::abs(wi.z);
  if (!(visible > 0.0f)) return 0.0f;
  const float reflectance = fresnel_dielectric(f.wi_m, material.relative_ior).reflectance;
  if (f.reflects) return reflectance * visible * 0.25f;
  return (1.0f - reflectance) * visible * std::abs(f.wi_m) * (f.eta * f.eta) * std::abs(f.wo_m) / f.mapping;
}

BsdfSample sample_rough_dielectric(const Material& material, const Vec3& wi, const Vec2& u, float u_lobe) {
  BsdfSample s;
  const float side = wi.z < 0.0f ? -1.0f : 1.0f;
  const Vec3 m = material.microfacet.sample_visible(side * wi, u);
  const float wi_m = glm::dot(wi, m);
  const DielectricFresnel f = fresnel_dielectric(wi_m, material.relative_ior);
  const bool reflects = u_lobe < f.reflectance;
  s.wo = reflects ? reflect(wi, m) : refract(wi, m, f);
  if (!(side * wi_m > 0.0f) || !((reflects ? side : -side) * s.wo.z > 0.0f)) return s;
  s.pdf = rough_dielectric_pdf(material, wi, s.wo);
  if (!(s.pdf > 0.0f)) return s;
  const float ratio = f.eta_incident_over_transmitted;
  const float g = masking(material.microfacet, s.wo, m);
  s.weight = reflects ? material.reflectance * g : material.transmittance * (g * ratio * ratio);
  if (!reflects) s.eta = 1.0f / ratio;
  return s;
}

}  // namespace fieldtrace::bsdf
