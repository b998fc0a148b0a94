// Field queries: is the segment between two points free of one object? Written once for a float, a SIMD vector and a
// GPU thread.
//
// Space: unit space of the object (field/chart/chart.hd.h). The query first reads the *visibility* cell of the whole
// line. The cell's certificate covers all lines whose foot of the perpendicular lies in that cell, which is exactly how
// the query addresses it. If the line misses the object, the segment is clear, wherever it ends. If the line hits and
// both ends lie outside the ball, it is blocked. With an end inside, the *depth* cell anchored at that end tells how
// far along the line the first surface lies, seen from outside: the end is in front of it (clear), behind it by more
// than the margin (blocked), or too near to tell (undecided). Where that surface lies far from the anchor, the query
// re-anchors once, at the depth found, because a depth cell's lines fan out from its own hit. A depth cell that holds
// only a one-sided bound (the object lies behind its plane, or misses part of the cell) can certify clear, never
// blocked. Thread-safety: pure functions over a FieldView.

#if defined(FIELDTRACE_FIELD_QUERY_QUERY_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_FIELD_QUERY_QUERY_HD_H_
#undef FIELDTRACE_FIELD_QUERY_QUERY_HD_H_
#else
#define FIELDTRACE_FIELD_QUERY_QUERY_HD_H_
#endif

#include "core/simd/lanes.hd.h"
#include "field/chart/chart.hd.h"
#include "field/store/layout.hd.h"

FT_LANES_BEGIN

// Verdicts. `none`: the segment does not meet the ball; no look-up was made. `unknown_*`: a slice is not baked yet.
constexpr int k_verdict_none = 0;
constexpr int k_verdict_clear = 1;
constexpr int k_verdict_blocked = 2;
constexpr int k_verdict_undecided = 3;
constexpr int k_verdict_unknown_visibility = 4;
constexpr int k_verdict_unknown_depth = 5;

// A point counts as in front of a plane fit up to this share of the error bound behind it, that is 1.5 times the
// largest residual seen. Shading points on the fitted surface lie within that; anything further in front of a point may
// be a blocker (docs/decisions/003-certificates.md).
constexpr float k_front_share = 0.75f;

template <class F>
struct SegmentVerdict {
  Int_t<F> verdict;
  Int_t<F> slice;    // the slice to bake where the verdict is unknown_*
  Int_t<F> lookups;  // cells read
};

// A segment in unit space: origin, unit direction, length (may be infinite), and where it lies relative to the ball.
template <class F>
struct UnitSegment {
  Vec3Lanes<F> origin, direction, foot, end;
  F length;
  F scale;  // unit-space length of the caller's direction: t in the caller's units = distance / scale
  Mask_t<F> crosses, origin_inside, end_inside;
};

// Row `axis` of a 3 x 4 column-major transform, applied to a vector; then all rows, to a vector and to a point; then
// the transpose, to a vector.
template <class F>
FT_HD_INLINE F transformed(const float* m, int axis, const Vec3Lanes<F>& v) {
  return splat<F>(m[axis]) * v.x + splat<F>(m[3 + axis]) * v.y + splat<F>(m[6 + axis]) * v.z;
}
template <class F>
FT_HD_INLINE Vec3Lanes<F> transformed_vector(const float* m, const Vec3Lanes<F>& v) {
  return {transformed(m, 0, v), transformed(m, 1, v), transformed(m, 2, v)};
}
template <class F>
FT_HD_INLINE Vec3Lanes<F> transformed_point(const float* m, const Vec3Lanes<F>& p) {
  return transformed_vector(m, p) + Vec3Lanes<F>{splat<F>(m[9]), splat<F>(m[10]), splat<F>(m[11])};
}
template <class F>
FT_HD_INLINE Vec3Lanes<F> transposed_vector(const float* m, const Vec3Lanes<F>& v) {
  const auto along_column = [&](int i) {
    return splat<F>(m[i]) * v.x + splat<F>(m[i + 1]) * v.y + splat<F>(m[i + 2]) * v.z;
  };
  return {along_column(0), along_column(3), along_column(6)};
}

