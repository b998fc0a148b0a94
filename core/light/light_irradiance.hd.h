// Closed-form irradiance of whole, unoccluded lights, in double-precision lanes (contract: light_irradiance.h).
//
// Spheres: Lambert, "Photometria", 1760. Rectangles: the sum over the edges of angle times the cosine of the edge's
// normal (Baum et al., "Improving Radiosity Solutions Through the Use of Analytically Determined Form-Factors",
// SIGGRAPH 1989). The terms of a small light nearly cancel, hence double precision.
// Thread-safety: pure functions.

#if defined(FIELDTRACE_CORE_LIGHT_LIGHT_IRRADIANCE_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_CORE_LIGHT_LIGHT_IRRADIANCE_HD_H_
#undef FIELDTRACE_CORE_LIGHT_LIGHT_IRRADIANCE_HD_H_
#else
#define FIELDTRACE_CORE_LIGHT_LIGHT_IRRADIANCE_HD_H_
#endif

#include "core/light/light.hd.h"
#include "core/sampling/warp.hd.h"
#include "core/simd/double_lanes.hd.h"

FT_LANES_BEGIN

template <class D>
FT_HD_INLINE Vec3Lanes<D> splat_doubles(const float (&v)[3]) {
  return {splat_double<D>(double(v[0])), splat_double<D>(double(v[1])), splat_double<D>(double(v[2]))};
}

// A surface that faces the light: world space, unit normals on the light's side.
template <class D>
struct LitSurface {
  Vec3Lanes<D> point, geometric, shading;
};

// What no irradiance can be: the light has no closed form there.
inline constexpr double k_no_irradiance = -1.0;

// atan(u) / u for u in [0, 1] as a polynomial in u^2 of degree 12, of least maximal relative error: 9.4e-12. The edges'
// terms may cancel to a thousandth where a near light is seen at a grazing angle.
template <class D>
FT_HD_INLINE D atan_ratio(D squared) {
  D p = splat_double<D>(0.00043295875183941169);
  p = p * squared + splat_double<D>(-0.0032783039425875087);
  p = p * squared + splat_double<D>(0.01164662731285457);
  p = p * squared + splat_double<D>(-0.026338645099120966);
  p = p * squared + splat_double<D>(0.043967285833943208);
  p = p * squared + splat_double<D>(-0.060426368600664818);
  p = p * squared + splat_double<D>(0.075039633272278985);
  p = p * squared + splat_double<D>(-0.090516205627416663);
  p = p * squared + splat_double<D>(0.111057417594812);
  p = p * squared + splat_double<D>(-0.14285271440618341);
  p = p * squared + splat_double<D>(0.19999980837764031);
  p = p * squared + splat_double<D>(-0.33333333005325955);
  return p * squared + splat_double<D>(0.99999999999065348);
}

// Irradiance from a sphere of radiance 1, or k_no_irradiance.
template <class D>
FT_HD_INLINE D irradiance_of_sphere(const Light& light, const LitSurface<D>& surface) {
  const D radius = splat_double<D>(double(light.radius));
  const Vec3Lanes<D> to_centre = splat_doubles<D>(light.centre) - surface.point;
  const D squared = dot(to_centre, to_centre), height = dot(surface.shading, to_centre);
  const auto whole = (squared > radius * radius) & (height > radius) & (dot(surface.geometric, to_centre) > radius);
  // The float nearest to pi, by which diffuse reflectances are divided: the two cancel.
  const D value = splat_double<D>(double(Angle::k_pi)) * radius * radius * height / (squared * sqrt(squared));
  return select(whole, value, splat_double<D>(k_no_irradiance));
}

// The same from a rectangle that emits towards Light::normal.
template <class D>
FT_HD_INLINE D irradiance_of_rectangle(const Light& light, const LitSurface<D>& surface) {
  const D zero = splat_double<D>(0.0), one = splat_double<D>(1.0);
  const Vec3Lanes<D> centre = splat_doubles<D>(light.centre) - surface.point;
  const Vec3Lanes<D> x = splat_doubles<D>(light.axis[0]), y = splat_doubles<D>(light.axis[1]);
  Vec3Lanes<D> corner[4] = {centre - x - y, centre + x - y, centre + x + y, centre - x + y};
  auto whole = zero > dot(splat_doubles<D>(light.normal), centre);  // else behind the light
  for (Vec3Lanes<D>& c : corner) {
    whole = whole & (dot(surface.shading, c) > zero) & (dot(surface.geometric, c) > zero);
    c = c * (one / sqrt(dot(c, c)));
  }
  D sum = zero;
  for (int i = 0; i < 4; ++i) {
    const Vec3Lanes<D>& a = corner[i];
    const Vec3Lanes<D>& b = corner[(i + 1) % 4];
    const Vec3Lanes<D> normal = cross(a, b);  // of length sin(angle)
    const D length = one + dot(a, b);
    // tan(angle / 2) and u = tan(angle / 4), in which angle / sin(angle) = atan(u) / u (1 + u^2)^2 / (1 - u^2).
    const D half = sqrt(dot(normal, normal)) / length;
    const D u = half / (one + sqrt(one + half * half));
    const D squared = u * u, plus = one + squared, minus = one - squared;
    whole = whole & (length > zero) & (minus > zero);
    sum = sum + atan_ratio(squared) * plus * plus / minus * dot(normal, surface.shading);
  }
  return select(whole, splat_double<D>(0.5) * abs(sum), splat_double<D>(k_no_irradiance));
}

FT_LANES_END

#endif  // toggled guard
