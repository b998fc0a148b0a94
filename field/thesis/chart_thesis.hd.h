// The thesis' chart: rays that enter the unit ball <-> samples addressed by a position and a direction cell.
//
// Position, where the ray enters: M. Slater, "Constant Time Queries on Uniformly Distributed Points on a Hemisphere",
// Journal of Graphics Tools 7(1), 2002: four faces of an octahedron, each cut n = 5 times into four spherical triangles
// at the middles of its edges, make 2 * 4^n + 2 * 2^n + 1 = 2,113 points a hemisphere. Two hemispheres are 4,226
// samples: the 128 points of the rim lie in both, and an entry point of z = 0 belongs to the upper one.
// Direction: P. Shirley and K. Chiu, "A Low Distortion Map Between Disk and Square", 1997, with Malley's projection of
// the disk up to the hemisphere about the inward normal at the entry point; M x M cells, M = 32, 64 or 128.
// Source: A. Andreadis, "Ray Tracing Acceleration using Displacement Fields on GPU", 2008.
//
// Slater answers a query from a rendered table. Here the five subdivisions are followed by arithmetic alone: the
// cosines of a triangle's edges and the query's weights on its corners suffice for the next subdivision.
//
// Space: unit space (field/chart/chart.hd.h). Exactness: only + - x / sqrt floor in the written order, as in that file.
// Thread-safety: pure functions. Errors: none; directions must be unit and finite (unchecked).

#if defined(FIELDTRACE_FIELD_THESIS_CHART_THESIS_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_FIELD_THESIS_CHART_THESIS_HD_H_
#undef FIELDTRACE_FIELD_THESIS_CHART_THESIS_HD_H_
#else
#define FIELDTRACE_FIELD_THESIS_CHART_THESIS_HD_H_
#endif

#include "core/platform/platform.h"
#include "core/sampling/warp.hd.h"
#include "core/simd/lanes.hd.h"
#include "field/chart/chart.hd.h"
#include "field/store/view.h"

FT_LANES_BEGIN

constexpr int k_thesis_level = 5;
constexpr int k_thesis_side = 1 << k_thesis_level;  // edges along an octant's side
constexpr int k_thesis_hemisphere = 2 * k_thesis_side * k_thesis_side + 2 * k_thesis_side + 1;  // 2,113
constexpr int k_thesis_positions = 2 * k_thesis_hemisphere;                                     // 4,226

// A point of the subdivision, by its place in the unfolded octahedron: whole numbers with |i| + |j| <= k_thesis_side,
// i along x and j along y, the pole at (0, 0), the rim where the sum is k_thesis_side.
template <class F>
struct ThesisVertex {
  F i, j;
  Mask_t<F> lower;  // the hemisphere z < 0
};

// ---------------------------------------------------------------- positions

// The point of the subdivision, within p's hemisphere, that is nearest to the unit vector p.
template <class F>
FT_HD_INLINE ThesisVertex<F> nearest_thesis_vertex(const Vec3Lanes<F>& p) {
  const F zero = splat<F>(0.0f), half = splat<F>(0.5f), one = splat<F>(1.0f), two = splat<F>(2.0f);
  // p = a A + b B + c C in the octant of its signs, with corners A = x, B = y and C = z mutually perpendicular.
  F a = abs(p.x), b = abs(p.y), c = abs(p.z);
  F cos_ab = zero, cos_bc = zero, cos_ca = zero;
  // C's place; A lies `step` from it along i, B along j. A middle triangle is turned around: its step is negative.
  F i = zero, j = zero, step = splat<F>(float(k_thesis_side));
  for (int level = 0; level < k_thesis_level; ++level) {
    // The midpoint of the edge AB is (A + B) / l_ab.
    const F l_ab = sqrt(two + two * cos_ab), l_bc = sqrt(two + two * cos_bc), l_ca = sqrt(two + two * cos_ca);
    // Cosines between the midpoints of two edges, (A + B) (C + A) / (l_ab l_ca), over a common denominator.
    const F sum = (one + cos_ab + (cos_bc + cos_ca)) / (l_ab * l_bc * l_ca);
    const F at_a = sum * l_bc, at_b = sum * l_ca, at_c = sum * l_ab;
    // p lies beyond the great circle through the midpoints next to A where A's weight exceeds those of B and C
    // together.
    const F over_a = a - (b + c), over_b = b - (c + a), over_c = c - (a + b);
    const Mask_t<F> in_a = over_a > zero, in_b = over_b > zero, in_c = over_c > zero;
    const Mask_t<F> middle = !(in_a | in_b | in_c);
    const F half_ab = half * l_ab, half_bc = half * l_bc, half_ca = half * l_ca;  // cosines of half edges
    // Children: (A, ab, ca), (ab, B, bc), (ca, bc, C) and the middle one (bc, ca, ab).
    const F next_a = select(in_a, over_a, select(in_b, a * l_ab, select(in_c, a * l_ca, -over_a * half_bc)));
    const F next_b = select(in_b, over_b, select(in_a, b * l_ab, select(in_c, b * l_bc, -over_b * half_ca)));
    const F next_c = select(in_c, over_c, select(in_a, c * l_ca, select(in_b, c * l_bc, -over_c * half_ab)));
    cos_ab = select(in_a | in_b, half_ab, at_c);
    cos_bc = select(in_b | in_c, half_bc, at_a);
    cos_ca = select(in_c | in_a, half_ca, at_b);
    a = next_a, b = next_b, c = next_c;
    step = step * half;
    i = i + select(in_a | middle, step, zero);
    j = j + select(in_b | middle, step, zero);
    step = select(middle, -step, step);
  }
  const F dot_a = a + b * cos_ab + c * cos_ca;
  const F dot_b = b + c * cos_bc + a * cos_ab;
  const F dot_c = c + a * cos_ca + b * cos_bc;
  const Mask_t<F> to_a = (dot_a >= dot_b) & (dot_a >= dot_c);
  const Mask_t<F> to_b = and_not(to_a, dot_b >= dot_c);
  i = i + select(to_a, step, zero);
  j = j + select(to_b, step, zero);
  return {copysign(i, p.x), copysign(j, p.y), p.z < zero};
}

