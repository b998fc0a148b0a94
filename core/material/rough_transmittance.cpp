#include "core/material/rough_transmittance.h"

#include <algorithm>
#include <cmath>

#include "core/material/fresnel.h"
#include "core/material/refraction.h"

namespace fieldtrace {
namespace {

// Midpoint rule along each sample dimension: errors below 1e-3 for all roughnesses. (The integrand has kinks where
// total reflection begins and where directions fall below the surface, and integrable slopes at the ends.)
constexpr int k_points = 48;

Vec3 incident(int node) {
  // Grazing incidence is tabulated slightly above the horizon, where all terms are defined.
  const float c = std::max(float(node) / float(RoughTransmittance::k_nodes - 1), 1e-6f);
  return {std::sqrt(std::max(1.0f - c * c, 0.0f)), 0.0f, c};
}

// Mean of value(m) over the microfacets visible from wi.
template <class Value>
float mean_over_visible(const Microfacet& microfacet, const Vec3& wi, const Value& value) {
  double sum = 0.0;
  for (int i = 0; i < k_points; ++i) {
    for (int j = 0; j < k_points; ++j) {
      const Vec2 u((float(i) + 0.5f) / k_points, (float(j) + 0.5f) / k_points);
      sum += value(microfacet.sample_visible(wi, u));
    }
  }
  return float(sum / (k_points * k_points));
}

float transmitted_share(const Microfacet& microfacet, const Vec3& wi, float ior) {
  return mean_over_visible(microfacet, wi, [&](const Vec3& m) {
    const DielectricFresnel f = fresnel_dielectric(glm::dot(wi, m), ior);
    const Vec3 wo = refract(wi, m, f);
    return wo.z < 0.0f ? (1.0f - f.reflectance) * microfacet.g1(-wo, m) : 0.0f;
  });
}

float reflected_share(const Microfacet& microfacet, const Vec3& wi, float ior) {
  return mean_over_visible(microfacet, wi, [&](const Vec3& m) {
    const float wi_m = glm::dot(wi, m);
    return fresnel_dielectric(wi_m, ior).reflectance * microfacet.g1(reflect(wi, m), m);
  });
}

}  // namespace

RoughTransmittance make_rough_transmittance(const Microfacet& microfacet, float relative_ior) {
  RoughTransmittance table;
  double inside = 0.0;
  for (int node = 0; node < RoughTransmittance::k_nodes; ++node) {
    const Vec3 wi = incident(node);
    table.outside[size_t(node)] = transmitted_share(microfacet, wi, relative_ior);
    inside += double(reflected_share(microfacet, wi, 1.0f / relative_ior)) * wi.z;
  }
  table.internal_reflectance = float(2.0 * inside / RoughTransmittance::k_nodes);
  table.grazing = grazing_of([&](float cosine) { return transmittance_at(table, cosine); });
  return table;
}

float transmittance_at(const RoughTransmittance& table, float cosine) {
  const float x = std::clamp(cosine, 0.0f, 1.0f) * float(RoughTransmittance::k_nodes - 1);
  const int i = std::min(int(x), RoughTransmittance::k_nodes - 2);
  const float t = x - float(i);
  return (1.0f - t) * table.outside[size_t(i)] + t * table.outside[size_t(i) + 1];
}

}  // namespace fieldtrace