// Transforms a world-space ray into unit space. to_unit: 3 x 4, column-major. An inactive ray (tmax < 0) crosses
// nothing. Written in place: copying the struct would read its narrow masks by wide loads, which stall on the stores
// just made.
template <class F>
FT_HD_INLINE void write_segment(const float* to_unit, const Vec3Lanes<F>& o, const Vec3Lanes<F>& d, F tmax,
                                UnitSegment<F>& s) {
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f);
  s.origin = transformed_point(to_unit, o);
  const Vec3Lanes<F> q = transformed_vector(to_unit, d);
  const F scale = sqrt(dot(q, q));
  s.direction = q * (one / scale);
  s.length = tmax * scale;
  s.scale = scale;
  const LineFoot<F> foot = foot_of_line(s.origin, s.direction);
  s.foot = foot.point;
  // Squared distances from the centre: of the line, of the origin and of the end.
  const F line_squared = dot(s.foot, s.foot);
  const F to_end = s.length - foot.along;
  const F origin_squared = line_squared + foot.along * foot.along;
  const F end_squared = line_squared + to_end * to_end;
  const Mask_t<F> origin_in = origin_squared < one, end_in = end_squared < one;
  // With both ends outside, the segment meets the ball where the foot lies between them.
  const Mask_t<F> spans = (line_squared < one) & (foot.along > zero) & (to_end > zero);
  s.crosses = (spans | origin_in | end_in) & (tmax >= zero);
  s.origin_inside = s.crosses & origin_in;
  s.end_inside = s.crosses & end_in;
  // From the foot rather than from the origin, which may be far away.
  s.end = s.foot + s.direction * to_end;
}

template <class F>
FT_HD_INLINE UnitSegment<F> segment_in_unit_space(const float* to_unit, const Vec3Lanes<F>& o, const Vec3Lanes<F>& d,
                                                  F tmax) {
  UnitSegment<F> segment;
  write_segment(to_unit, o, d, tmax, segment);
  return segment;
}

// What a depth cell knows about a point p: the signed distance of p from the fitted plane (positive on the side seen
// from outside along the cell's direction), the error bound, and whether the cell may answer.
template <class F>
struct PlaneFitView {
  Vec3Lanes<F> normal;
  F distance;  // of p
  F offset;    // plane: dot(normal, x) = offset
  F error;
  F along;  // of p, along the cell's direction from the centre plane
  Mask_t<F> known;
  Mask_t<F> has_plane;  // plane fit or one-sided bound: nothing lies in front of the plane
  Mask_t<F> solid;      // plane fit: and every line meets it
  Mask_t<F> miss;
  Int_t<F> slice;
  Int_t<F> primitive_cell;  // index into the primitive layer
};

// `at` is the address of the line through p.
template <class F>
FT_HD_INLINE PlaneFitView<F> look_up_plane_fit(const FieldView& field, const QueryPolicy& policy,
                                               const CellAddress<F>& at, const Vec3Lanes<F>& p) {
  const CellSlot<F> slot = slot_of<F>(field, at);
  // The certificate first: a baker writes it last, so that where it is known the depth word is complete.
  const Int_t<F> certificate = gather(field.certificate, slot.cell);
  order_loads();
  const Int_t<F> word = gather(field.depth, slot.cell);
  PlaneFitView<F> view;
  view.slice = slot.slice;
  view.primitive_cell = slot.cell;
  view.known = !(certificate == splat_int<F>(0));
  const Mask_t<F> answers = (shift_right<2>(certificate) & splat_int<F>(63)) < splat_int<F>(policy.depth_max_class + 1);
  const Int_t<F> kind = certificate & splat_int<F>(3);
  view.has_plane = (kind > splat_int<F>(k_kind_miss)) & answers;
  view.solid = policy.answer_all ? view.has_plane : view.has_plane & (kind == splat_int<F>(k_kind_plane_fit));
  view.miss = (kind == splat_int<F>(k_kind_miss)) & answers;
  const F depth = decode_depth<F>(word);
  view.normal = decode_normal<F>(word);
  view.error = decode_error<F>(certificate);
  const Vec3Lanes<F> hit =
      at.frame.s * centre_of<F>(at.a, field.plane) + at.frame.t * centre_of<F>(at.b, field.plane) + at.frame.c * depth;
  view.along = dot(p, at.frame.c);
  view.offset = dot(view.normal, hit);
  view.distance = dot(view.normal, p) - view.offset;
  return view;
}

