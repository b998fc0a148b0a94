// Field queries: is the segment between two points free of one object? Written once for a float, a SIMD vector and a
// CUDA thread.
//
// Space: unit space of the object (field/chart.hd.h). The query first reads the *visibility* cell of the whole line:
// its certificate speaks of all lines whose foot of the perpendicular lies in that cell, which is exactly how the query
// addresses it. A line that misses the object is clear whatever the segment's ends. A line that hits is blocked if both
// ends lie outside the ball. With an end inside, the *depth* cell anchored at that end says how far the first surface
// lies that is seen from outside along the line; the end is in front of it (clear), behind it by more than the margin
// (blocked), or too near to tell (ask). Where that surface lies far from the anchor the query re-anchors once, at the
// depth found, because a depth cell's lines fan out from its own hit.
// Thread-safety: pure functions over a FieldView.

#if defined(FIELDTRACE_FIELD_QUERY_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_FIELD_QUERY_HD_H_
#undef FIELDTRACE_FIELD_QUERY_HD_H_
#else
#define FIELDTRACE_FIELD_QUERY_HD_H_
#endif

#include "core/lanes.hd.h"
#include "field/chart.hd.h"
#include "field/layout.hd.h"

FT_LANES_BEGIN

// Verdicts. `none`: the segment does not meet the ball; no look-up was made. `unknown_*`: a slice is not baked yet.
constexpr int k_verdict_none = 0;
constexpr int k_verdict_clear = 1;
constexpr int k_verdict_blocked = 2;
constexpr int k_verdict_ask = 3;
constexpr int k_verdict_unknown_visibility = 4;
constexpr int k_verdict_unknown_depth = 5;

template <class F>
struct SegmentVerdict {
  Int_t<F> verdict;
  Int_t<F> slice;    // the slice to bake where the verdict is unknown_*
  Int_t<F> lookups;  // cells read
};

// A straight segment in unit space: origin, unit direction, length (may be infinite), with what the ball makes of it.
template <class F>
struct UnitSegment {
  Vec3Lanes<F> origin, direction, foot, end;
  F length;
  Mask_t<F> crosses, origin_inside, end_inside;
};

// Moves a world-space ray into unit space. to_unit: 3 x 4, column-major. An inactive ray (tmax < 0) crosses nothing.
template <class F>
FT_HD inline UnitSegment<F> segment_in_unit_space(const float* to_unit, const Vec3Lanes<F>& o, const Vec3Lanes<F>& d,
                                                  F tmax) {
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f);
  UnitSegment<F> s;
  const F m0 = splat<F>(to_unit[0]), m1 = splat<F>(to_unit[1]), m2 = splat<F>(to_unit[2]);
  const F m3 = splat<F>(to_unit[3]), m4 = splat<F>(to_unit[4]), m5 = splat<F>(to_unit[5]);
  const F m6 = splat<F>(to_unit[6]), m7 = splat<F>(to_unit[7]), m8 = splat<F>(to_unit[8]);
  s.origin = {m0 * o.x + m3 * o.y + m6 * o.z + splat<F>(to_unit[9]),
              m1 * o.x + m4 * o.y + m7 * o.z + splat<F>(to_unit[10]),
              m2 * o.x + m5 * o.y + m8 * o.z + splat<F>(to_unit[11])};
  const Vec3Lanes<F> q = {m0 * d.x + m3 * d.y + m6 * d.z, m1 * d.x + m4 * d.y + m7 * d.z,
                          m2 * d.x + m5 * d.y + m8 * d.z};
  const F scale = sqrt(dot(q, q));
  s.direction = q * (one / scale);
  s.length = tmax * scale;
  // Foot of the perpendicular from the centre; the second step removes what the first lost to cancellation when the
  // origin is far away (Haines et al., Ray Tracing Gems, 2019, chapter 7).
  const F along = zero - dot(s.origin, s.direction);
  Vec3Lanes<F> foot = s.origin + s.direction * along;
  const F correction = dot(foot, s.direction);
  s.foot = foot - s.direction * correction;
  const F t_foot = along - correction;
  const F half_squared = one - dot(s.foot, s.foot);
  const F half = sqrt(max(half_squared, zero));
  s.crosses = (half_squared > zero) & (s.length > t_foot - half) & (t_foot + half > zero) & (tmax >= zero);
  s.origin_inside = s.crosses & (t_foot - half < zero);
  s.end_inside = s.crosses & (s.length < t_foot + half);
  // The end from the foot, not from a far origin.
  s.end = s.foot + s.direction * (s.length - t_foot);
  return s;
}

// What a depth cell says about a point p: the sheet's signed distance (positive: p is on the side that is seen from
// outside along the cell's direction), the error bound, and whether the cell may answer.
template <class F>
struct SheetView {
  Vec3Lanes<F> normal;
  F distance;  // of p
  F offset;    // plane: dot(normal, x) = offset
  F error;
  Mask_t<F> known, sheet;
  Int_t<F> slice;
};

