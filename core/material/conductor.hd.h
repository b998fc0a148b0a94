// Rough metal under GGX: visible normals, density and Fresnel reflectance, for floats and SIMD lanes.
//
// Sources: visible normals: Heitz, "Sampling the GGX Distribution of Visible Normals", JCGT 7(4), 2018. D and G1:
// Walter et al., "Microfacet Models for Refraction through Rough Surfaces", EGSR 2007. Fresnel: Born and Wolf,
// "Principles of Optics", 7th ed., section 14.2.
// Space: local shading frame, normal +z. Thread-safety: pure functions, no memory access.

#if defined(FIELDTRACE_CORE_MATERIAL_CONDUCTOR_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_CORE_MATERIAL_CONDUCTOR_HD_H_
#undef FIELDTRACE_CORE_MATERIAL_CONDUCTOR_HD_H_
#else
#define FIELDTRACE_CORE_MATERIAL_CONDUCTOR_HD_H_
#endif

#include "core/sampling/sobol.hd.h"
#include "core/sampling/warp.hd.h"

FT_LANES_BEGIN

template <class F>
FT_HD_INLINE Vec3Lanes<F> unit_vector(const Vec3Lanes<F>& v) {
  return v * (splat<F>(1.0f) / sqrt(dot(v, v)));
}

// Precomputed terms of a direction for sampling its visible GGX microfacets.
template <class F>
struct GgxView {
  F alpha_u, alpha_v;
  Vec3Lanes<F> stretched;  // the direction relative to the unit-roughness surface
  F tangent_x, tangent_y;  // unit, horizontal, perpendicular to it
};

// w is unit with w.z > 0; alphas are positive.
template <class F>
FT_HD_INLINE GgxView<F> ggx_view(F alpha_u, F alpha_v, const Vec3Lanes<F>& w) {
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f);
  const Vec3Lanes<F> s = unit_vector<F>({alpha_u * w.x, alpha_v * w.y, w.z});
  const F length2 = s.x * s.x + s.y * s.y;
  const Mask_t<F> slants = length2 > zero;
  const F inverse = one / sqrt(select(slants, length2, one));
  return {alpha_u, alpha_v, s, select(slants, -s.y * inverse, one), select(slants, s.x * inverse, zero)};
}

// Samples a unit visible normal; u in [0, 1)^2.
template <class F>
FT_HD_INLINE Vec3Lanes<F> sample_visible_ggx(const GgxView<F>& view, const UnitPair<F>& u) {
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f);
  const Vec3Lanes<F> t1 = {view.tangent_x, view.tangent_y, zero};
  // cross(stretched, t1)
  const Vec3Lanes<F>& s = view.stretched;
  const Vec3Lanes<F> t2 = {-(s.z * t1.y), s.z * t1.x, s.x * t1.y - s.y * t1.x};
  const F r = sqrt(u.x);
  const SinCos<F> phi = sincos_turns(u.y);
  const F p1 = r * phi.cosine;
  const F blend = splat<F>(0.5f) * (one + s.z);
  const F p2 = (one - blend) * sqrt(max(one - p1 * p1, zero)) + blend * (r * phi.sine);
  const F p3 = sqrt(max(one - p1 * p1 - p2 * p2, zero));
  const Vec3Lanes<F> n = t1 * p1 + t2 * p2 + s * p3;
  return unit_vector<F>({view.alpha_u * n.x, view.alpha_v * n.y, max(n.z, zero)});
}

// Density of microfacet normals per projected solid angle; m.z > 0.
template <class F>
FT_HD_INLINE F ggx_density(F alpha_u, F alpha_v, const Vec3Lanes<F>& m) {
  const F x = m.x / alpha_u, y = m.y / alpha_v;
  const F k = x * x + y * y + m.z * m.z;
  return splat<F>(1.0f) / (splat<F>(Angle::k_pi) * alpha_u * alpha_v * k * k);
}

