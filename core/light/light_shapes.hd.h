// Sampling each kind of light from points in lanes. One type per kind separates what depends on the shading point alone
// (setup) from what depends on the sample, so that many samples share one setup.
//
// Sources: sphere: the visible cone with the point on the sphere in closed form (F. Akalin, "Sampling the visible
// sphere", 2016; P. Shirley et al. 1996), rewritten here without cancellation: with m = 1 - cos(half angle), sin^2 of
// the direction's angle over sin^2 of the half angle is u (2 - u m) / (2 - m), and 1 minus it (1 - u)(2 - m (1 + u)) /
// (2 - m). Rectangle: C. Urena et al., "An Area-Preserving Parametrization for Spherical Rectangles", EGSR 2013, with
// the solid angle from A. van Oosterom and J. Strackee, "The Solid Angle of a Plane Triangle", 1983, and angles kept as
// sine and cosine. Others: uniform by area.
//
// Each kind's sample() takes a point (a, b) of [-1, 1)^2, and a third number in [0, 1) if k_third_number is set, and
// returns the vector from the ray origin to the displaced target (see LightSample). Displacing the target by delta
// along the emitting normal keeps the ray off the light: a planar or convex light lies behind the target's tangent
// plane and the ray arrives from the front (height >= 0), so it stays delta away.
// Thread-safety: pure functions; the mesh kind reads its table's triangles.

#if defined(FIELDTRACE_CORE_LIGHT_LIGHT_SHAPES_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_CORE_LIGHT_LIGHT_SHAPES_HD_H_
#undef FIELDTRACE_CORE_LIGHT_LIGHT_SHAPES_HD_H_
#else
#define FIELDTRACE_CORE_LIGHT_LIGHT_SHAPES_HD_H_
#endif

#include "core/light/light.hd.h"
#include "core/sampling/warp.hd.h"
#include "core/simd/lanes.hd.h"

FT_LANES_BEGIN

// The shading point that samples are drawn for. World space.
template <class F>
struct LightShadingPoint {
  Vec3Lanes<F> origin;   // of the ray; for shading points that transmit, before the offset
  Vec3Lanes<F> shading;  // unit shading normal
  F delta;               // the light's displacement for this origin (Light::error_base)
  F transmits;           // 1 or 0
};

template <class F>
struct LightSample {
  Vec3Lanes<F> d;       // from the origin to the displaced target; unit for lights at infinity
  Vec3Lanes<F> normal;  // unit, on the emitting side (area kinds only)
  F height;             // of the origin over the target's tangent plane (area kinds), or any value >= 0: < 0 is hidden
  F cos_s;              // of the shading normal and the direction to the undisplaced target
  F inverse_pdf;        // 1 / solid-angle density; point, directional: the fall-off
  F pdf;                // solid-angle density; 0 for delta lights
};

template <class F>
FT_HD_INLINE Vec3Lanes<F> splat3(const float* p) {
  return {splat<F>(p[0]), splat<F>(p[1]), splat<F>(p[2])};
}

// [-1, 1) to [0, 1).
template <class F>
FT_HD_INLINE F from_centred(F a) {
  return a * splat<F>(0.5f) + splat<F>(0.5f);
}

// The sample of a surface point at `to_point` from the origin, chosen with density 1 / inverse_area per area.
template <class F>
FT_HD_INLINE LightSample<F> sample_by_area(const LightShadingPoint<F>& r, const Vec3Lanes<F>& to_point,
                                           const Vec3Lanes<F>& normal, F inverse_density) {
  const F tiny = splat<F>(Tiny::k_smallest_normal);
  const F inverse_length = splat<F>(1.0f) / max(sqrt(dot(to_point, to_point)), r.delta);
  const F facing = -dot(normal, to_point);
  const F cos_light = max(facing, splat<F>(0.0f)) * inverse_length;
  const F inverse_pdf = cos_light * inverse_density * inverse_length * inverse_length;
  return {to_point + normal * r.delta,
          normal,
          facing - r.delta,
          dot(r.shading, to_point) * inverse_length,
          inverse_pdf,
          splat<F>(1.0f) / max(inverse_pdf, tiny)};
}

// ---------------------------------------------------------------- sphere

template <class F>
struct SphereLight {
  static constexpr bool k_surface = true, k_finite = true, k_third_number = false, k_frequent = true;
  static constexpr bool k_varies = false;
  Vec3Lanes<F> centre;
  F radius, inverse_radius;