// Index in [0, k_thesis_positions): the upper hemisphere first, each in rows of constant j.
template <class F>
FT_HD_INLINE Int_t<F> index_of_thesis_vertex(const ThesisVertex<F>& v) {
  // Row j has 2 (side - |j|) + 1 points. The rows before it hold a square number of points or, for j > 0, all but a
  // square.
  const F width = splat<F>(float(k_thesis_side)) - abs(v.j);
  const F next = width + splat<F>(1.0f);
  const F before = select(v.j > splat<F>(0.0f), splat<F>(float(k_thesis_hemisphere)) - next * next, width * width);
  const F first = select(v.lower, splat<F>(float(k_thesis_hemisphere)), splat<F>(0.0f));
  return small_to_int(first + before + (v.i + width));
}

// The inverse of index_of_thesis_vertex.
template <class F>
FT_HD_INLINE ThesisVertex<F> thesis_vertex_of_index(Int_t<F> index) {
  const F all = splat<F>(float(k_thesis_hemisphere)), last = splat<F>(float(k_thesis_hemisphere - 1));
  const F whole = to_float(index);
  const Mask_t<F> lower = whole >= all;
  const F place = select(lower, whole - all, whole);
  // Row t, up to j = 0, begins at t^2; the other rows are mirror images.
  const Mask_t<F> mirrored = place >= splat<F>(float((k_thesis_side + 1) * (k_thesis_side + 1)));
  const F k = select(mirrored, last - place, place);
  const F t = floor(sqrt(k));
  const F i = k - t * t - t, j = t - splat<F>(float(k_thesis_side));
  return {select(mirrored, -i, i), select(mirrored, -j, j), lower};
}

template <class F>
FT_HD_INLINE Vec3Lanes<F> select3(Mask_t<F> m, const Vec3Lanes<F>& a, const Vec3Lanes<F>& b) {
  return {select(m, a.x, b.x), select(m, a.y, b.y), select(m, a.z, b.z)};
}

// The unit vector of a point of the subdivision. z >= 0 above, z <= 0 below.
template <class F>
FT_HD_INLINE Vec3Lanes<F> thesis_point(const ThesisVertex<F>& v) {
  const F zero = splat<F>(0.0f), half = splat<F>(0.5f), one = splat<F>(1.0f);
  const auto middle_of = [&](const Vec3Lanes<F>& p, const Vec3Lanes<F>& q) {
    const Vec3Lanes<F> s = p + q;
    return s * (one / sqrt(dot(s, s)));
  };
  Vec3Lanes<F> at_a = {one, zero, zero}, at_b = {zero, one, zero}, at_c = {zero, zero, one};
  // Weights on the flat triangle, integers: the cuts divide it as they divide the sphere.
  F a = abs(v.i), b = abs(v.j), c = splat<F>(float(k_thesis_side)) - (a + b);
  for (int level = 0; level < k_thesis_level; ++level) {
    const Vec3Lanes<F> ab = middle_of(at_a, at_b), bc = middle_of(at_b, at_c), ca = middle_of(at_c, at_a);
    const F over_a = a - (b + c), over_b = b - (c + a), over_c = c - (a + b);
    const Mask_t<F> in_a = over_a > zero, in_b = over_b > zero, in_c = over_c > zero;
    at_a = select3(in_a, at_a, select3(in_b, ab, select3(in_c, ca, bc)));
    at_b = select3(in_b, at_b, select3(in_a, ab, select3(in_c, bc, ca)));
    at_c = select3(in_c, at_c, select3(in_a, ca, select3(in_b, bc, ab)));
    // Halving the triangle doubles the weights, which keeps them integers.
    const F two = one + one;
    const F next_a = select(in_a, over_a, select(in_b | in_c, a * two, -over_a));
    const F next_b = select(in_b, over_b, select(in_c | in_a, b * two, -over_b));
    const F next_c = select(in_c, over_c, select(in_a | in_b, c * two, -over_c));
    a = next_a, b = next_b, c = next_c;
  }
  // One corner now has all the weight.
  const Vec3Lanes<F> p = select3(a > half, at_a, select3(b > half, at_b, at_c));
  return {copysign(p.x, v.i), copysign(p.y, v.j), select(v.lower, -p.z, p.z)};
}

