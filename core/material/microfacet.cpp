#include "core/material/microfacet.h"

#include <algorithm>
#include <cmath>

#include "core/material/conductor.hd.h"
#include "core/simd/vec_lanes.h"

namespace fieldtrace {
namespace {

constexpr double k_sqrt_pi = 1.7724538509055160273;

// Inverse error function, relative error below 4e-7 (Giles, "Approximating the erfinv function", GPU Computing Gems
// Jade Edition, 2011, chapter 10).
float erf_inverse(float x) {
  x = std::clamp(x, -1.0f + 0x1p-24f, 1.0f - 0x1p-24f);
  float w = -std::log((1.0f - x) * (1.0f + x));
  float p;
  if (w < 5.0f) {
    w -= 2.5f;
    p = 2.81022636e-08f;
    p = 3.43273939e-07f + p * w;
    p = -3.5233877e-06f + p * w;
    p = -4.39150654e-06f + p * w;
    p = 0.00021858087f + p * w;
    p = -0.00125372503f + p * w;
    p = -0.00417768164f + p * w;
    p = 0.246640727f + p * w;
    p = 1.50140941f + p * w;
  } else {
    w = std::sqrt(w) - 3.0f;
    p = -0.000200214257f;
    p = 0.000100950558f + p * w;
    p = 0.00134934322f + p * w;
    p = -0.00367342844f + p * w;
    p = 0.00573950773f + p * w;
    p = -0.0076224613f + p * w;
    p = 0.00943887047f + p * w;
    p = 1.00167406f + p * w;
    p = 2.83297682f + p * w;
  }
  return p * x;
}

// Samples the slope along x of a unit-roughness Beckmann surface seen from direction (sin, 0, cos). The density is
// proportional to max(cos - x sin, 0) exp(-x^2), whose integral up to x is, times 2,
//   F(x) = cos (1 + erf x) + sin exp(-x^2) / sqrt(pi), x <= cot.
float visible_beckmann_slope(float cos_theta, float sin_theta, float u) {
  const double c = cos_theta, s = sin_theta;
  const auto integral = [&](double x) { return c * (1.0 + std::erf(x)) + s * std::exp(-x * x) / k_sqrt_pi; };
  // erf(-6) differs from -1 by 2e-17: the mass below is lost to rounding anyway.
  constexpr double k_tail = 6.0;
  double low = -k_tail, high = s * k_tail > c ? c / s : k_tail;
  const double target = double(u) * integral(high);
  double x = 0.5 * (low + high);
  // Bisection alone gains one bit per step from an interval of 12: 40 steps reach 1e-11 in the worst case. Newton
  // usually converges in 4 to 6.
  for (int i = 0; i < 40; ++i) {
    const double residual = integral(x) - target;
    (residual > 0.0 ? high : low) = x;
    const double slope = 2.0 * (c - s * x) * std::exp(-x * x) / k_sqrt_pi;
    double next = x - residual / slope;
    if (!(next > low && next < high)) next = 0.5 * (low + high);
    // Half a float ulp of a slope of order 1.
    if (std::abs(next - x) < 0x1p-25) return float(next);
    x = next;
  }
  return float(x);
}

// Samples the visible slopes of a unit-roughness surface seen from direction (sin, 0, cos).
Vec2 visible_beckmann_slopes(float cos_theta, float sin_theta, const Vec2& u) {
  return {visible_beckmann_slope(cos_theta, sin_theta, u.x), erf_inverse(2.0f * u.y - 1.0f)};
}

}  // namespace

float Microfacet::d(const Vec3& m) const {
  if (!(m.z > 0.0f)) return 0.0f;
  if (kind == MicrofacetKind::beckmann) {
    const float x = m.x / alpha_u, y = m.y / alpha_v;
    const float slope2 = x * x + y * y, z2 = m.z * m.z;
    const float value = std::exp(-slope2 / z2) / (k_pi * alpha_u * alpha_v * z2 * z2);
    // z2 * z2 may underflow where the exponential is already 0.
    return std::isfinite(value) ? value : 0.0f;
  }
  return scalar::ggx_density(alpha_u, alpha_v, lanes(m));
}

float Microfacet::g1(const Vec3& w, const Vec3& m) const {
  if (!(w.z > 0.0f) || !(glm::dot(w, m) > 0.0f)) return 0.0f;
  if (kind == MicrofacetKind::ggx) return scalar::ggx_masking(alpha_u, alpha_v, lanes(w));
  const float x = w.x * alpha_u, y = w.y * alpha_v;
  const float tan2 = (x * x + y * y) / (w.z * w.z);  // alpha^2 tan^2
  if (!(tan2 > 0.0f)) return 1.0f;
  const double a = 1.0 / std::sqrt(double(tan2));
  const double lambda = 0.5 * (std::exp(-a * a) / (a * k_sqrt_pi) - std::erfc(a));
  return float(1.0 / (1.0 + lambda));
}

float Microfacet::visible_pdf(const Vec3& w, const Vec3& m) const {
  if (!(w.z > 0.0f)) return 0.0f;
  return g1(w, m) * std::abs(glm::dot(w, m)) * d(m) / w.z;
}

Vec3 Microfacet::sample_visible(const Vec3& w, const Vec2& u) const {
  if (kind == MicrofacetKind::ggx) {
    const auto m = scalar::sample_visible_ggx<float>(scalar::ggx_view(alpha_u, alpha_v, lanes(w)), {u.x, u.y});
    return to_vec(m);
  }
  const Vec3 stretched = glm::normalize(Vec3(alpha_u * w.x, alpha_v * w.y, w.z));
  const float sin_theta = std::sqrt(stretched.x * stretched.x + stretched.y * stretched.y);
  const Vec2 slope = visible_beckmann_slopes(stretched.z, sin_theta, u);
  const Vec2 azimuth = sin_theta > 0.0f ? Vec2(stretched.x, stretched.y) / sin_theta : Vec2(1.0f, 0.0f);
  const Vec2 turned(azimuth.x * slope.x - azimuth.y * slope.y, azimuth.y * slope.x + azimuth.x * slope.y);
  return glm::normalize(Vec3(-alpha_u * turned.x, -alpha_v * turned.y, 1.0f));
}

}  // namespace fieldtrace
