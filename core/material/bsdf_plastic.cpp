// Plastics: a diffuse body under a dielectric interface. Light that enters is scattered diffusely and partly reflected
// back into the body by the interface, any number of times: body / (1 - body R) with the internal diffuse reflectance R
// or, to keep colours as specified ("linear"), body / (1 - R). Entering and leaving contribute (1 - F) / eta^2 once for
// each way.
//
// Source: Mitsuba 3 documentation, plugins `plastic` and `roughplastic`; the latter with the rough interface's
// transmittance (rough_transmittance.h) instead of 1 - F.

#include <algorithm>
#include <cmath>

#include "core/material/bsdf_families.h"
#include "core/material/refraction.h"
#include "core/material/rough_transmittance.h"

namespace fieldtrace::bsdf {
namespace {

// body / pi with internal reflections, for light that enters and leaves without loss.
Rgb body_value(const Material& material, float internal_reflectance) {
  const Rgb body = material.diffuse_reflectance;
  const Rgb kept = (material.nonlinear ? body : Rgb(1.0f)) * internal_reflectance;
  const float ior2 = material.relative_ior * material.relative_ior;
  return body / ((Rgb(1.0f) - kept) * (k_pi * ior2));
}

float mean(const Rgb& c) { return (c.x + c.y + c.z) / 3.0f; }

// The probability of sampling the specular lobe, given its reflectance, in proportion to the energy of the lobes.
float specular_probability(const Material& material, float specular_share) {
  const float specular = specular_share * mean(material.reflectance);
  const float diffuse = (1.0f - specular_share) * mean(material.diffuse_reflectance);
  return specular + diffuse > 0.0f ? specular / (specular + diffuse) : 0.5f;
}

float smooth_internal_reflectance(const Material& material) {
  return fresnel_diffuse_reflectance(1.0f / material.relative_ior);
}

float transmittance(const Material& material, float cosine) {
  return material.kind == BsdfKind::rough_plastic
             ? transmittance_at(*material.rough_transmittance, cosine)
             : 1.0f - fresnel_dielectric(cosine, material.relative_ior).reflectance;
}

}  // namespace

Rgb evaluate_plastic(const Material& material, const Vec3& wi, const Vec3& wo) {
  const float f_i = fresnel_dielectric(wi.z, material.relative_ior).reflectance;
  const float f_o = fresnel_dielectric(wo.z, material.relative_ior).reflectance;
  return body_value(material, smooth_internal_reflectance(material)) * ((1.0f - f_i) * (1.0f - f_o) * wo.z);
}

float plastic_pdf(const Material& material, const Vec3& wi, const Vec3& wo) {
  const float f_i = fresnel_dielectric(wi.z, material.relative_ior).reflectance;
  return (1.0f - specular_probability(material, f_i)) * wo.z / k_pi;
}

BsdfSample sample_plastic(const Material& material, const Vec3& wi, const Vec2& u, float u_lobe) {
  BsdfSample s;
  const float f_i = fresnel_dielectric(wi.z, material.relative_ior).reflectance;
  const float specular = specular_probability(material, f_i);
  if (u_lobe < specular) {
    s.wo = mirror(wi);
    s.pdf = specular;
    s.weight = material.reflectance * (f_i / specular);
    s.delta = true;
    return s;
  }
  s.wo = sample_cosine(u);
  s.pdf = (1.0f - specular) * s.wo.z / k_pi;
  if (s.pdf > 0.0f) s.weight = evaluate_plastic(material, wi, s.wo) / s.pdf;
  return s;
}

Rgb evaluate_rough_plastic(const Material& material, const Vec3& wi, const Vec3& wo) {
  const RoughTransmittance& table = *material.rough_transmittance;
  const float through = transmittance_at(table, wi.z) * transmittance_at(table, wo.z);
  const Rgb diffuse = body_value(material, table.internal_reflectance) * (through * wo.z);
  const Vec3 h = glm::normalize(wi + wo);
  const float f = fresnel_dielectric(glm::dot(wi, h), material.relative_ior).reflectance;
  return diffuse + material.reflectance * reflection_value(material.microfacet, wi, wo, h, f);
}

float rough_plastic_pdf(const Material& material, const Vec3& wi, const Vec3& wo) {
  const float specular = specular_probability(material, 1.0f - transmittance_at(*material.rough_transmittance, wi.z));
  const float lobe = reflection_pdf(material.microfacet, wi, glm::normalize(wi + wo));
  return specular * lobe + (1.0f - specular) * wo.z / k_pi;
}

BsdfSample sample_rough_plastic(const Material& material, const Vec3& wi, const Vec2& u, float u_lobe) {
  BsdfSample s;
  const float specular = specular_probability(material, 1.0f - transmittance_at(*material.rough_transmittance, wi.z));
  s.wo = u_lobe < specular ? reflect(wi, material.microfacet.sample_visible(wi, u)) : sample_cosine(u);
  if (!(s.wo.z > 0.0f)) return s;
  s.pdf = rough_plastic_pdf(material, wi, s.wo);
  if (s.pdf > 0.0f) s.weight = evaluate_rough_plastic(material, wi, s.wo) / s.pdf;
  return s;
}

}  // namespace fieldtrace::bsdf

namespace fieldtrace {

CoatedBody coated_body(const Material& material, float cos_wi) {
  const auto transmittance = [&](float cosine) { return bsdf::transmittance(material, cosine); };
  const float normal = transmittance(1.0f);
  const RoughTransmittance* const table = material.rough_transmittance;
  const float internal = table ? table->internal_reflectance : bsdf::smooth_internal_reflectance(material);
  CoatedBody body;
  if (!(cos_wi > 0.0f && normal > 0.0f)) return body;
  body.reflected = bsdf::body_value(material, internal) * (transmittance(cos_wi) * normal);
  body.grazing = table ? table->grazing : grazing_of(transmittance);
  return body;
}

float relative_transmittance(const Material& material, float cosine) {
  const float normal = bsdf::transmittance(material, 1.0f);
  return normal > 0.0f ? bsdf::transmittance(material, cosine) / normal : 0.0f;
}

Material without_body(const Material& material) {
  Material interface = material;
  interface.diffuse_reflectance = Rgb(0.0f);
  return interface;
}

}  // namespace fieldtrace
