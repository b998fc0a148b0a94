// The orthographic chart: lines through the unit ball <-> cells addressed by four integers.
//
// A direction lies on an equal-area octahedral map of D x D cells (Clarberg, "Fast Equal-Area Mapping of the
// (Hemi)Sphere using SIMD", JGT 2008). A line's offset lies in the plane through the centre perpendicular to the
// *cell's* direction, N x N cells over [-1, 1]^2. The plane's frame is a pure function of the direction cell.
//
// Space: "unit space", object space moved and scaled so that the bounding sphere is the unit ball about the origin.
// Exactness: only + - x / sqrt min max floor in the written order, so that every machine finds the same cell.
// Thread-safety: pure functions. Errors: none; directions must be unit and finite (unchecked).

#if defined(FIELDTRACE_FIELD_CHART_CHART_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_FIELD_CHART_CHART_HD_H_
#undef FIELDTRACE_FIELD_CHART_CHART_HD_H_
#else
#define FIELDTRACE_FIELD_CHART_CHART_HD_H_
#endif

#include "core/platform/platform.h"
#include "core/simd/lanes.hd.h"
#include "field/chart/axis.h"

FT_LANES_BEGIN

// atan(a) * 2 / pi for a in [0, 1]: an odd polynomial of degree 15, least maximal error over the interval (2.4e-8; with
// float rounding 1e-7, below 1e-4 of the narrowest direction cell).
template <class F>
FT_HD_INLINE F atan_over_half_pi(F a) {
  const F a2 = a * a;
  F p = splat<F>(-0.0025811475f);
  p = p * a2 + splat<F>(0.013918133f);
  p = p * a2 + splat<F>(-0.035594516f);
  p = p * a2 + splat<F>(0.06138385f);
  p = p * a2 + splat<F>(-0.08854497f);
  p = p * a2 + splat<F>(0.12698376f);
  p = p * a2 + splat<F>(-0.21218449f);
  p = p * a2 + splat<F>(0.6366193f);
  return p * a;
}

// Unit direction -> square [-1, 1]^2. The upper hemisphere (z >= 0) fills the diamond |u| + |v| <= 1.
template <class F>
FT_HD_INLINE void square_from_direction(const Vec3Lanes<F>& d, F& u, F& v) {
  const F ax = abs(d.x), ay = abs(d.y), az = abs(d.z);
  // sqrt(1 - |z|), in a form that does not cancel near the poles.
  const F r = sqrt((ax * ax + ay * ay) / (splat<F>(1.0f) + az));
  const F big = max(ax, ay), small = min(ax, ay);
  // 0/0 at a pole becomes 0: r is 0 there, so the angle does not matter.
  const F a = small / max(big, splat<F>(1e-30f));
  const F half = atan_over_half_pi(a);  // in [0, 1/2]
  const F phi = select(ay > ax, splat<F>(1.0f) - half, half);
  const F inner_v = phi * r;
  const F inner_u = r - inner_v;
  const auto lower = d.z < splat<F>(0.0f);
  u = copysign(select(lower, splat<F>(1.0f) - inner_v, inner_u), d.x);
  v = copysign(select(lower, splat<F>(1.0f) - inner_u, inner_v), d.y);
}

// A direction with the frame of the plane perpendicular to it: c, and tangents s and t.
template <class F>
struct DirectionFrame {
  Vec3Lanes<F> c, s, t;
};

// Frames are turned about c by the angle whose tangent is 1 / golden ratio: upright edges, which many objects have,
// then meet the rows and columns of a plane's cells at a slope far from that of every line through few cells, and so
// do edges that are diagonal to them (docs/decisions/042-turned-frames.md).
constexpr float k_turn_cosine = 0.85065081f, k_turn_sine = 0.52573111f;