  struct Setup {
    Vec3Lanes<F> axis, x, y;
    F distance, radius, sine_max, one_minus_cosine;
    F beta_base, gamma_base, slope;  // see sample()
    F shading_axis, inverse_pdf, pdf;
    template <class Op>
    FT_HD_INLINE Setup map(const Op& op) const {
      return {op(axis),
              op(x),
              op(y),
              op(distance),
              op(radius),
              op(sine_max),
              op(one_minus_cosine),
              op(beta_base),
              op(gamma_base),
              op(slope),
              op(shading_axis),
              op(inverse_pdf),
              op(pdf)};
    }
  };

  FT_HD explicit SphereLight(const Light& light)
      : centre(splat3<F>(light.centre)), radius(splat<F>(light.radius)), inverse_radius(splat<F>(1.0f) / radius) {}

  FT_HD_INLINE Setup setup(const LightShadingPoint<F>& r) const {
    const F one = splat<F>(1.0f), tiny = splat<F>(Tiny::k_smallest_normal);
    const Vec3Lanes<F> to_centre = centre - r.origin;
    const F target_radius = radius + r.delta;
    // Origins closer than the displacement count as inside: sample() finds them below the tangent plane, whatever the
    // rest, for which they are taken to lie on the target.
    const F length = sqrt(dot(to_centre, to_centre));
    const F distance = max(length, target_radius);
    const F inverse_distance = one / distance;
    const Vec3Lanes<F> axis = to_centre * inverse_distance;
    const F sine_max = radius * inverse_distance;
    const F cosine_max = sqrt((distance - radius) * (distance + radius)) * inverse_distance;
    // 1 / (1 + cosine_max) and the basis' 1 / (1 + |axis.z|) by one division.
    const F one_plus_cosine = one + cosine_max, one_plus_z = one + abs(axis.z);
    const F inverse = one / (one_plus_cosine * one_plus_z);
    const F inverse_cosine = inverse * one_plus_z;
    const Basis<F> basis = make_basis<F>(axis, inverse * one_plus_cosine);
    const F m = max(sine_max * sine_max * inverse_cosine, tiny);  // 1 - cosine_max
    const F slope = m * inverse_cosine;
    const F beta_base = inverse_cosine + inverse_cosine;
    const F radii = distance * inverse_radius;
    const F pdf = min(one_plus_cosine * splat<F>(Angle::k_inv_two_pi) * radii * radii, splat<F>(k_most_density));
    return {axis, basis.x,   basis.y,           length, target_radius,        sine_max,
            m,    beta_base, beta_base - slope, slope,  dot(r.shading, axis), splat<F>(Angle::k_two_pi) * m,
            pdf};
  }

  FT_HD_INLINE LightSample<F> sample(const LightShadingPoint<F>& r, const Setup& s, F a, F b, F) const {
    const F one = splat<F>(1.0f);
    const DiskPoint<F> p = concentric_disk_centred<F>(a, b);
    const F uniform = p.radius * p.radius;
    const F rest = (one - p.radius) * (one + p.radius);  // 1 - uniform
    // Ratio of the sines of the direction and the cone, and its complement: the sine and cosine at the light. With
    // slope = m / (2 - m) the bases are (2, 2 - m) / (2 - m).
    const F fall = uniform * s.slope;
    const F beta = p.radius * sqrt(s.beta_base - fall);
    const F gamma = sqrt(rest * (s.gamma_base - fall));
    const F sine = beta * s.sine_max;
    const F cosine = one - uniform * s.one_minus_cosine;
    const F cos_alpha = gamma * cosine + beta * sine;  // of the angle at the sphere's centre
    const F sin_alpha = beta * cosine - gamma * sine;
    const F along = s.distance - cos_alpha * s.radius;
    const F across = sin_alpha * s.radius;
    const Vec3Lanes<F> e = s.x * p.cosine + s.y * p.sine;
    return {s.axis * along + e * across,
            e * sin_alpha - s.axis * cos_alpha,
            cos_alpha * s.distance - s.radius,
            cosine * s.shading_axis + sine * dot(r.shading, e),
            s.inverse_pdf,
            s.pdf};
  }

  // The density of the smallest cone that setup() returns.
  static constexpr float k_most_density = Angle::k_inv_two_pi / Tiny::k_smallest_normal;
};

// ---------------------------------------------------------------- rectangle

template <class F>
struct RectangleLight {
  static constexpr bool k_surface = true, k_finite = true, k_third_number = false, k_frequent = true;
  static constexpr bool k_varies = false;
  // Below this solid angle (sr) the rectangle is sampled by area. The angle that is inverted below carries a few
  // roundings of values up to 2 pi, some 2^-20 in all; relative to the solid angle that is at most 2^-11 from here on.
  // A rectangle this small is nearly flat on the sphere, so that area sampling loses little.
  static constexpr float k_min_solid_angle = 0x1p-9f;

