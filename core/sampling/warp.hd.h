// Maps from the unit square to disks, spheres and triangles, and the elementary functions that they need.
//
// Sources: P. Shirley and K. Chiu, "A Low Distortion Map Between Disk and Square", 1997 (with the branch-free form of
// D. Cline); Malley's method for the cosine; E. Heitz, "A Low-Distortion Map Between Triangle and Square", 2019;
// T. Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 6(1), 2017. The polynomials are those of Cephes
// (S. Moshier): minimax in single precision.
// Every map preserves relative area, so that strata of the square stay strata of the same measure.
// Thread-safety: pure functions, no memory access.

#if defined(FIELDTRACE_CORE_SAMPLING_WARP_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_CORE_SAMPLING_WARP_HD_H_
#undef FIELDTRACE_CORE_SAMPLING_WARP_HD_H_
#else
#define FIELDTRACE_CORE_SAMPLING_WARP_HD_H_
#endif

#include "core/simd/lanes.hd.h"

FT_LANES_BEGIN

// Single-precision constants of the angle functions.
struct Angle {
  static constexpr float k_pi = 3.14159265358979323846f;
  static constexpr float k_half_pi = 1.57079632679489661923f;
  static constexpr float k_quarter_pi = 0.785398163397448309616f;
  static constexpr float k_two_pi = 6.28318530717958647693f;
  static constexpr float k_four_pi = 12.5663706143591729539f;
  static constexpr float k_inv_pi = 0.318309886183790671538f;
  static constexpr float k_inv_two_pi = 0.159154943091895335769f;
  static constexpr float k_inv_four_pi = 0.0795774715459476678844f;
  static constexpr float k_tan_eighth_pi = 0.414213562373095048802f;
};

// Replaces zero in a denominator: the smallest normal float, so that quotients of numerators up to 1 are finite (1 /
// 2^-126 = 2^126).
struct Tiny {
  static constexpr float k_smallest_normal = 0x1p-126f;
};

template <class F>
struct SinCos {
  F sine, cosine;
};

// sin and cos of x, |x| <= pi / 4. Absolute error below 2^-23; sin is relative: below 2^-23 |x|.
template <class F>
FT_HD_INLINE SinCos<F> sincos_octant(F x) {
  const F xx = x * x;
  const F s = splat<F>(-1.6666654611e-1f) + xx * (splat<F>(8.3321608736e-3f) + xx * splat<F>(-1.9515295891e-4f));
  const F c =
      splat<F>(4.166664568298827e-2f) + xx * (splat<F>(-1.388731625493765e-3f) + xx * splat<F>(2.443315711809948e-5f));
  return {x + x * (xx * s), splat<F>(1.0f) - xx * splat<F>(0.5f) + (xx * xx) * c};
}

// sin and cos of 2 pi t, 0 <= t <= 1 (t in turns). Absolute error below 2^-22.
template <class F>
FT_HD_INLINE SinCos<F> sincos_turns(F t) {
  const F quarters = t * splat<F>(4.0f);
  const F nearest = floor(quarters + splat<F>(0.5f));
  const SinCos<F> p = sincos_octant<F>((quarters - nearest) * splat<F>(Angle::k_half_pi));
  const Int_t<F> quadrant = to_int(nearest);  // 0..4
  const auto odd = (quadrant & splat_int<F>(1)) == splat_int<F>(1);
  const auto sine_negative = (quadrant & splat_int<F>(2)) == splat_int<F>(2);
  const auto cosine_negative = ((quadrant + splat_int<F>(1)) & splat_int<F>(2)) == splat_int<F>(2);
  const F sine = select(odd, p.cosine, p.sine);
  const F cosine = select(odd, p.sine, p.cosine);
  return {select(sine_negative, -sine, sine), select(cosine_negative, -cosine, cosine)};
}

// The angle in [0, pi] of the vector (x, y), y >= 0, not both zero. Relative error below 2^-21, for small angles too.
template <class F>
FT_HD_INLINE F angle_upper(F y, F x) {
  const F ax = abs(x);
  const F small = min(ax, y), large = max(ax, y);
  // Angles between pi/8 and pi/4 are taken relative to pi/4: tan(a - pi/4) = (tan a - 1) / (tan a + 1).
  const auto upper = small > large * splat<F>(Angle::k_tan_eighth_pi);
  const F numerator = select(upper, small - large, small);
  const F denominator = select(upper, small + large, large);
  const F q = numerator / max(denominator, splat<F>(Tiny::k_smallest_normal));
  const F qq = q * q;
  const F p =
      ((splat<F>(8.05374449538e-2f) * qq - splat<F>(1.38776856032e-1f)) * qq + splat<F>(1.99777106478e-1f)) * qq -
      splat<F>(3.33329491539e-1f);
  F angle = q + q * (qq * p) + select(upper, splat<F>(Angle::k_quarter_pi), splat<F>(0.0f));
  angle = select(ax < y, splat<F>(Angle::k_half_pi) - angle, angle);
  return select(x < splat<F>(0.0f), splat<F>(Angle::k_pi) - angle, angle);
}