template <class F>
FT_HD inline SheetView<F> look_up_sheet(const FieldView& field, const QueryPolicy& policy,
                                        const Vec3Lanes<F>& direction, const Vec3Lanes<F>& p) {
  const CellAddress<F> at = address_of_line(direction, p, field.directions, field.plane);
  const CellSlot<F> slot = slot_of<F>(field, at);
  const Int_t<F> word = gather(field.depth, slot.cell);
  const Int_t<F> certificate = gather(field.certificate, slot.cell);
  SheetView<F> view;
  view.slice = slot.slice;
  view.known = !(certificate == splat_int<F>(0));
  view.sheet = ((certificate & splat_int<F>(3)) == splat_int<F>(k_kind_sheet)) &
               ((shift_right<2>(certificate) & splat_int<F>(63)) < splat_int<F>(policy.depth_max_class + 1));
  const F depth = decode_depth<F>(word);
  view.normal = decode_normal<F>(word);
  view.error = decode_error<F>(certificate);
  const Vec3Lanes<F> hit =
      at.frame.s * centre_of<F>(at.a, field.plane) + at.frame.t * centre_of<F>(at.b, field.plane) + at.frame.c * depth;
  view.offset = dot(view.normal, hit);
  view.distance = dot(view.normal, p) - view.offset;
  return view;
}

// Position of point p inside the ball against the first surface seen from outside along `direction` (which points from
// outside towards p). front: nothing lies before p. behind: something lies before p, certainly; `other_in_front` then
// says that this something also lies beyond the point `other` (the segment's other end).
template <class F>
struct DepthAnswer {
  Mask_t<F> front, behind, other_in_front, unknown;
  Int_t<F> slice, lookups;
};

template <class F>
FT_HD inline DepthAnswer<F> compare_depth(const FieldView& field, const QueryPolicy& policy,
                                          const Vec3Lanes<F>& direction, const Vec3Lanes<F>& p,
                                          const Vec3Lanes<F>& other, Mask_t<F> wanted) {
  const F zero = splat<F>(0.0f);
  // Half a plane cell: what the anchoring leaves uncertain beside the sheet's own error bound.
  const F half_cell = splat<F>(1.0f / field.plane);
  // How far a sheet may lie from the anchor before a line of the cell leaves the plane cell by more than half its
  // width: the direction cell's half width is sqrt(pi) / D on average (equal areas of 4 pi / D^2).
  const F near_distance = half_cell * splat<F>(field.directions * 0.5641896f);
  SheetView<F> view = look_up_sheet(field, policy, direction, p);
  DepthAnswer<F> answer;
  answer.slice = view.slice;
  answer.lookups = select(wanted, splat_int<F>(1), splat_int<F>(0));
  answer.unknown = wanted & !view.known;
  Mask_t<F> decided = wanted & view.known & view.sheet;
  // Distance along the line from p back to the sheet; the cosine is negative because the sheet faces the direction.
  const F cosine = dot(view.normal, direction);
  const F back = view.distance / min(cosine, splat<F>(-1e-6f));
  const Mask_t<F> far = decided & (abs(back) > near_distance);
  if (any(far)) {
    const Vec3Lanes<F> anchor = p - direction * back;
    const Mask_t<F> inside = far & (dot(anchor, anchor) < splat<F>(1.0f));
    const SheetView<F> second = look_up_sheet(field, policy, direction, anchor);
    answer.lookups = answer.lookups + select(inside, splat_int<F>(1), splat_int<F>(0));
    answer.unknown = answer.unknown | (inside & !second.known);
    answer.slice = select(inside & !second.known, second.slice, answer.slice);
    // The second cell must see a sheet where the first one did.
    const Mask_t<F> agrees = inside & second.known & second.sheet &
                             (abs(second.distance) <= second.error + view.error + half_cell + half_cell);
    decided = (and_not(far, decided)) | agrees;
    view.normal = {select(agrees, second.normal.x, view.normal.x), select(agrees, second.normal.y, view.normal.y),
                   select(agrees, second.normal.z, view.normal.z)};
    view.offset = select(agrees, second.offset, view.offset);
    view.error = select(agrees, second.error, view.error);
    view.distance = select(agrees, dot(view.normal, p) - view.offset, view.distance);
  }
  const F margin = view.error + view.error + half_cell;
  const F clear_from = policy.answer_all ? zero - margin : zero - view.error;
  answer.front = decided & (view.distance >= clear_from);
  answer.behind = decided & (view.distance < zero - margin);
  answer.other_in_front = answer.behind & (dot(view.normal, other) - view.offset > margin);
  return answer;
}