// Square -> direction and frame. At the square's centre and corners (the poles, where the frame is not unique) it is
// one of those beside them. Frames of opposite directions have the same s, and opposite t and c.
template <class F>
FT_HD_INLINE DirectionFrame<F> frame_from_square(F u, F v) {
  const F one = splat<F>(1.0f);
  const F au = abs(u), av = abs(v);
  const F signed_distance = one - (au + av);
  const F r = one - abs(signed_distance);
  // Angle within the quadrant, phi = pi/4 (1 + q) with q in [-1, 1]; cos and sin by their Taylor series about pi/4,
  // truncation below 4e-7 at |q| = 1.
  // r is a multiple of 2^-24. Where it is 0, u and v or their distances to a corner are less than that.
  const F q = (av - au) / max(r, splat<F>(0x1p-24f));
  const F y = q * splat<F>(0.78539816f);
  const F y2 = y * y;
  F sin_y = splat<F>(-1.0f / 5040.0f);
  sin_y = sin_y * y2 + splat<F>(1.0f / 120.0f);
  sin_y = sin_y * y2 + splat<F>(-1.0f / 6.0f);
  sin_y = sin_y * y2 * y + y;
  F cos_y = splat<F>(1.0f / 40320.0f);
  cos_y = cos_y * y2 + splat<F>(-1.0f / 720.0f);
  cos_y = cos_y * y2 + splat<F>(1.0f / 24.0f);
  cos_y = cos_y * y2 + splat<F>(-0.5f);
  cos_y = cos_y * y2 + one;
  const F cos_phi = copysign((cos_y - sin_y) * splat<F>(0.70710678f), u);
  const F sin_phi = copysign((cos_y + sin_y) * splat<F>(0.70710678f), v);
  const F cos_theta = copysign(one - r * r, signed_distance);
  const F sin_theta = r * sqrt(splat<F>(2.0f) - r * r);
  const Vec3Lanes<F> south = {cos_theta * cos_phi, cos_theta * sin_phi, -sin_theta};
  const Vec3Lanes<F> east = {-sin_phi, cos_phi, splat<F>(0.0f)};
  // Opposite directions turn the other way; of those on the equator, but for rounding, one has a negative u.
  const auto off_equator = r < splat<F>(1.0f - 0x1p-20f);
  const F turn = copysign(splat<F>(k_turn_sine), select(off_equator, signed_distance, u));
  const F keep = splat<F>(k_turn_cosine);
  DirectionFrame<F> f;
  f.c = {sin_theta * cos_phi, sin_theta * sin_phi, cos_theta};
  f.s = south * keep + east * turn;
  f.t = east * keep - south * turn;
  return f;
}

// Index of the cell that x in [-1, 1] lies in; values outside go to the nearest cell, NaN to cell 0.
template <class F>
FT_HD_INLINE Int_t<F> cell_of(F x, const ChartAxis& axis) {
  const F scaled = floor((x + splat<F>(1.0f)) * splat<F>(axis.half));
  // In this order min and max turn NaN into cell 0: inactive lanes look up whatever their segment holds.
  return small_to_int(min(max(splat<F>(0.0f), scaled), splat<F>(axis.last)));
}

// Centre of cell i, in [-1, 1].
template <class F>
FT_HD_INLINE F centre_of(Int_t<F> i, const ChartAxis& axis) {
  return to_float(i) * splat<F>(axis.step) + splat<F>(axis.start);
}

// The foot of the perpendicular from the centre to a line.
template <class F>
struct LineFoot {
  Vec3Lanes<F> point;
  F along;  // signed distance of the point from the line's origin
};

// `direction` is unit. The second step removes the cancellation error that the first leaves where the origin is far
// away (Haines et al., Ray Tracing Gems, 2019, chapter 7).
template <class F>
FT_HD_INLINE LineFoot<F> foot_of_line(const Vec3Lanes<F>& origin, const Vec3Lanes<F>& direction) {
  const F along = splat<F>(0.0f) - dot(origin, direction);
  const Vec3Lanes<F> first = origin + direction * along;
  const F correction = dot(first, direction);
  return {first - direction * correction, along - correction};
}

// The cell of a line: direction cell (u, v) and plane cell (a, b), with the frame of the direction cell.
template <class F>
struct CellAddress {
  Int_t<F> u, v, a, b;
  DirectionFrame<F> frame;
};

// Addressing a line in two steps, for loops that run each step over many lines: first the direction cell, then its
// frame and the plane cell of `anchor`.
template <class F>
FT_HD_INLINE void find_direction_cell(const Vec3Lanes<F>& d, const ChartAxis& directions, CellAddress<F>& cell) {
  F u, v;
  square_from_direction(d, u, v);
  cell.u = cell_of(u, directions);
  cell.v = cell_of(v, directions);
}

template <class F>
FT_HD_INLINE void find_plane_cell(const Vec3Lanes<F>& anchor, const ChartAxis& directions, const ChartAxis& plane,
                                  CellAddress<F>& cell) {
  cell.frame = frame_from_square(centre_of<F>(cell.u, directions), centre_of<F>(cell.v, directions));
  cell.a = cell_of(dot(anchor, cell.frame.s), plane);
  cell.b = cell_of(dot(anchor, cell.frame.t), plane);
}

// The cell of the line through `anchor` along the unit direction d.
template <class F>
FT_HD_INLINE CellAddress<F> address_of_line(const Vec3Lanes<F>& d, const Vec3Lanes<F>& anchor,
                                            const ChartAxis& directions, const ChartAxis& plane) {
  CellAddress<F> cell;
  find_direction_cell(d, directions, cell);
  find_plane_cell(anchor, directions, plane, cell);
  return cell;
}

FT_LANES_END

#endif  // toggled guard