  // `across` is 1 + cos of the angle between opposite corners, with an absolute error of some 2^-22: from here on its
  // relative error is below 2^-17.
  static constexpr float k_cancelled = 0x1p-5f;

  Vec3Lanes<F> centre, edge_x, edge_y, normal;
  F half_x, half_y, area;

  struct Setup {
    // The rectangle seen from the origin: x in [x0, x0 + width], y in [y0, y1] along the edges, at height z below.
    F x0, x1, y0, y1, z, height;
    F b0, b1, e0, cosine_k, sine_k, turns, inverse_pdf;
    template <class Op>
    FT_HD_INLINE Setup map(const Op& op) const {
      return {op(x0), op(x1), op(y0),       op(y1),     op(z),     op(height),     op(b0),
              op(b1), op(e0), op(cosine_k), op(sine_k), op(turns), op(inverse_pdf)};
    }
  };

  FT_HD explicit RectangleLight(const Light& light)
      : centre(splat3<F>(light.centre)),
        edge_x(splat3<F>(light.unit_axis[0])),
        edge_y(splat3<F>(light.unit_axis[1])),
        normal(splat3<F>(light.normal)),
        half_x(splat<F>(light.half_size[0])),
        half_y(splat<F>(light.half_size[1])),
        area(splat<F>(light.area)) {}

  FT_HD_INLINE Setup setup(const LightShadingPoint<F>& r) const {
    const F zero = splat<F>(0.0f), one = splat<F>(1.0f);
    const Vec3Lanes<F> to_centre = centre - r.origin;
    const F cx = dot(to_centre, edge_x), cy = dot(to_centre, edge_y), cz = -dot(to_centre, normal);
    const F x0 = cx - half_x, x1 = cx + half_x, y0 = cy - half_y, y1 = cy + half_y;
    // Origins behind the plane or within the displacement are hidden; for them the rest is computed just above it.
    const F z = max(cz, r.delta);
    // Everything below is in units of the largest coordinate, so that products of lengths stay in range.
    const F unit = one / max(max(max(abs(x0), abs(x1)), max(abs(y0), abs(y1))), z);
    const F ux0 = x0 * unit, ux1 = x1 * unit, uy0 = y0 * unit, uy1 = y1 * unit, uz = z * unit;
    const F xx0 = ux0 * ux0, xx1 = ux1 * ux1, yy0 = uy0 * uy0, yy1 = uy1 * uy1, zz = uz * uz;
    const F yz0 = yy0 + zz, yz1 = yy1 + zz;

    // The planes through the origin and the edges: sines a, b of their elevations over the edges along y and x, and
    // cosines f, e. One division for all.
    const F lx0 = sqrt(xx0 + zz), lx1 = sqrt(xx1 + zz), ly0 = sqrt(yz0), ly1 = sqrt(yz1);
    const F lxx = lx0 * lx1, lyy = ly0 * ly1;
    const F inverse = one / (lxx * lyy);
    const F inverse_x = inverse * lyy, inverse_y = inverse * lxx;
    const F ix0 = inverse_x * lx1, ix1 = inverse_x * lx0, iy0 = inverse_y * ly1, iy1 = inverse_y * ly0;
    const F a0 = -(ux0 * ix0), a1 = ux1 * ix1, b0 = -(uy0 * iy0), b1 = uy1 * iy1;
    const F f0 = uz * ix0, f1 = uz * ix1, e0 = uz * iy0, e1 = uz * iy1;
    // Cosines and sines of the four inner angles; 1 - (a b)^2 = e^2 + b^2 f^2 has no cancellation.
    const F bb0 = b0 * b0, bb1 = b1 * b1, ee0 = e0 * e0, ee1 = e1 * e1, ff0 = f0 * f0, ff1 = f1 * f1;
    const F c0 = -(b0 * a1), c1 = -(b1 * a1), c2 = -(b1 * a0), c3 = -(b0 * a0);
    const F s0 = sqrt(ee0 + bb0 * ff1), s1 = sqrt(ee1 + bb1 * ff1);
    const F s2 = sqrt(ee1 + bb1 * ff0), s3 = sqrt(ee0 + bb0 * ff0);
    const F cosine_k = c2 * c3 - s2 * s3, sine_k = -(s2 * c3 + c2 * s3);   // k = 2 pi - g2 - g3
    const F cosine_end = c0 * c1 - s0 * s1, sine_end = s0 * c1 + c0 * s1;  // k + S = g0 + g1

    // Solid angle S: tan(S / 2) of two triangles with the same numerator, added as complex numbers. Keeps the digits of
    // small angles, but loses those of lights so long that opposite corners are nearly opposite directions (`across`
    // cancels); there S is the difference of the angles k + S and k.
    const F r00 = sqrt(xx0 + yz0), r10 = sqrt(xx1 + yz0), r11 = sqrt(xx1 + yz1), r01 = sqrt(xx0 + yz1);
    const F xy = ux0 * ux1 + zz, yx = uy0 * uy1 + zz, diagonal = ux0 * ux1 + yx;
    const F numerator = uz * ((half_x + half_x) * unit) * ((half_y + half_y) * unit);
    const F across = r00 * r11 + diagonal;
    const F d1 = across * r10 + (xy + yy0) * r11 + (yx + xx1) * r00;
    const F d2 = across * r01 + (xy + yy1) * r00 + (yx + xx0) * r11;
    const F triangles_x = d1 * d2 - numerator * numerator, triangles_y = numerator * (d1 + d2);
    const F cosine_s = cosine_end * cosine_k + sine_end * sine_k;
    const F sine_s = sine_end * cosine_k - cosine_end * sine_k;
    // Half of S from its cosine and sine. A small negative sine means either a rounding of 0 or nearly 2 pi.
    const auto acute = cosine_s > zero;
    const F turn = select(triangles_x < zero, splat<F>(-1.0f), one);
    const F half_s_x = select(acute, (one + cosine_s) * turn, sine_s);
    const F half_s_y = select(acute, max(sine_s * turn, zero), one - cosine_s);
    const auto opposite = across < r00 * r11 * splat<F>(k_cancelled);
    const F solid_angle = splat<F>(2.0f) * angle_upper<F>(select(opposite, half_s_y, triangles_y),
                                                          select(opposite, half_s_x, triangles_x));
    const auto small = solid_angle < splat<F>(k_min_solid_angle);
    return {x0,         x1,       y0,     y1,
            z,          cz,       b0,     b1,
            e0,         cosine_k, sine_k, select(small, splat<F>(-1.0f), solid_angle * splat<F>(Angle::k_inv_two_pi)),
            solid_angle};
  }