// ---------------------------------------------------------------- directions

// A right-handed frame whose third axis is the inward normal -p at the entry point p; for `lower`, in the mirror image
// of the hemisphere (T. Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 6(1), 2017). Continuous over each
// hemisphere with its rim.
template <class F>
FT_HD_INLINE Basis<F> thesis_frame(const Vec3Lanes<F>& p, Mask_t<F> lower) {
  const F one = splat<F>(1.0f);
  const F sign = select(lower, -one, one);
  const F a = -sign / (one + abs(p.z));
  const F b = p.x * p.y * a;
  return {{b, sign + p.y * p.y * a, -p.y}, {one + sign * p.x * p.x * a, sign * b, -sign * p.x}};
}

// Disk -> square [-1, 1]^2, the inverse of concentric_disk_centred (core/sampling/warp.hd.h).
template <class F>
FT_HD_INLINE void square_from_disk(F x, F y, F& u, F& v) {
  const F ax = abs(x), ay = abs(y);
  const F r = sqrt(ax * ax + ay * ay);
  const F q = min(ax, ay) / max(max(ax, ay), splat<F>(Tiny::k_smallest_normal));
  const F along = r * (splat<F>(2.0f) * atan_over_half_pi(q));
  const Mask_t<F> steep = ay > ax;
  u = copysign(select(steep, along, r), x);
  v = copysign(select(steep, r, along), y);
}

// ---------------------------------------------------------------- rays

// Where a line enters the unit ball.
template <class F>
struct ThesisEntry {
  Vec3Lanes<F> point;
  F along;  // signed distance of the point from the ray's origin; negative if that is inside or beyond
  Mask_t<F> crosses;
};

// `direction` is unit.
template <class F>
FT_HD_INLINE ThesisEntry<F> enter_ball(const Vec3Lanes<F>& origin, const Vec3Lanes<F>& direction) {
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f);
  const LineFoot<F> foot = foot_of_line(origin, direction);
  const F squared = dot(foot.point, foot.point);
  const F half_chord = sqrt(max(zero, one - squared));
  return {foot.point - direction * half_chord, foot.along - half_chord, squared < one};
}

// A sample: position and direction cell.
template <class F>
struct ThesisAddress {
  Int_t<F> position, u, v;
};

// The sample of the ray that enters at the unit vector `point` along the unit `direction`.
template <class F>
FT_HD_INLINE ThesisAddress<F> address_of_entry(const Vec3Lanes<F>& point, const Vec3Lanes<F>& direction,
                                               const ChartAxis& directions) {
  const ThesisVertex<F> vertex = nearest_thesis_vertex(point);
  const Basis<F> frame = thesis_frame(point, vertex.lower);
  F u, v;
  square_from_disk(dot(direction, frame.x), dot(direction, frame.y), u, v);
  return {index_of_thesis_vertex(vertex), cell_of(u, directions), cell_of(v, directions)};
}

// The ray of a sample: where it enters and along which direction.
template <class F>
struct ThesisRay {
  Vec3Lanes<F> point, direction;
};

// All rays of a position share its point and frame, all rays of a direction cell their direction in that frame.
template <class F>
struct ThesisPosition {
  Vec3Lanes<F> point;
  Basis<F> frame;
};

template <class F>
FT_HD_INLINE ThesisPosition<F> thesis_position(Int_t<F> index) {
  const ThesisVertex<F> vertex = thesis_vertex_of_index<F>(index);
  const Vec3Lanes<F> p = thesis_point(vertex);
  return {p, thesis_frame(p, vertex.lower)};
}

// The direction of a cell in the frame of any position: z points inwards.
template <class F>
FT_HD_INLINE Vec3Lanes<F> thesis_inward(Int_t<F> u, Int_t<F> v, const ChartAxis& directions) {
  return cosine_hemisphere_centred(centre_of<F>(u, directions), centre_of<F>(v, directions));
}

template <class F>
FT_HD_INLINE ThesisRay<F> thesis_ray(const ThesisPosition<F>& at, const Vec3Lanes<F>& inward) {
  return {at.point, at.frame.x * inward.x + at.frame.y * inward.y - at.point * inward.z};
}

template <class F>
FT_HD_INLINE ThesisRay<F> ray_of_address(const ThesisAddress<F>& at, const ChartAxis& directions) {
  return thesis_ray(thesis_position<F>(at.position), thesis_inward<F>(at.u, at.v, directions));
}

FT_LANES_END

#endif  // toggled guard
