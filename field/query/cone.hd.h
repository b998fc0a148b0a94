// Whole lights answered at once: is all of a ball clear of one object, as seen from a point, or wholly hidden by it?
//
// Two look-ups, both for the bundle of rays from the shading point to the ball (the cone), never for single rays:
// - through_lines: where the object lies between shading point and light, a segment is blocked exactly if its whole
//   line is. Within the object's ball, all rays of the cone lie inside a tube about the cone's axis. Seen along the
//   direction c of the axis' direction cell, the tube is a disc, whose radius accounts for the cone's width and for the
//   angle between axis and c. If no parallel line in the disc's square meets the object, the light is clear; if every
//   one does, it is hidden.
// - from_plane_fit: for shading points on the object itself. The depth cells at the shading point, for a grid of
//   directions over the ball about as fine as the direction cells, must all find nothing in front of the point (clear),
//   or all find something there (hidden).
// Everything else stays open and is left to single rays. A cone's answer holds for the object between its sampled lines
// only as far as these resolve it (docs/decisions/009-cones.md).
//
// Space: unit space of the object (field/chart/chart.hd.h). Thread-safety: pure functions over a FieldView.

#if defined(FIELDTRACE_FIELD_QUERY_CONE_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_FIELD_QUERY_CONE_HD_H_
#undef FIELDTRACE_FIELD_QUERY_CONE_HD_H_
#else
#define FIELDTRACE_FIELD_QUERY_CONE_HD_H_
#endif

#include "core/sampling/warp.hd.h"
#include "core/simd/lanes.hd.h"
#include "field/chart/chart.hd.h"
#include "field/query/query.hd.h"
#include "field/store/coverage.hd.h"

FT_LANES_BEGIN

// The bundle of rays from a ball of radius `near` about p to another ball: unit axis, distance between the centres, and
// tangent of the half angle that the far ball subtends from p.
template <class F>
struct LightCone {
  Vec3Lanes<F> p, axis;
  F distance, sine, tangent;
  F near;
  Mask_t<F> narrow;  // sine < k_widest_cone_sine

  // Bound on the rays' distances from the axis at a distance t from p: linear in t, so largest at the end of a span.
  FT_HD_INLINE F half_width(F t) const { return t * tangent + near * (splat<F>(1.0f) - t / distance); }
};

// Wider cones stay open.
constexpr float k_widest_cone_sine = 0.6f;

// `to_centre`: from p to the far ball's centre; `radius`: of that ball.
template <class F>
FT_HD_INLINE LightCone<F> make_cone(const Vec3Lanes<F>& p, const Vec3Lanes<F>& to_centre, F radius, F near) {
  const F one = splat<F>(1.0f);
  LightCone<F> cone;
  cone.p = p;
  cone.near = near;
  cone.distance = max(sqrt(dot(to_centre, to_centre)), splat<F>(1e-30f));
  cone.axis = to_centre * (one / cone.distance);
  cone.sine = min(radius / cone.distance, one);
  cone.narrow = cone.sine < splat<F>(k_widest_cone_sine);
  cone.tangent = cone.sine / sqrt(max(one - cone.sine * cone.sine, splat<F>(0.25f)));
  return cone;
}

// Limit on light leaks, in texels: rays that diverge by more than this over the range of depths in their disc may pass
// between surfaces that hide each other from parallel lines (through a hole in front and one behind, not in line).
constexpr float k_most_light_leak = 0.5f;

template <class F>
struct ConeAnswer {
  Mask_t<F> clear, blocked, unknown;  // none of them: open
  Int_t<F> lookups;
};

// The part of a half chord in which surfaces are expected. Those near its ends lie at the ball's rim and are rare:
// widening the disc for the middle half of the chord alone, as at the default tolerance, leaves a quarter fewer lights
// open, and makes fewer than 1 more answer in 10,000 wrong (docs/decisions/009-cones.md).
FT_HD constexpr float chord_share(const QueryPolicy& policy) { return 1.0f / (1.0f + policy.slack); }

// Whether the light's end of the cone lies beyond the object's ball. Whole lines then answer for its segments if the
// object lies in front of the shading point.
template <class F>
FT_HD_INLINE Mask_t<F> light_beyond_ball(const LightCone<F>& cone) {
  const F one = splat<F>(1.0f);
  const F t_foot = splat<F>(0.0f) - dot(cone.p, cone.axis);
  return cone.narrow & (cone.distance * (one - cone.sine) > t_foot + one + cone.near);
}