  FT_HD_INLINE LightSample<F> sample(const LightShadingPoint<F>& r, const Setup& s, F a, F b, F) const {
    const F zero = splat<F>(0.0f), one = splat<F>(1.0f), tiny = splat<F>(Tiny::k_smallest_normal);
    const F u = from_centred(a), v = from_centred(b);
    const auto by_area = s.turns < zero;
    // The angle k + u S, and x / z, the tangent of the elevation of the cut through x. With the published f = c / sine
    // its sine is 1 / sqrt(f^2 + b0^2), so the tangent is sine / sqrt(c^2 - (1 - b0^2) sine^2): no quotient by the
    // sine.
    // In this order, since a light of NaN has no turns: max() is its first operand then.
    const SinCos<F> us = sincos_turns<F>(max(zero, u * s.turns));
    const F cosine = s.cosine_k * us.cosine - s.sine_k * us.sine;
    const F sine = s.sine_k * us.cosine + s.cosine_k * us.sine;
    const F c = cosine * s.b0 - s.b1;
    const F q = max((c - sine * s.e0) * (c + sine * s.e0), tiny);
    const F x_spherical = s.z * sine * copysign(one, c) / sqrt(q);
    const F x_uniform = s.x0 + u * (s.x1 - s.x0);
    const F x = min(max(select(by_area, x_uniform, x_spherical), s.x0), s.x1);
    // Uniform in the sine of the elevation along y.
    const F dd = x * x + s.z * s.z;
    const F l0 = sqrt(dd + s.y0 * s.y0), l1 = sqrt(dd + s.y1 * s.y1);
    const F inverse = one / (l0 * l1);
    const F h0 = s.y0 * (l1 * inverse), h1 = s.y1 * (l0 * inverse);
    const F h = h0 + v * (h1 - h0);
    const F hh = (one - h) * (one + h);
    const F y_uniform = s.y0 + v * (s.y1 - s.y0);
    const F y_spherical = h * sqrt(dd / max(hh, tiny));
    const F y = min(max(select(by_area, y_uniform, y_spherical), s.y0), s.y1);
    const F inverse_length = one / sqrt(dd + y * y);
    const Vec3Lanes<F> to_point = edge_x * x + edge_y * y - normal * s.height;
    const F inverse_pdf_area = s.z * area * inverse_length * inverse_length * inverse_length;
    const F inverse_pdf = max(select(by_area, inverse_pdf_area, s.inverse_pdf), tiny);
    return {to_point + normal * r.delta,
            normal,
            s.height - r.delta,
            dot(r.shading, to_point) * inverse_length,
            inverse_pdf,
            one / inverse_pdf};
  }
};

FT_LANES_END

#endif  // toggled guard