// The first surface along a line, seen from outside, as the depth cells near the point p of the line know it.
template <class F>
struct FoundPlaneFit {
  PlaneFitView<F> view;
  F back;                   // distance along the line from p back to the plane fit
  Mask_t<F> decided;        // the plane fit may be relied on
  Mask_t<F> miss;           // a miss, certified near the centre plane, from which its lines fan out
  Mask_t<F> unknown;        // a slice is not baked yet
  Int_t<F> slice, lookups;  // `slice`: the one to bake if unknown, else the first one read
};

// Half a plane cell: the uncertainty that anchoring adds to a plane fit's own error bound.
template <class F>
FT_HD_INLINE F half_cell_of(const FieldView& field) {
  return splat<F>(0.5f * field.plane.step);
}

// Distance back along the line from a point at `distance` off the fitted plane. The cosine is negative because the
// plane faces the direction; clamping it at -2^-20 only keeps the quotient finite.
template <class F>
FT_HD_INLINE F distance_back(const PlaneFitView<F>& view, const Vec3Lanes<F>& direction) {
  return view.distance / min(dot(view.normal, direction), splat<F>(-0x1p-20f));
}

template <class F>
FT_HD_INLINE FoundPlaneFit<F> find_plane_fit(const FieldView& field, const QueryPolicy& policy,
                                             const CellAddress<F>& at, const Vec3Lanes<F>& direction,
                                             const Vec3Lanes<F>& p, Mask_t<F> wanted) {
  const F half_cell = half_cell_of<F>(field);
  // How far a plane fit may lie from the anchor before a line of the cell leaves the plane cell by more than a quarter
  // of its width. The direction cell's half width is sqrt(pi) / D on average (equal areas of 4 pi / D^2).
  const F near_distance = half_cell * splat<F>(field.directions.cells * (0.5f * 0.5641896f));
  FoundPlaneFit<F> found;
  found.view = look_up_plane_fit(field, policy, at, p);
  PlaneFitView<F>& view = found.view;
  found.slice = view.slice;
  found.lookups = select(wanted, splat_int<F>(1), splat_int<F>(0));
  found.unknown = wanted & !view.known;
  found.decided = wanted & view.known & view.has_plane;
  found.miss = wanted & view.miss;
  if (!policy.answer_all) found.miss = found.miss & (abs(view.along) <= near_distance);
  found.back = distance_back(view, direction);
  const Mask_t<F> far = found.decided & (abs(found.back) > near_distance);
  if (any(far)) {
    const Vec3Lanes<F> anchor = p - direction * found.back;
    const Mask_t<F> inside = far & (dot(anchor, anchor) < splat<F>(1.0f));
    const PlaneFitView<F> second =
        look_up_plane_fit(field, policy, address_of_line(direction, anchor, field.directions, field.plane), anchor);
    const Mask_t<F> missing = inside & !second.known;
    found.lookups = found.lookups + select(inside, splat_int<F>(1), splat_int<F>(0));
    found.unknown = found.unknown | missing;
    found.slice = select(missing, second.slice, found.slice);
    // The second cell must see a plane fit where the first one did.
    const Mask_t<F> agrees = inside & second.known & second.has_plane &
                             (abs(second.distance) <= second.error + view.error + half_cell + half_cell);
    // Where every query is answered, the first cell wins if the two contradict each other.
    found.decided = policy.answer_all ? found.decided : (and_not(far, found.decided)) | agrees;
    view.solid = (and_not(agrees, view.solid)) | (agrees & second.solid);
    view.normal = {select(agrees, second.normal.x, view.normal.x), select(agrees, second.normal.y, view.normal.y),
                   select(agrees, second.normal.z, view.normal.z)};
    view.offset = select(agrees, second.offset, view.offset);
    view.error = select(agrees, second.error, view.error);
    view.primitive_cell = select(agrees, second.primitive_cell, view.primitive_cell);
    view.slice = select(agrees, second.slice, view.slice);
    view.distance = select(agrees, dot(view.normal, p) - view.offset, view.distance);
    found.back = select(agrees, distance_back(view, direction), found.back);
  }
  return found;
}

// Position of point p inside the ball relative to the first surface seen from outside along `direction` (which points
// from outside towards p). front: nothing lies in front of p. behind: something certainly does; with other_in_front,
// the point `other`, the segment's other end, is in front of that surface, which thus lies between the two.
template <class F>
struct DepthAnswer {
  Mask_t<F> front, behind, other_in_front, unknown;
  Int_t<F> slice, lookups;
};

