// Field queries: the nearest surface of one object along a ray. Written once for a float, a SIMD vector and a GPU
// thread.
//
// Space: unit space of the object (field/chart/chart.hd.h). From outside the ball, the visibility cell of the whole
// line is read first: its certified miss is a miss. Else the depth cell of the line's direction is read, anchored at
// the foot of the perpendicular, and once more at the depth found. From inside, the cell of the reverse direction,
// anchored at the origin, tells whether the last surface along the ray lies behind the origin (a miss). Else the cell
// of the ray's own direction gives the hit if its surface lies ahead by more than the error bound; surfaces in between
// cannot be told from these two cells (undecided). The distance is that to the fitted plane, and its error at most the
// cell's bound e / |cos|. Thread-safety: pure functions over a FieldView.

#if defined(FIELDTRACE_FIELD_QUERY_NEAREST_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_FIELD_QUERY_NEAREST_HD_H_
#undef FIELDTRACE_FIELD_QUERY_NEAREST_HD_H_
#else
#define FIELDTRACE_FIELD_QUERY_NEAREST_HD_H_
#endif

#include "core/simd/lanes.hd.h"
#include "field/query/query.hd.h"

FT_LANES_BEGIN

constexpr int k_none_found = k_no_primitive - k_first_primitive;
constexpr int k_not_baked = -k_first_primitive;

template <class F>
struct NearestAnswer {
  // k_verdict_clear: a miss; k_verdict_blocked: a hit; k_verdict_none, _undecided, _unknown_*: as for segments.
  Int_t<F> verdict;
  F distance;  // of the hit from the segment's origin, unit space
  F error;     // bound on its error, unit space
  F bend;      // the plane fit's error bound in half widths of its cell: how far the surface's normals may differ
  Vec3Lanes<F> normal;  // of the plane fit, unit, unit space, on the side that the ray comes from
  // Of a hit: the triangle met by the line through the cell's centre; k_none_found: that line meets none; k_not_baked:
  // the primitive layer's slice must be baked first.
  Int_t<F> primitive;
  Int_t<F> slice;    // of a hit: its cell's; where the verdict is unknown_*: the one to bake
  Int_t<F> lookups;  // cells read
};

// `self`: the ray leaves this object's surface, so its line is known to meet the object.
template <class F>
FT_HD inline NearestAnswer<F> nearest_on_segment(const FieldView& field, const QueryPolicy& policy,
                                                 const UnitSegment<F>& segment, Mask_t<F> self) {
  const F zero = splat<F>(0.0f);
  const Int_t<F> i_zero = splat_int<F>(0), i_one = splat_int<F>(1);
  NearestAnswer<F> result;
  result.verdict = select(segment.crosses, splat_int<F>(k_verdict_undecided), splat_int<F>(k_verdict_none));
  result.distance = result.error = result.bend = zero;
  result.normal = {zero, zero, zero};
  result.primitive = result.slice = result.lookups = i_zero;

  const Mask_t<F> inside = segment.origin_inside;
  Mask_t<F> open = segment.crosses;  // still without an answer
  const auto conclude = [&](Mask_t<F> which, int verdict) {
    result.verdict = select(which, splat_int<F>(verdict), result.verdict);
    open = and_not(which, open);
  };

  const Mask_t<F> line_wanted = and_not(self & inside, segment.crosses);
  if (any(line_wanted)) {
    const LineView<F> line = look_up_line(field, policy, segment);
    result.lookups = select(line_wanted, i_one, i_zero);
    result.slice = line.slice;
    conclude(line_wanted & line.unknown, k_verdict_unknown_visibility);
    conclude(line_wanted & line.miss, k_verdict_clear);
  }

  const Mask_t<F> from_inside = open & inside;
  if (any(from_inside)) {
    const Vec3Lanes<F> reverse = {-segment.direction.x, -segment.direction.y, -segment.direction.z};
    const FoundPlaneFit<F> last =
        find_plane_fit(field, policy, address_of_line(reverse, segment.origin, field.directions, field.plane), reverse,
                       segment.origin, from_inside);
    result.lookups = result.lookups + last.lookups;
    result.slice = select(last.unknown, last.slice, result.slice);
    conclude(from_inside & last.unknown, k_verdict_unknown_depth);
    const Mask_t<F> behind = last.decided & (last.view.distance >= zero - last.view.error * splat<F>(k_front_share));
    conclude(from_inside & and_not(last.unknown, behind | last.miss), k_verdict_clear);
  }

  if (any(open)) {
    const Vec3Lanes<F> anchor = {select(inside, segment.origin.x, segment.foot.x),
                                 select(inside, segment.origin.y, segment.foot.y),
                                 select(inside, segment.origin.z, segment.foot.z)};
    const FoundPlaneFit<F> first =
        find_plane_fit(field, policy, address_of_line(segment.direction, anchor, field.directions, field.plane),
                       segment.direction, anchor, open);
    result.lookups = result.lookups + first.lookups;
    result.slice = select(first.unknown, first.slice, result.slice);
    conclude(open & first.unknown, k_verdict_unknown_depth);
    conclude(open & first.miss, k_verdict_clear);
    const F facing = zero - dot(first.view.normal, segment.direction);
    const F cosine = max(facing, splat<F>(0x1p-20f));
    const F error = first.view.error / cosine;
    const F distance = dot(anchor - segment.origin, segment.direction) - first.back;
    // A plane fit within its error bound of the origin may lie on either side of it.
    Mask_t<F> ahead =
        open & first.decided & first.view.solid & (and_not(inside, open) | (first.view.distance > first.view.error));
    ahead = ahead & (facing > splat<F>(0x1p-20f));  // a plane parallel to the ray gives no distance
    if (policy.answer_all) ahead = open & first.decided & (distance >= zero);
    const F slack = policy.answer_all ? zero : error;
    const Mask_t<F> hit = ahead & (distance + slack <= segment.length);
    result.distance = select(hit, distance, result.distance);
    result.error = select(hit, error, result.error);
    result.bend = select(hit, first.view.error / half_cell_of<F>(field), result.bend);
    result.normal = {select(hit, first.view.normal.x, zero), select(hit, first.view.normal.y, zero),
                     select(hit, first.view.normal.z, zero)};
    const Int_t<F> primitive = gather(field.primitive, select(hit, first.view.primitive_cell, i_zero));
    result.primitive = select(hit, primitive - splat_int<F>(k_first_primitive), i_zero);
    result.slice = select(hit, first.view.slice, result.slice);
    conclude(hit, k_verdict_blocked);
    conclude(ahead & (distance > segment.length + slack), k_verdict_clear);
    // Every query is answered: where no cell sees a surface ahead, there is none.
    if (policy.answer_all) conclude(open, k_verdict_clear);
  }
  return result;
}

FT_LANES_END

#endif  // toggled guard