// Two unit vectors that complete the unit vector z to a right-handed orthonormal basis. Continuous except across z.z =
// 0.
template <class F>
struct Basis {
  Vec3Lanes<F> x, y;
};

// `inverse` is 1 / (1 + |z.z|).
template <class F>
FT_HD_INLINE Basis<F> make_basis(const Vec3Lanes<F>& z, F inverse) {
  const F sign = copysign(splat<F>(1.0f), z.z);
  const F a = -copysign(inverse, z.z);
  const F b = z.x * z.y * a;
  return {{splat<F>(1.0f) + sign * z.x * z.x * a, sign * b, -sign * z.x}, {b, sign + z.y * z.y * a, -z.y}};
}

template <class F>
FT_HD_INLINE Basis<F> make_basis(const Vec3Lanes<F>& z) {
  return make_basis<F>(z, splat<F>(1.0f) / (splat<F>(1.0f) + abs(z.z)));
}

// A point of the unit disk in polar form: the unit vector (cosine, sine) and the radius in [0, 1].
template <class F>
struct DiskPoint {
  F cosine, sine, radius;
};

// The concentric map of [-1, 1]^2; uniform over the disk, so radius^2 is uniform in [0, 1].
template <class F>
FT_HD_INLINE DiskPoint<F> concentric_disk_centred(F a, F b) {
  const F aa = abs(a), bb = abs(b);
  const auto steep = aa < bb;
  const F radius = max(aa, bb);
  // The angle from the nearest axis, on the side of the larger coordinate. At the centre both are zero.
  const F small = select(steep, a, b) / max(radius, splat<F>(Tiny::k_smallest_normal));
  const SinCos<F> p = sincos_octant<F>(small * splat<F>(Angle::k_quarter_pi));
  const F along = copysign(p.cosine, select(steep, b, a));
  return {select(steep, p.sine, along), select(steep, along, p.sine), radius};
}

// The same from [0, 1)^2.
template <class F>
FT_HD_INLINE DiskPoint<F> concentric_disk(F u, F v) {
  return concentric_disk_centred<F>(splat<F>(2.0f) * u - splat<F>(1.0f), splat<F>(2.0f) * v - splat<F>(1.0f));
}

// Direction about +z with density cos / pi. (a, b) in [-1, 1]^2.
template <class F>
FT_HD_INLINE Vec3Lanes<F> cosine_hemisphere_centred(F a, F b) {
  const DiskPoint<F> p = concentric_disk_centred<F>(a, b);
  const F z = sqrt((splat<F>(1.0f) - p.radius) * (splat<F>(1.0f) + p.radius));
  return {p.radius * p.cosine, p.radius * p.sine, z};
}

// The same from [0, 1)^2.
template <class F>
FT_HD_INLINE Vec3Lanes<F> cosine_hemisphere(F u, F v) {
  return cosine_hemisphere_centred<F>(splat<F>(2.0f) * u - splat<F>(1.0f), splat<F>(2.0f) * v - splat<F>(1.0f));
}

// Direction with density 1 / (4 pi): Lambert's azimuthal map of the disk.
template <class F>
FT_HD_INLINE Vec3Lanes<F> uniform_sphere(F u, F v) {
  const DiskPoint<F> p = concentric_disk<F>(u, v);
  const F rest = (splat<F>(1.0f) - p.radius) * (splat<F>(1.0f) + p.radius);  // 1 - r^2 without cancellation
  const F xy = splat<F>(2.0f) * p.radius * sqrt(rest);
  return {xy * p.cosine, xy * p.sine, rest - p.radius * p.radius};
}

template <class F>
struct Barycentric {
  F b1, b2;
};

// Barycentric coordinates of vertices 1 and 2, uniform over a triangle.
template <class F>
FT_HD_INLINE Barycentric<F> uniform_triangle(F u, F v) {
  const auto above = u < v;
  const F half = select(above, u, v) * splat<F>(0.5f);
  return {select(above, half, u - half), select(above, v - half, half)};
}

FT_LANES_END

#endif  // toggled guard
