// The hull of two balls and whether an object's ball reaches into it, for one lane type (hybrid/culling/shaft.h).
//
// Space: world, in doubles. Thread-safety: pure functions.

#if defined(FIELDTRACE_HYBRID_CULLING_SHAFT_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_HYBRID_CULLING_SHAFT_HD_H_
#undef FIELDTRACE_HYBRID_CULLING_SHAFT_HD_H_
#else
#define FIELDTRACE_HYBRID_CULLING_SHAFT_HD_H_
#endif

#include "core/simd/double_lanes.hd.h"

FT_LANES_BEGIN

// From the ball about the shading points to that of the light.
template <class D>
struct BallHull {
  Vec3Lanes<D> origin, along;  // centre of the shading points' ball; unit vector to the light
  D length;                    // from ball to ball
  D radius;                    // of the shading points' ball
  D widening;                  // growth of the radius per distance along the axis, in (-1, 1)
  D lean;                      // how far up the axis the nearest ball lies, per distance from the axis
  D extent;                    // sum of the hull's distances, for bounding the rounding
};

// Of the ball around the box from `lower` to `upper`, and the light's.
template <class D>
FT_HD_INLINE BallHull<D> hull_to_light(const Vec3Lanes<D>& lower, const Vec3Lanes<D>& upper,
                                       const Vec3Lanes<D>& light_centre, D light_radius) {
  const D zero = splat_double<D>(0.0), one = splat_double<D>(1.0), half = splat_double<D>(0.5);
  const Vec3Lanes<D> diagonal = upper - lower;
  BallHull<D> h;
  h.origin = (lower + upper) * half;
  h.radius = half * sqrt(dot(diagonal, diagonal));
  const Vec3Lanes<D> axis = light_centre - h.origin;
  h.length = sqrt(dot(axis, axis));
  const auto is_apart = h.length > zero;
  h.along = {select(is_apart, axis.x / h.length, zero), select(is_apart, axis.y / h.length, zero),
             select(is_apart, axis.z / h.length, zero)};
  // Where the balls' radii differ by more than this share of the distance between their centres, the hull becomes a
  // cylinder of the larger radius: the cone's rim would be rounded too much (1 - k^2 cancels), and one ball hides most
  // of the other anyway.
  constexpr double k_widest = 0.99;
  const auto is_cone = splat_double<D>(k_widest) * h.length > abs(light_radius - h.radius);
  h.widening = select(is_cone, (light_radius - h.radius) / h.length, zero);
  h.lean = h.widening / sqrt(one - h.widening * h.widening);
  h.radius = select(is_cone, h.radius, max(h.radius, light_radius));
  h.extent = h.length + h.radius + light_radius;
  return h;
}

// Where the ball lies outside. `rounding`: of the test, relative to the sum of the distances that enter it.
template <class D>
FT_HD_INLINE auto misses_ball(const BallHull<D>& h, const Vec3Lanes<D>& centre, D radius, double rounding) {
  const D zero = splat_double<D>(0.0);
  const Vec3Lanes<D> v = centre - h.origin;
  const D along = dot(v, h.along);
  const Vec3Lanes<D> aside = v - h.along * along;
  const D across = sqrt(dot(aside, aside));
  // The hull is the union of the balls about the axis points s with radius radius + widening s. The one nearest to the
  // object's centre minimises sqrt(across^2 + (s - along)^2) - widening s, which is convex in s.
  const D wanted = along + h.lean * across;
  const D s = select(wanted > h.length, h.length, select(zero > wanted, zero, wanted));
  const D gap = sqrt(across * across + (s - along) * (s - along)) - h.widening * s;
  const D sum = sqrt(dot(v, v)) + radius + h.extent;
  // Bounds that are not finite do not miss.
  return gap > radius + h.radius + splat_double<D>(rounding) * sum;
}

FT_LANES_END

#endif  // toggled guard