// The part of the cone's axis in front of the shading point and within the ball: the distance from the shading point to
// its middle, and half its length, which is that of the longest chord of the ball that a ray of the cone can have.
// offset: distance from the shading point to p, if p is another point of the axis.
template <class F>
struct ConeSpan {
  F middle, half;
};

template <class F>
FT_HD_INLINE ConeSpan<F> span_in_ball(const LightCone<F>& cone, F offset) {
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f), half = splat<F>(0.5f);
  const F from_p = zero - dot(cone.p, cone.axis), t_foot = offset + from_p;
  const Vec3Lanes<F> foot = cone.p + cone.axis * from_p;
  const F nearest = max(sqrt(dot(foot, foot)) - max(t_foot + one, zero) * cone.tangent - cone.near, zero);
  const F half_chord = sqrt(max(one - nearest * nearest, zero));
  const F begin = max(t_foot - half_chord, zero), end = max(t_foot + half_chord, zero);
  return {(begin + end) * half, (end - begin) * half};
}

// The parallel lines of the direction cell that holds a direction: a coverage map of L x L texels.
template <class F>
struct CoverageMap {
  Int_t<F> direction;  // the cell's number
  DirectionFrame<F> frame;
  F half_lines;  // L / 2

  // A point's coordinate in the coverage map, along s or t, in texels.
  FT_HD_INLINE F texels(const Vec3Lanes<F>& point, const Vec3Lanes<F>& along) const {
    return (dot(point, along) + splat<F>(1.0f)) * half_lines;
  }
};

template <class F>
FT_HD_INLINE CoverageMap<F> map_along(const FieldView& field, const Vec3Lanes<F>& direction) {
  CellAddress<F> cell;
  find_direction_cell(direction, field.directions, cell);
  return {cell.u * splat_int<F>(int32_t(field.directions.cells)) + cell.v,
          frame_from_square(centre_of<F>(cell.u, field.directions), centre_of<F>(cell.v, field.directions)),
          splat<F>(field.coverage.half_lines)};
}

// The whole texels of a rectangle about a point, clipped to the coverage map. whole: nothing was clipped. Outside the
// map lines meet nothing.
template <class F>
struct MapSquare {
  TexelRect<F> rect;
  Mask_t<F> whole;
};

template <class F>
FT_HD_INLINE MapSquare<F> rectangle_about(const CoverageMap<F>& map, const Vec3Lanes<F>& point, F half_x, F half_y) {
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f), lines = map.half_lines + map.half_lines;
  const F x = map.texels(point, map.frame.s), y = map.texels(point, map.frame.t);
  const F rx = half_x * map.half_lines, ry = half_y * map.half_lines;
  const F x0 = floor(x - rx), x1 = floor(x + rx) + one, y0 = floor(y - ry), y1 = floor(y + ry) + one;
  const auto texel = [&](F value) { return small_to_int(min(max(zero, value), lines)); };
  const Mask_t<F> whole = (x0 >= zero) & (x1 <= lines) & (y0 >= zero) & (y1 <= lines);
  return {{texel(x0), texel(x1), texel(y0), texel(y1)}, whole};
}

// How much the mean depths of a rectangle's halves differ, in x or in y, whichever is more; 0 where a half meets
// nothing. `all`: sums over the whole rectangle, whose tiles are baked.
template <class F>
FT_HD_INLINE F depth_difference(const CoverageView& view, Int_t<F> direction, const TexelRect<F>& rect,
                                const CoverageSum<F>& all, Mask_t<F> wanted) {
  const auto none = [](Int_t<F>, Mask_t<F>) {};
  const auto difference = [&](const TexelRect<F>& half) {
    const CoverageSum<F> sum = sum_coverage<F>(view, direction, half, wanted, none);
    const Int_t<F> rest = all.count - sum.count, zero = splat_int<F>(0);
    const F n = max(to_float(sum.count), splat<F>(1.0f)), m = max(to_float(rest), splat<F>(1.0f));
    const F apart = abs(to_float(sum.depths) / n - to_float(all.depths - sum.depths) / m);
    return select((sum.count > zero) & (rest > zero), apart, splat<F>(0.0f));
  };
  const Int_t<F> x = rect.x0 + shift_right<1>(rect.x1 - rect.x0), y = rect.y0 + shift_right<1>(rect.y1 - rect.y0);
  const F across = difference({rect.x0, x, rect.y0, rect.y1}), along = difference({rect.x0, rect.x1, rect.y0, y});
  return max(across, along) * splat<F>(k_coverage_depth_step);
}