template <class F>
FT_HD_INLINE DepthAnswer<F> compare_depth(const FieldView& field, const QueryPolicy& policy, const CellAddress<F>& at,
                                          const Vec3Lanes<F>& direction, const Vec3Lanes<F>& p,
                                          const Vec3Lanes<F>& other, Mask_t<F> wanted) {
  const F zero = splat<F>(0.0f);
  const FoundPlaneFit<F> found = find_plane_fit(field, policy, at, direction, p, wanted);
  const PlaneFitView<F>& view = found.view;
  DepthAnswer<F> answer;
  answer.slice = found.slice;
  answer.lookups = found.lookups;
  answer.unknown = found.unknown;
  const F margin = view.error + view.error + half_cell_of<F>(field);
  const F clear_from = policy.answer_all ? zero - margin : zero - view.error * splat<F>(k_front_share);
  answer.front = found.decided & (view.distance >= clear_from);
  if (policy.answer_all) answer.front = answer.front | found.miss;
  answer.behind = found.decided & view.solid & (view.distance < zero - margin);
  answer.other_in_front = answer.behind & (dot(view.normal, other) - view.offset > margin);
  return answer;
}

// The visibility cell of a segment's whole line.
template <class F>
struct LineView {
  Mask_t<F> unknown, miss, hit;  // none of them: the cell may not answer
  Int_t<F> slice;
};

// A line and its reverse share a visibility cell: the one of the direction that points up.
template <class F>
FT_HD_INLINE Vec3Lanes<F> upward(const Vec3Lanes<F>& d) {
  const Mask_t<F> down = d.z < splat<F>(0.0f);
  return {select(down, -d.x, d.x), select(down, -d.y, d.y), select(down, -d.z, d.z)};
}

// `at` is the address of the line through the segment's foot, in its upward direction.
template <class F>
FT_HD_INLINE LineView<F> look_up_line(const FieldView& field, const QueryPolicy& policy, const CellAddress<F>& at) {
  const Int_t<F> one = splat_int<F>(1);
  const CellSlot<F> slot = slot_of<F>(field, at);
  const Int_t<F> code = gather_bytes(field.visibility, slot.cell) & splat_int<F>(0xff);
  const Int_t<F> bits = code - one;
  LineView<F> view;
  view.slice = slot.slice;
  view.unknown = code == splat_int<F>(0);
  const Mask_t<F> answers = and_not(view.unknown, shift_right<1>(bits) < splat_int<F>(policy.visibility_max_class + 1));
  view.hit = answers & ((bits & one) == one);
  view.miss = and_not(view.hit, answers);
  return view;
}

template <class F>
FT_HD_INLINE LineView<F> look_up_line(const FieldView& field, const QueryPolicy& policy,
                                      const UnitSegment<F>& segment) {
  return look_up_line(field, policy,
                      address_of_line(upward(segment.direction), segment.foot, field.directions, field.plane));
}

// Lanes whose visibility cell is worth reading. `self`: the shading point lies on this object, so its line is known to
// meet the object.
template <class F>
FT_HD_INLINE Mask_t<F> line_wanted(const UnitSegment<F>& segment, Mask_t<F> self) {
  return and_not(self & segment.origin_inside, segment.crosses);
}

// The verdict so far, and the lanes that the depth cells must decide.
template <class F>
struct LineAnswer {
  SegmentVerdict<F> verdict;
  Mask_t<F> depth_wanted;
};

template <class F>
FT_HD_INLINE LineAnswer<F> answer_by_line(const UnitSegment<F>& segment, Mask_t<F> wanted, const LineView<F>& line) {
  const Int_t<F> i_zero = splat_int<F>(0), i_one = splat_int<F>(1);
  LineAnswer<F> answer;
  const Mask_t<F> unknown = wanted & line.unknown;
  const Mask_t<F> end_inside = segment.origin_inside | segment.end_inside;
  Int_t<F> verdict = select(segment.crosses, splat_int<F>(k_verdict_undecided), splat_int<F>(k_verdict_none));
  verdict = select(wanted & line.miss, splat_int<F>(k_verdict_clear), verdict);
  verdict = select(and_not(end_inside, wanted & line.hit), splat_int<F>(k_verdict_blocked), verdict);
  answer.verdict.verdict = select(unknown, splat_int<F>(k_verdict_unknown_visibility), verdict);
  answer.verdict.slice = line.slice;
  answer.verdict.lookups = select(wanted, i_one, i_zero);
  // With an end inside, everything but a certified miss goes on to the depth cells, as do the lanes that read no
  // visibility cell.
  answer.depth_wanted = and_not(wanted, segment.crosses) | and_not(unknown | line.miss, wanted & end_inside);
  return answer;
}

