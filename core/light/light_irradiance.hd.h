// Closed-form vector irradiance of whole, unoccluded lights, in double-precision lanes (contract: light_irradiance.h).
//
// Spheres: Lambert, "Photometria", 1760. Parallelograms: half the sum over the edges of angle times the unit normal of
// the edge's plane (Baum et al., "Improving Radiosity Solutions Through the Use of Analytically Determined
// Form-Factors", SIGGRAPH 1989). Disks: the form factors of elements parallel and perpendicular to the disk (Howell, "A
// Catalog of Radiation Heat Transfer Configuration Factors", B-13 and B-15), rewritten without differences.
// In floats, rounding the vector to the light's centre alone moves the result by 2^-24 / cos of the view, and the terms
// of a small parallelogram nearly cancel, hence double precision.
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

// What no irradiance can be: the light has no closed form there.
inline constexpr double k_no_irradiance = -1.0;

// The same for the first component of vectors, which are no longer than pi.
inline constexpr double k_no_vector = 4.0;

// Bound on the rounding of a determinant N c relative to the sum of |N_i c_i|: 1 for the difference of points, 1 for
// the normal (products of floats are exact), 1 for each product and 2 for the sum, each 2^-53, and a margin.
inline constexpr double k_plane_rounding = 0x1p-50;

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

// A light as seen from points: its vector irradiance there, and whether all of it lies above a horizon.
template <class D>
struct SphereSeen {
  Vec3Lanes<D> centre;
  D radius;
  FT_HD explicit SphereSeen(const Light& light)
      : centre(splat_doubles<D>(light.centre)), radius(splat_double<D>(double(light.radius))) {}

  FT_HD_INLINE Vec3Lanes<D> vector(const Vec3Lanes<D>& point) const {
    const Vec3Lanes<D> c = centre - point;
    const D squared = dot(c, c), area = radius * radius;
    // The float nearest to pi, by which diffuse reflectances are divided: the two cancel.
    const Vec3Lanes<D> v = c * (splat_double<D>(double(Angle::k_pi)) * area / (squared * sqrt(squared)));
    return {select(squared > area, v.x, splat_double<D>(k_no_vector)), v.y, v.z};
  }
  FT_HD_INLINE auto above(const Vec3Lanes<D>& normal, const Vec3Lanes<D>& point) const {
    return dot(normal, centre - point) > radius;
  }
};

// The half axes x, y of a planar light, in the order in which x cross y points away from the lit side. The height
// (x cross y) c of the vector c to the centre is then positive in front.
template <class D>
struct PlaneSeen {
  Vec3Lanes<D> centre, x, y, normal;  // not unit
  FT_HD explicit PlaneSeen(const Light& light)
      : centre(splat_doubles<D>(light.centre)), x(splat_doubles<D>(light.axis[0])), y(splat_doubles<D>(light.axis[1])) {
    normal = cross(x, y);
    const D zero = splat_double<D>(0.0);
    const D turn =
        select(dot(normal, splat_doubles<D>(light.normal)) > zero, splat_double<D>(-1.0), splat_double<D>(1.0));
    y = y * turn;
    normal = normal * turn;
  }
  // `v` in front, 0 behind, and no vector within rounding of the plane.
  FT_HD_INLINE Vec3Lanes<D> one_sided(const Vec3Lanes<D>& v, const Vec3Lanes<D>& c, D height) const {
    const D zero = splat_double<D>(0.0);
    const D rounding =
        splat_double<D>(k_plane_rounding) * (abs(normal.x * c.x) + abs(normal.y * c.y) + abs(normal.z * c.z));
    const auto front = height > rounding;
    const D x_else = select(zero - rounding > height, zero, splat_double<D>(k_no_vector));
    return {select(front, v.x, x_else), select(front, v.y, zero), select(front, v.z, zero)};
  }
};

template <class D>
struct ParallelogramSeen : PlaneSeen<D> {
  using PlaneSeen<D>::centre, PlaneSeen<D>::x, PlaneSeen<D>::y, PlaneSeen<D>::normal;
  FT_HD explicit ParallelogramSeen(const Light& light) : PlaneSeen<D>(light) {}

  // The angle between a and b over |a cross b|, from |a| |b|, a b and the half of a cross b. With
  // k = |a| |b| + a b + sqrt(2 |a| |b| (|a| |b| + a b)), tan(angle / 4) = |a cross b| / k.
  static FT_HD_INLINE D edge(D lengths, D cosine, const Vec3Lanes<D>& half_cross) {
    const D squared = splat_double<D>(4.0) * dot(half_cross, half_cross);
    // Beyond a right angle, where |a| |b| + a b cancels, both sides of the fraction are multiplied by |a| |b| - a b.
    const auto wide = splat_double<D>(0.0) > cosine;
    const D factor = select(wide, lengths - cosine, splat_double<D>(1.0));
    const D plus = select(wide, squared, lengths + cosine);
    const D inverse = factor / (plus + sqrt(splat_double<D>(2.0) * lengths * plus * factor));
    return splat_double<D>(4.0) * inverse * atan_ratio(squared * inverse * inverse);
  }

  FT_HD_INLINE Vec3Lanes<D> vector(const Vec3Lanes<D>& point) const {
    const Vec3Lanes<D> c = centre - point;
    const Vec3Lanes<D> p0 = c - x - y, p1 = c + x - y, p2 = c + x + y, p3 = c - x + y;
    const D r0 = sqrt(dot(p0, p0)), r1 = sqrt(dot(p1, p1)), r2 = sqrt(dot(p2, p2)), r3 = sqrt(dot(p3, p3));
    const Vec3Lanes<D> u = cross(c, x), v = cross(c, y);
    const Vec3Lanes<D> n0 = normal + u, n1 = normal + v, n2 = normal - u, n3 = normal - v;  // p0 cross p1 over 2, ...
    const Vec3Lanes<D> sum = n0 * edge(r0 * r1, dot(p0, p1), n0) + n1 * edge(r1 * r2, dot(p1, p2), n1) +
                             n2 * edge(r2 * r3, dot(p2, p3), n2) + n3 * edge(r3 * r0, dot(p3, p0), n3);
    return PlaneSeen<D>::one_sided(sum, c, dot(normal, c));
  }
  FT_HD_INLINE auto above(const Vec3Lanes<D>& n, const Vec3Lanes<D>& point) const {
    return dot(n, centre - point) > abs(dot(n, x)) + abs(dot(n, y));
  }
};

// A circle of the area that the half axes span.
template <class D>
struct DiskSeen : PlaneSeen<D> {
  using PlaneSeen<D>::centre, PlaneSeen<D>::normal;
  D area;  // over pi
  FT_HD explicit DiskSeen(const Light& light) : PlaneSeen<D>(light), area(sqrt(dot(normal, normal))) {}

  FT_HD_INLINE Vec3Lanes<D> vector(const Vec3Lanes<D>& point) const {
    const D zero = splat_double<D>(0.0), two = splat_double<D>(2.0);
    const Vec3Lanes<D> c = centre - point;
    const D height = dot(normal, c), squared = dot(c, c), above = height / area;
    const D less = squared - area, root = sqrt(less * less + splat_double<D>(4.0) * height * above);
    const D along = splat_double<D>(double(Angle::k_pi)) * two * height / (root * (root + squared + area));
    // 2 area above / (root + less), in the form that does not cancel.
    const D rise = select(less > zero, two * height / (root + less), (root - less) / (two * above));
    return PlaneSeen<D>::one_sided((c + normal * (rise / area)) * along, c, height);
  }
};

FT_LANES_END

#endif  // toggled guard