// For shading points outside the ball, or `within` it with the whole object in front of their tangent plane.
// within: surfaces are expected in all of the span. tell_missing(slots, mask): as for sum_coverage.
template <class F, class TellMissing>
FT_HD_INLINE ConeAnswer<F> through_lines(const FieldView& field, const QueryPolicy& policy, const LightCone<F>& cone,
                                         Mask_t<F> within, Mask_t<F> wanted, const TellMissing& tell_missing) {
  const CoverageMap<F> map = map_along(field, cone.axis);
  const ConeSpan<F> span = span_in_ball(cone, splat<F>(0.0f));
  const Vec3Lanes<F> middle = cone.p + cone.axis * span.middle;
  const F reach = select(within, span.half, span.half * splat<F>(chord_share(policy)));
  const Vec3Lanes<F> across = cone.axis - map.frame.c * dot(cone.axis, map.frame.c);
  const F widest = max(cone.half_width(span.middle - reach), cone.half_width(span.middle + reach));
  const F radius = widest + reach * sqrt(dot(across, across));
  const MapSquare<F> square = rectangle_about(map, middle, radius, radius);
  const TexelRect<F>& rect = square.rect;
  const CoverageSum<F> sum = sum_coverage<F>(field.coverage, map.direction, rect, wanted, tell_missing);
  const Int_t<F> texels = (rect.x1 - rect.x0) * (rect.y1 - rect.y0);
  ConeAnswer<F> answer;
  answer.unknown = sum.unknown;
  answer.clear = and_not(sum.unknown, wanted & (sum.count == splat_int<F>(0)));
  answer.blocked = and_not(sum.unknown | answer.clear, wanted & square.whole & (sum.count == texels));
  answer.lookups = select(wanted, splat_int<F>(1), splat_int<F>(0));
  if (any(answer.blocked)) {
    const F slant = cone.tangent + cone.near / cone.distance + sqrt(dot(across, across));
    const F rise = depth_difference<F>(field.coverage, map.direction, rect, sum, answer.blocked);
    answer.blocked = answer.blocked & (rise * slant * map.half_lines < splat<F>(k_most_light_leak * policy.slack));
  }
  return answer;
}

// tell_missing(slices, mask) is called with the depth slices that are not baked. Directions are tried on a grid of side
// x side over the cone, without its corners.
template <class F, class TellMissing>
FT_HD_INLINE ConeAnswer<F> from_plane_fit(const FieldView& field, const QueryPolicy& policy, const LightCone<F>& cone,
                                          int side, Mask_t<F> wanted, const TellMissing& tell_missing) {
  const F one = splat<F>(1.0f);
  const Basis<F> across = make_basis<F>(cone.axis);
  ConeAnswer<F> answer;
  answer.clear = answer.blocked = wanted;
  answer.unknown = and_not(wanted, wanted);
  answer.lookups = splat_int<F>(0);
  const float step = 2.0f / float(side);
  for (int i = 0; i < side * side; ++i) {
    const float x = (float(i % side) + 0.5f) * step - 1.0f, y = (float(i / side) + 0.5f) * step - 1.0f;
    if (side > 1 && x * x + y * y > 1.0f + step * 0.25f) continue;
    // A lane stops at the first cell that is not baked. If it went on, cells that this one makes needless would be
    // demanded or not depending on what other threads have baked, and memory use with them.
    const Mask_t<F> queried = and_not(answer.unknown, answer.clear | answer.blocked);
    if (!any(queried)) break;
    Vec3Lanes<F> d = cone.axis + across.x * (cone.tangent * splat<F>(x)) + across.y * (cone.tangent * splat<F>(y));
    d = d * (one / sqrt(dot(d, d)));
    const Vec3Lanes<F> back = {-d.x, -d.y, -d.z};
    const Vec3Lanes<F> end = cone.p + d * cone.distance;
    const DepthAnswer<F> depth = compare_depth(
        field, policy, address_of_line(back, cone.p, field.directions, field.plane), back, cone.p, end, queried);
    answer.lookups = answer.lookups + depth.lookups;
    if (any(depth.unknown)) {
      answer.unknown = answer.unknown | depth.unknown;
      tell_missing(depth.slice, depth.unknown);
    }
    answer.clear = answer.clear & (depth.front | answer.unknown);
    answer.blocked = answer.blocked & (depth.behind | answer.unknown);
  }
  answer.clear = and_not(answer.unknown, answer.clear);
  answer.blocked = and_not(answer.unknown, answer.blocked);
  return answer;
}

FT_LANES_END

#endif  // toggled guard
