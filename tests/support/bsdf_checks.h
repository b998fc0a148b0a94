// Materials made by hand, directions and random numbers for the tests of materials.
#pragma once

#include <memory>
#include <random>
#include <vector>

#include "core/material/bsdf.h"
#include "core/material/rough_transmittance.h"

namespace fieldtrace::test {

inline Vec3 direction(float cos_theta, float phi) {
  const float s = std::sqrt(std::max(1.0f - cos_theta * cos_theta, 0.0f));
  return {s * std::cos(phi), s * std::sin(phi), cos_theta};
}

struct Random {
  std::mt19937 engine;
  explicit Random(uint32_t seed) : engine(seed) {}
  float operator()() { return float(engine() >> 8) * 0x1p-24f; }
  Vec2 pair() {
    const float x = (*this)();
    return {x, (*this)()};
  }
  Vec3 upper() {
    const float z = (*this)();
    return direction(std::max(z, 0x1p-20f), 2.0f * k_pi * (*this)());
  }
};

inline Material diffuse(float albedo) {
  Material m;
  m.reflectance = Rgb(albedo);
  return m;
}

// A perfect reflector (eta = 0, k = 1: Fresnel reflectance 1 at every angle).
inline Material rough(MicrofacetKind kind, float alpha_u, float alpha_v) {
  Material m;
  m.kind = BsdfKind::rough_conductor;
  m.reflectance = Rgb(1.0f);
  m.microfacet = {kind, alpha_u, alpha_v};
  return m;
}

inline Material glass(float ior) {
  Material m;
  m.kind = BsdfKind::dielectric;
  m.reflectance = m.transmittance = Rgb(1.0f);
  m.relative_ior = ior;
  return m;
}

inline Material thin_glass(float ior) {
  Material m = glass(ior);
  m.kind = BsdfKind::thin_dielectric;
  return m;
}

inline Material rough_glass(MicrofacetKind kind, float alpha_u, float alpha_v, float ior) {
  Material m = glass(ior);
  m.kind = BsdfKind::rough_dielectric;
  m.microfacet = {kind, alpha_u, alpha_v};
  return m;
}

inline Material plastic(float body, float ior, bool nonlinear = false) {
  Material m;
  m.kind = BsdfKind::plastic;
  m.reflectance = Rgb(1.0f);
  m.diffuse_reflectance = Rgb(body);
  m.relative_ior = ior;
  m.nonlinear = nonlinear;
  return m;
}

// The tables live until the program ends.
inline Material rough_plastic(MicrofacetKind kind, float alpha, float body, float ior) {
  Material m = plastic(body, ior);
  m.kind = BsdfKind::rough_plastic;
  m.microfacet = {kind, alpha, alpha};
  static std::vector<std::unique_ptr<RoughTransmittance>> tables;
  tables.push_back(std::make_unique<RoughTransmittance>(make_rough_transmittance(m.microfacet, ior)));
  m.rough_transmittance = tables.back().get();
  return m;
}

inline Material principled(float base, float roughness, float metallic, float clearcoat) {
  Material m;
  m.kind = BsdfKind::principled;
  m.reflectance = Rgb(base);
  m.roughness = roughness;
  m.microfacet = {MicrofacetKind::ggx, roughness * roughness, roughness * roughness};
  m.metallic = metallic;
  m.clearcoat = clearcoat;
  m.relative_ior = 1.5f;
  return m;
}

// The share of the arriving flux that is scattered, by `n` samples. (Radiance changes with the index of refraction;
// flux does not.)
inline double mean_flux(const Material& m, const Vec3& wi, Random& random, int n) {
  double sum = 0.0;
  for (int i = 0; i < n; ++i) {
    const BsdfSample s = sample_bsdf(m, wi, random.pair(), random());
    if (s.pdf > 0.0f) sum += double(s.weight.x) * s.eta * s.eta;
  }
  return sum / n;
}

inline Material masked(Material m, float opacity) {
  m.opacity = opacity;
  return m;
}

}  // namespace fieldtrace::test
