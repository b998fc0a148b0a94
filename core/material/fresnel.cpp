#include "core/material/fresnel.h"

#include <algorithm>
#include <cmath>

#include "core/material/conductor.hd.h"

namespace fieldtrace {

DielectricFresnel fresnel_dielectric(float cos_incident, float eta) {
  // Exactly nothing: rounding would leave a little, and where that decides whether there is a lobe at all, much.
  if (eta == 1.0f) return {0.0f, -cos_incident, 1.0f};
  const bool outside = cos_incident >= 0.0f;
  const float eta_it = outside ? 1.0f / eta : eta;
  const float ci = std::min(std::abs(cos_incident), 1.0f);
  const float sin2_t = eta_it * eta_it * (1.0f - ci * ci);
  if (sin2_t >= 1.0f) return {1.0f, 0.0f, eta_it};
  const float ct = std::sqrt(1.0f - sin2_t);
  // With the relative index m = 1 / eta_it of the far side.
  const float s = (eta_it * ci - ct) / (eta_it * ci + ct);
  const float p = (ci - eta_it * ct) / (ci + eta_it * ct);
  return {0.5f * (s * s + p * p), outside ? -ct : ct, eta_it};
}

Rgb fresnel_conductor(float cos_incident, const Rgb& eta, const Rgb& k) {
  Rgb result;
  for (int i = 0; i < 3; ++i) result[i] = scalar::conductor_reflectance<float>(cos_incident, eta[i], k[i]);
  return result;
}

float fresnel_diffuse_reflectance(float eta) {
  // As much light passes a square unit of the interface both ways, per steradian and index squared.
  constexpr float k_least_fitted = 0.4f;
  if (eta < k_least_fitted) return 1.0f - eta * eta * (1.0f - fresnel_diffuse_reflectance(1.0f / eta));
  const float r = 1.0f / eta;
  if (eta < 1.0f) return ((-1.4399f * eta + 0.7099f) * eta + 0.6681f) + 0.0636f * r;
  return 0.919317f + r * (-3.4793f + r * (6.75335f + r * (-7.80989f + r * (4.98554f - r * 1.36881f))));
}

}  // namespace fieldtrace