// The verdict for one object. `own`: the receiver lies on this object, so that the line surely meets it and the
// visibility cell of the whole line has nothing to say.
template <class F>
FT_HD inline SegmentVerdict<F> query_segment(const FieldView& field, const QueryPolicy& policy,
                                             const UnitSegment<F>& segment, Mask_t<F> own) {
  const F zero = splat<F>(0.0f);
  const Int_t<F> i_zero = splat_int<F>(0), i_one = splat_int<F>(1);
  const auto verdict_of = [](int v) { return splat_int<F>(v); };
  SegmentVerdict<F> result;
  result.verdict = select(segment.crosses, verdict_of(k_verdict_ask), verdict_of(k_verdict_none));
  result.slice = i_zero;
  result.lookups = i_zero;

  const Mask_t<F> skip_line = own & segment.origin_inside;
  const Mask_t<F> line_wanted = and_not(skip_line, segment.crosses);
  Mask_t<F> depth_wanted = segment.crosses & skip_line;
  if (any(line_wanted)) {
    // A line and its reverse share a cell: the one that points up.
    const Mask_t<F> down = segment.direction.z < zero;
    const Vec3Lanes<F> up = {select(down, -segment.direction.x, segment.direction.x),
                             select(down, -segment.direction.y, segment.direction.y),
                             select(down, -segment.direction.z, segment.direction.z)};
    const CellAddress<F> at = address_of_line(up, segment.foot, field.directions, field.plane);
    const CellSlot<F> slot = slot_of<F>(field, at);
    const Int_t<F> code = gather_bytes(field.visibility, slot.cell) & splat_int<F>(0xff);
    result.lookups = select(line_wanted, i_one, i_zero);
    const Mask_t<F> unknown = line_wanted & (code == i_zero);
    const Int_t<F> bits = code - i_one;
    const Mask_t<F> hits = line_wanted & ((bits & i_one) == i_one);
    const Mask_t<F> answers =
        and_not(unknown, line_wanted) & (shift_right<1>(bits) < splat_int<F>(policy.visibility_max_class + 1));
    const Mask_t<F> end_inside = segment.origin_inside | segment.end_inside;
    result.verdict = select(and_not(hits, answers), verdict_of(k_verdict_clear), result.verdict);
    result.verdict = select(and_not(end_inside, answers & hits), verdict_of(k_verdict_blocked), result.verdict);
    result.verdict = select(unknown, verdict_of(k_verdict_unknown_visibility), result.verdict);
    result.slice = slot.slice;
    // With an end inside, whatever is not a certified miss goes on to the depth cell.
    const Mask_t<F> go_on = and_not(unknown, line_wanted) & end_inside & (hits | !answers);
    depth_wanted = depth_wanted | go_on;
  }
  if (any(depth_wanted)) {
    const Mask_t<F> from_origin = depth_wanted & segment.origin_inside;
    const Vec3Lanes<F> p = {select(from_origin, segment.origin.x, segment.end.x),
                            select(from_origin, segment.origin.y, segment.end.y),
                            select(from_origin, segment.origin.z, segment.end.z)};
    const Vec3Lanes<F> other = {select(from_origin, segment.end.x, segment.origin.x),
                                select(from_origin, segment.end.y, segment.origin.y),
                                select(from_origin, segment.end.z, segment.origin.z)};
    const Vec3Lanes<F> direction = {select(from_origin, -segment.direction.x, segment.direction.x),
                                    select(from_origin, -segment.direction.y, segment.direction.y),
                                    select(from_origin, -segment.direction.z, segment.direction.z)};
    const Mask_t<F> both_inside = depth_wanted & segment.origin_inside & segment.end_inside;
    const DepthAnswer<F> first = compare_depth(field, policy, direction, p, other, depth_wanted);
    result.lookups = result.lookups + first.lookups;
    result.slice = select(first.unknown, first.slice, result.slice);
    Mask_t<F> clear = first.front;
    Mask_t<F> blocked = (and_not(both_inside, first.behind)) | (both_inside & first.other_in_front);
    Mask_t<F> unknown = first.unknown;
    const Mask_t<F> undecided = and_not(clear | blocked | unknown, both_inside);
    if (any(undecided)) {
      // Both ends inside and the surface lies beyond the far end: look from the other side.
      const DepthAnswer<F> second =
          compare_depth(field, policy, segment.direction, segment.end, segment.origin, undecided);
      result.lookups = result.lookups + second.lookups;
      result.slice = select(second.unknown, second.slice, result.slice);
      clear = clear | second.front;
      blocked = blocked | second.other_in_front;
      unknown = unknown | second.unknown;
    }
    result.verdict = select(depth_wanted, verdict_of(k_verdict_ask), result.verdict);
    result.verdict = select(clear, verdict_of(k_verdict_clear), result.verdict);
    result.verdict = select(blocked, verdict_of(k_verdict_blocked), result.verdict);
    result.verdict = select(unknown, verdict_of(k_verdict_unknown_depth), result.verdict);
  }
  return result;
}

FT_LANES_END

#endif  // toggled guard
