#include "core/fresnel.h"

#include <algorithm>
#include <cmath>

namespace fieldtrace {

DielectricFresnel fresnel_dielectric(float cos_incident, float eta) {
  const bool outside = cos_incident >= 0.0f;
  const float eta_it = outside ? 1.0f / eta : eta;
  const float ci = std::min(std::abs(cos_incident), 1.0f);
  const float sin2_t = eta_it * eta_it * (1.0f - ci * ci);
  if (sin2_t >= 1.0f) return {1.0f, 0.0f, eta_it};
  const float ct = std::sqrt(1.0f - sin2_t);
  // With relative index m = 1 / eta_it of the far side.
  const float s = (eta_it * ci - ct) / (eta_it * ci + ct);
  const float p = (ci - eta_it * ct) / (ci + eta_it * ct);
  return {0.5f * (s * s + p * p), outside ? -ct : ct, eta_it};
}

Rgb fresnel_conductor(float cos_incident, const Rgb& eta, const Rgb& k) {
  const double c = std::clamp(double(cos_incident), 0.0, 1.0);
  const double c2 = c * c, s2 = 1.0 - c2;
  Rgb result;
  for (int i = 0; i < 3; ++i) {
    // Double: a2b2 - t is a difference of nearly equal numbers for strong absorbers.
    const double eta2 = double(eta[i]) * eta[i], k2 = double(k[i]) * k[i];
    const double t = eta2 - k2 - s2;
    const double a2b2 = std::sqrt(std::max(t * t + 4.0 * eta2 * k2, 0.0));
    const double a = std::sqrt(std::max(0.5 * (a2b2 + t), 0.0));
    const double rs_up = a2b2 + c2 - 2.0 * a * c, rs_down = a2b2 + c2 + 2.0 * a * c;
    const double rs = rs_down > 0.0 ? rs_up / rs_down : 1.0;
    const double rp_up = c2 * a2b2 + s2 * s2 - 2.0 * a * c * s2, rp_down = c2 * a2b2 + s2 * s2 + 2.0 * a * c * s2;
    const double rp = rp_down > 0.0 ? rs * rp_up / rp_down : rs;
    result[i] = float(std::clamp(0.5 * (rs + rp), 0.0, 1.0));
  }
  return result;
}

float fresnel_diffuse_reflectance(float eta) {
  const float r = 1.0f / eta;
  if (eta < 1.0f) return ((-1.4399f * eta + 0.7099f) * eta + 0.6681f) + 0.0636f * r;
  return 0.919317f + r * (-3.4793f + r * (6.75335f + r * (-7.80989f + r * (4.98554f - r * 1.36881f))));
}

}  // namespace fieldtrace
