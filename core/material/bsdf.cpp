#include "core/material/bsdf.h"

#include <algorithm>
#include <cmath>

#include "core/material/bsdf_families.h"
#include "core/material/fresnel.h"
#include "core/material/texture.h"
#include "core/sampling/warp.hd.h"

namespace fieldtrace {

namespace bsdf {

Vec3 sample_cosine(const Vec2& u) {
  const scalar::Vec3Lanes<float> wo = scalar::cosine_hemisphere(u.x, u.y);
  return {wo.x, wo.y, wo.z};
}

}  // namespace bsdf

namespace {

// Whether a sampled light direction wo can contribute, the mask aside: not at delta lobes, nor below opaque surfaces.
bool connects(const Material& material, const Vec3& wi, const Vec3& wo) {
  if (material.delta()) return false;
  return material.transmits() || (wi.z > 0.0f && wo.z > 0.0f);
}

BsdfSample sample_diffuse(const Material& material, const Vec2& u) {
  BsdfSample s;
  s.wo = bsdf::sample_cosine(u);
  s.pdf = s.wo.z / k_pi;
  if (s.pdf > 0.0f) s.weight = material.reflectance;
  return s;
}

BsdfSample sample_unmasked(const Material& material, const Vec3& wi, const Vec2& u, float u_lobe) {
  if (!material.transmits() && !(wi.z > 0.0f)) return {};
  switch (material.kind) {
    case BsdfKind::diffuse:
      return sample_diffuse(material, u);
    case BsdfKind::conductor:
      return bsdf::sample_conductor(material, wi);
    case BsdfKind::rough_conductor:
      return bsdf::sample_rough_conductor(material, wi, u);
    case BsdfKind::dielectric:
      return bsdf::sample_dielectric(material, wi, u_lobe);
    case BsdfKind::rough_dielectric:
      return bsdf::sample_rough_dielectric(material, wi, u, u_lobe);
    case BsdfKind::thin_dielectric:
      return bsdf::sample_thin_dielectric(material, wi, u_lobe);
    case BsdfKind::plastic:
      return bsdf::sample_plastic(material, wi, u, u_lobe);
    case BsdfKind::rough_plastic:
      return bsdf::sample_rough_plastic(material, wi, u, u_lobe);
    case BsdfKind::principled:
      return bsdf::sample_principled(material, wi, u, u_lobe);
  }
  return {};
}

Microfacet microfacet_of(const Bsdf& bsdf) {
  return {bsdf.microfacet, std::max(bsdf.alpha_u, k_min_alpha), std::max(bsdf.alpha_v, k_min_alpha)};
}

}  // namespace

bool is_textured(const Scene& scene, uint32_t bsdf) {
  const auto varies = [&](uint32_t texture) {
    return texture != k_none && scene.textures[texture].kind != TextureKind::constant;
  };
  for (uint32_t b = bsdf; b != k_none; b = scene.bsdfs[b].back) {
    const Bsdf& side = scene.bsdfs[b];
    if (varies(side.reflectance) || varies(side.opacity)) return true;
    if (transmits(side.kind) && varies(side.transmittance)) return true;
    if (is_plastic(side.kind) && varies(side.diffuse_reflectance)) return true;
  }
  return false;
}

Material resolve_material(const Scene& scene, uint32_t index, const Vec2& uv, float cos_wi) {
  const Bsdf* bsdf = &scene.bsdfs[index];
  Material m;
  if (bsdf->opacity != k_none) m.opacity = std::clamp(evaluate_scalar_texture(scene, bsdf->opacity, uv), 0.0f, 1.0f);
  if (bsdf->two_sided && cos_wi < 0.0f) {
    m.turned = true;
    if (bsdf->back != k_none) bsdf = &scene.bsdfs[bsdf->back];
  }
  m.kind = bsdf->kind;
  m.dark = !m.transmits() && !m.turned && !(cos_wi > 0.0f);
  m.reflectance = evaluate_texture(scene, bsdf->reflectance, uv);
  if (m.kind == BsdfKind::diffuse) return m;
  m.relative_ior = bsdf->int_ior / bsdf->ext_ior;
  switch (m.kind) {
    case BsdfKind::diffuse:
      break;
    case BsdfKind::rough_conductor:
      m.microfacet = microfacet_of(*bsdf);
      [[fallthrough]];
    case BsdfKind::conductor:
      m.eta = bsdf->eta;
      m.k = bsdf->k;
      break;
    case BsdfKind::rough_dielectric:
      m.microfacet = microfacet_of(*bsdf);
      [[fallthrough]];
    case BsdfKind::dielectric:
    case BsdfKind::thin_dielectric:
      m.transmittance = evaluate_texture(scene, bsdf->transmittance, uv);
      break;
    case BsdfKind::rough_plastic:
      m.microfacet = microfacet_of(*bsdf);
      m.rough_transmittance = &scene.rough_transmittances[bsdf->rough_transmittance];
      [[fallthrough]];
    case BsdfKind::plastic:
      m.diffuse_reflectance = evaluate_texture(scene, bsdf->diffuse_reflectance, uv);
      m.nonlinear = bsdf->nonlinear;
      break;
    case BsdfKind::principled:
      m.microfacet = microfacet_of(*bsdf);
      m.roughness = bsdf->roughness;
      m.metallic = bsdf->metallic;
      m.clearcoat = bsdf->clearcoat;
      m.clearcoat_alpha = bsdf->clearcoat_alpha;
      break;
  }
  return m;
}

Rgb material_albedo(const Material& m) {
  if (m.dark) return Rgb(0.0f);
  if (m.kind == BsdfKind::conductor || m.kind == BsdfKind::rough_conductor)
    return m.reflectance * fresnel_conductor(1.0f, m.eta, m.k) * m.opacity;
  return (is_plastic(m.kind) ? m.diffuse_reflectance : m.reflectance) * m.opacity;
}

float lobe_alpha(const Material& m) {
  if (m.kind == BsdfKind::diffuse) return k_diffuse_alpha;
  if (m.delta() || m.kind == BsdfKind::plastic) return 0.0f;
  const float alpha = std::min(m.microfacet.alpha_u, m.microfacet.alpha_v);
  return m.kind == BsdfKind::principled && m.clearcoat > 0.0f ? std::min(alpha, m.clearcoat_alpha) : alpha;
}

Rgb evaluate_bsdf(const Material& material, const Vec3& wi, const Vec3& wo) {
  if (!connects(material, wi, wo)) return Rgb(0.0f);
  switch (material.kind) {
    case BsdfKind::diffuse:
      return material.reflectance * (material.opacity * wo.z / k_pi);
    case BsdfKind::rough_conductor:
      return bsdf::evaluate_rough_conductor(material, wi, wo) * material.opacity;
    case BsdfKind::rough_dielectric:
      return bsdf::evaluate_rough_dielectric(material, wi, wo) * material.opacity;
    case BsdfKind::plastic:
      return bsdf::evaluate_plastic(material, wi, wo) * material.opacity;
    case BsdfKind::rough_plastic:
      return bsdf::evaluate_rough_plastic(material, wi, wo) * material.opacity;
    case BsdfKind::principled:
      return bsdf::evaluate_principled(material, wi, wo) * material.opacity;
    case BsdfKind::conductor:
    case BsdfKind::dielectric:
    case BsdfKind::thin_dielectric:
      break;
  }
  return Rgb(0.0f);
}

float bsdf_pdf(const Material& material, const Vec3& wi, const Vec3& wo) {
  if (!connects(material, wi, wo)) return 0.0f;
  switch (material.kind) {
    case BsdfKind::diffuse:
      return material.opacity * wo.z / k_pi;
    case BsdfKind::rough_conductor:
      return material.opacity * bsdf::rough_conductor_pdf(material, wi, wo);
    case BsdfKind::rough_dielectric:
      return material.opacity * bsdf::rough_dielectric_pdf(material, wi, wo);
    case BsdfKind::plastic:
      return material.opacity * bsdf::plastic_pdf(material, wi, wo);
    case BsdfKind::rough_plastic:
      return material.opacity * bsdf::rough_plastic_pdf(material, wi, wo);
    case BsdfKind::principled:
      return material.opacity * bsdf::principled_pdf(material, wi, wo);
    case BsdfKind::conductor:
    case BsdfKind::dielectric:
    case BsdfKind::thin_dielectric:
      break;
  }
  return 0.0f;
}

BsdfSample sample_bsdf(const Material& material, const Vec3& wi, const Vec2& u, float u_lobe) {
  if (!material.masked()) return sample_unmasked(material, wi, u, u_lobe);
  BsdfSample s;
  if (!(u_lobe < material.opacity)) {
    s.wo = -wi;
    s.weight = Rgb(1.0f);
    s.pdf = 1.0f - material.opacity;
    s.delta = s.straight = true;
    return s;
  }
  // Below the opacity, u_lobe / opacity is uniform in [0, 1) again.
  constexpr float k_below_one = 1.0f - 0x1p-24f;
  s = sample_unmasked(material, wi, u, std::min(u_lobe / material.opacity, k_below_one));
  s.pdf *= material.opacity;
  return s;
}

}  // namespace fieldtrace
