#include "core/bsdf.h"

#include <algorithm>
#include <cmath>

#include "core/fresnel.h"
#include "core/texture.h"
#include "core/warp.hd.h"

namespace fieldtrace {
namespace {

Vec3 mirror(const Vec3& w) { return {-w.x, -w.y, w.z}; }

BsdfSample sample_rough_conductor(const Material& material, const Vec3& wi, const Vec2& u) {
  BsdfSample s;
  const Vec3 m = material.microfacet.sample_visible(wi, u);
  const float wi_m = glm::dot(wi, m);
  s.wo = glm::normalize(2.0f * wi_m * m - wi);
  if (!(s.wo.z > 0.0f) || !(wi_m > 0.0f)) return s;
  s.pdf = bsdf_pdf(material, wi, s.wo);
  if (!(s.pdf > 0.0f)) return s;
  s.weight = material.reflectance * fresnel_conductor(wi_m, material.eta, material.k) * material.microfacet.g1(s.wo, m);
  return s;
}

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

}  // namespace

Material resolve_material(const Scene& scene, uint32_t index, const Vec2& uv, float cos_wi) {
  const Bsdf* bsdf = &scene.bsdfs[index];
  Material m;
  if (bsdf->two_sided && cos_wi < 0.0f) {
    m.turned = true;
    if (bsdf->back != k_none) bsdf = &scene.bsdfs[bsdf->back];
  }
  m.kind = bsdf->kind;
  m.dark = m.kind != BsdfKind::dielectric && !m.turned && !(cos_wi > 0.0f);
  m.reflectance = evaluate_texture(scene, bsdf->reflectance, uv);
  switch (m.kind) {
    case BsdfKind::diffuse:
      break;
    case BsdfKind::rough_conductor:
      m.microfacet = {bsdf->microfacet, std::max(bsdf->alpha_u, k_min_alpha), std::max(bsdf->alpha_v, k_min_alpha)};
      [[fallthrough]];
    case BsdfKind::conductor:
      m.eta = bsdf->eta;
      m.k = bsdf->k;
      break;
    case BsdfKind::dielectric:
      m.transmittance = evaluate_texture(scene, bsdf->transmittance, uv);
      m.relative_ior = bsdf->int_ior / bsdf->ext_ior;
      break;
  }
  return m;
}

Rgb material_albedo(const Material& m) {
  if (m.kind == BsdfKind::conductor || m.kind == BsdfKind::rough_conductor)
    return m.reflectance * fresnel_conductor(1.0f, m.eta, m.k);
  return m.reflectance;
}

Rgb evaluate_bsdf(const Material& material, const Vec3& wi, const Vec3& wo) {
  if (material.delta() || !(wi.z > 0.0f) || !(wo.z > 0.0f)) return Rgb(0.0f);
  if (material.kind == BsdfKind::diffuse) return material.reflectance * (wo.z / k_pi);
  const Vec3 h = glm::normalize(wi + wo);
  const float d = material.microfacet.d(h);
  if (!(d > 0.0f)) return Rgb(0.0f);
  const float g = material.microfacet.g1(wi, h) * material.microfacet.g1(wo, h);
  return material.reflectance * fresnel_conductor(glm::dot(wi, h), material.eta, material.k) * (d * g / (4.0f * wi.z));
}

float bsdf_pdf(const Material& material, const Vec3& wi, const Vec3& wo) {
  if (material.delta() || !(wi.z > 0.0f) || !(wo.z > 0.0f)) return 0.0f;
  if (material.kind == BsdfKind::diffuse) return wo.z / k_pi;
  const Vec3 h = glm::normalize(wi + wo);
  // visible_pdf / (4 wi.h), with wi.h cancelled.
  return material.microfacet.g1(wi, h) * material.microfacet.d(h) / (4.0f * wi.z);
}

BsdfSample sample_bsdf(const Material& material, const Vec3& wi, const Vec2& u, float u_lobe) {
  if (material.kind == BsdfKind::dielectric) return sample_dielectric(material, wi, u_lobe);
  BsdfSample s;
  if (!(wi.z > 0.0f)) return s;
  if (material.kind == BsdfKind::rough_conductor) return sample_rough_conductor(material, wi, u);
  if (material.kind == BsdfKind::conductor) {
    s.wo = mirror(wi);
    s.weight = material.reflectance * fresnel_conductor(wi.z, material.eta, material.k);
    s.pdf = 1.0f;
    s.delta = true;
    return s;
  }
  const scalar::Vec3Lanes<float> wo = scalar::cosine_hemisphere(u.x, u.y);
  s.wo = {wo.x, wo.y, wo.z};
  s.pdf = s.wo.z / k_pi;
  if (s.pdf > 0.0f) s.weight = material.reflectance;
  return s;
}

}  // namespace fieldtrace