// Smith masking of a direction in front of the microfacet; w.z > 0.
template <class F>
FT_HD_INLINE F ggx_masking(F alpha_u, F alpha_v, const Vec3Lanes<F>& w) {
  const F one = splat<F>(1.0f);
  const F x = w.x * alpha_u, y = w.y * alpha_v;
  return splat<F>(2.0f) / (one + sqrt(one + (x * x + y * y) / (w.z * w.z)));
}

// Reflectance of unpolarised light; cosine in [0, 1], eta + i k relative to the outside, k >= 0. Absolute error below
// 2^-20 for k >= 0.1 (for smaller k, 2^-14 near the angle of total reflection): there are no cancelling differences, so
// single precision suffices for strong absorbers too.
template <class F>
FT_HD_INLINE F conductor_reflectance(F cosine, F eta, F k) {
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f), half = splat<F>(0.5f);
  const F c = min(max(cosine, zero), one);
  const F c2 = c * c, s2 = (one - c) * (one + c);
  // (a + i b)^2 = (eta + i k)^2 - s2: the larger of a and b from a sum, the other from a b = eta k.
  const F t = (eta - k) * (eta + k) - s2, product = eta * k;
  const F squares = sqrt(t * t + splat<F>(4.0f) * (product * product));
  const F larger = sqrt(half * (squares + abs(t)));
  const F smaller = product / max(larger, splat<F>(Tiny::k_smallest_normal));
  const Mask_t<F> refracts = t >= zero;
  const F a = select(refracts, larger, smaller), b = select(refracts, smaller, larger);
  const F b2 = b * b;
  const F rs_up = (a - c) * (a - c) + b2, rs_down = (a + c) * (a + c) + b2;
  const F rs = select(rs_down > zero, rs_up / max(rs_down, splat<F>(Tiny::k_smallest_normal)), one);
  const F up = a * c - s2, down = a * c + s2;
  const F rp_up = up * up + b2 * c2, rp_down = down * down + b2 * c2;
  const F rp = select(rp_down > zero, rs * (rp_up / max(rp_down, splat<F>(Tiny::k_smallest_normal))), rs);
  return min(half * (rs + rp), one);
}

// A direction sampled from a metal's lobe.
template <class F>
struct ConductorSample {
  Vec3Lanes<F> wo;
  Vec3Lanes<F> weight;  // per channel: Fresnel reflectance times masking of wo
  F pdf;                // per solid angle; 0: nothing is scattered
};

// `wi` is unit with wi.z > 0, and `view` was made from it; eta and k hold one value per channel.
template <class F>
FT_HD_INLINE ConductorSample<F> sample_conductor_lobe(const GgxView<F>& view, const Vec3Lanes<F>& wi,
                                                      const Vec3Lanes<F>& eta, const Vec3Lanes<F>& k,
                                                      const UnitPair<F>& u) {
  const F zero = splat<F>(0.0f);
  const Vec3Lanes<F> m = sample_visible_ggx(view, u);
  const F wi_m = dot(wi, m);
  ConductorSample<F> s;
  s.wo = unit_vector(m * (splat<F>(2.0f) * wi_m) - wi);
  const Mask_t<F> scatters = (s.wo.z > zero) & (wi_m > zero) & (m.z > zero);
  const F masking = ggx_masking(view.alpha_u, view.alpha_v, wi);
  // Density of visible normals over 4 wi.m, with wi.m cancelled.
  const F pdf = masking * ggx_density(view.alpha_u, view.alpha_v, m) / (splat<F>(4.0f) * wi.z);
  s.pdf = select(scatters, pdf, zero);
  const F out = select(scatters, ggx_masking(view.alpha_u, view.alpha_v, s.wo), zero);
  s.weight = {conductor_reflectance(wi_m, eta.x, k.x) * out, conductor_reflectance(wi_m, eta.y, k.y) * out,
              conductor_reflectance(wi_m, eta.z, k.z) * out};
  return s;
}

FT_LANES_END

#endif  // toggled guard