// Where a segment reads the depth cells: at its end p inside the ball (the origin, if that lies inside), looking from
// outside along `direction`. `other` is the segment's other end.
template <class F>
struct DepthAnchor {
  Vec3Lanes<F> p, other, direction;
};

template <class F>
FT_HD_INLINE DepthAnchor<F> depth_anchor(const UnitSegment<F>& segment) {
  const Mask_t<F> from_origin = segment.origin_inside;
  const Vec3Lanes<F>&o = segment.origin, &e = segment.end, &d = segment.direction;
  return {{select(from_origin, o.x, e.x), select(from_origin, o.y, e.y), select(from_origin, o.z, e.z)},
          {select(from_origin, e.x, o.x), select(from_origin, e.y, o.y), select(from_origin, e.z, o.z)},
          {select(from_origin, -d.x, d.x), select(from_origin, -d.y, d.y), select(from_origin, -d.z, d.z)}};
}

// Decides the lanes in `wanted`, each with at least one end inside the ball, by the depth cells. `at` is the address of
// the line through the anchor's p.
template <class F>
FT_HD_INLINE void answer_by_depth(const FieldView& field, const QueryPolicy& policy, const UnitSegment<F>& segment,
                                  const DepthAnchor<F>& anchor, const CellAddress<F>& at, Mask_t<F> wanted,
                                  SegmentVerdict<F>& result) {
  const Mask_t<F> both_inside = wanted & segment.origin_inside & segment.end_inside;
  const DepthAnswer<F> first = compare_depth(field, policy, at, anchor.direction, anchor.p, anchor.other, wanted);
  result.lookups = result.lookups + first.lookups;
  result.slice = select(first.unknown, first.slice, result.slice);
  Mask_t<F> clear = first.front;
  Mask_t<F> blocked = (and_not(both_inside, first.behind)) | (both_inside & first.other_in_front);
  Mask_t<F> unknown = first.unknown;
  const Mask_t<F> undecided = and_not(clear | blocked | unknown, both_inside);
  if (any(undecided)) {
    // With both ends inside and the surface beyond the far end, look from the other side.
    const DepthAnswer<F> second =
        compare_depth(field, policy, address_of_line(segment.direction, segment.end, field.directions, field.plane),
                      segment.direction, segment.end, segment.origin, undecided);
    result.lookups = result.lookups + second.lookups;
    result.slice = select(second.unknown, second.slice, result.slice);
    clear = clear | second.front;
    blocked = blocked | second.other_in_front;
    unknown = unknown | second.unknown;
  }
  // Every query is answered: neither side sees a surface between the ends, so there is no blocker.
  if (policy.answer_all) clear = clear | (and_not(blocked, wanted));
  result.verdict = select(wanted, splat_int<F>(k_verdict_undecided), result.verdict);
  result.verdict = select(clear, splat_int<F>(k_verdict_clear), result.verdict);
  result.verdict = select(blocked, splat_int<F>(k_verdict_blocked), result.verdict);
  result.verdict = select(unknown, splat_int<F>(k_verdict_unknown_depth), result.verdict);
}

// The verdict for one object: the steps above for one segment. Batches run each step over many segments before the
// next, so that a processor can overlap them (field/query/segment_batch-inl.h).
template <class F>
FT_HD_INLINE SegmentVerdict<F> query_segment(const FieldView& field, const QueryPolicy& policy,
                                             const UnitSegment<F>& segment, Mask_t<F> self) {
  const Mask_t<F> wanted = line_wanted(segment, self);
  LineAnswer<F> answer = answer_by_line(segment, wanted, look_up_line(field, policy, segment));
  if (any(answer.depth_wanted)) {
    const DepthAnchor<F> anchor = depth_anchor(segment);
    answer_by_depth(field, policy, segment, anchor,
                    address_of_line(anchor.direction, anchor.p, field.directions, field.plane), answer.depth_wanted,
                    answer.verdict);
  }
  return answer.verdict;
}

FT_LANES_END

#endif  // toggled guard
