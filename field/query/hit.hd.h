// The nearest surface of an object along a ray, in the terms of the ray: world space, within a limit, with bounds on
// its errors. The loop: field/query/hit_batch-inl.h.
//
// Space: world space, transformed by the task. Thread-safety: pure functions over a FieldView.

#if defined(FIELDTRACE_FIELD_QUERY_HIT_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_FIELD_QUERY_HIT_HD_H_
#undef FIELDTRACE_FIELD_QUERY_HIT_HD_H_
#else
#define FIELDTRACE_FIELD_QUERY_HIT_HD_H_
#endif

#include "field/query/nearest.hd.h"
#include "field/query/query_tasks.h"

FT_LANES_BEGIN

// The world-space direction of a unit-space normal: by the transpose of world -> unit.
template <class F>
FT_HD_INLINE Vec3Lanes<F> world_normal(const float* m, const Vec3Lanes<F>& n) {
  const Vec3Lanes<F> w = transposed_vector(m, n);
  return w * (splat<F>(1.0f) / sqrt(max(dot(w, w), splat<F>(1e-37f))));
}

// Bound on what rounding moves a unit-space point on the ray by: 4 roundings of the origin's transform, relative to its
// terms; 3 of the direction, and some 8 of the foot, the anchor and the distance to a plane, relative to the distance
// along the ray.
template <class F>
FT_HD_INLINE F rounding_in_unit_space(const float* m, const Vec3Lanes<F>& o, F way) {
  const auto of_axis = [&](int axis) {
    return abs(splat<F>(m[axis]) * o.x) + abs(splat<F>(m[3 + axis]) * o.y) + abs(splat<F>(m[6 + axis]) * o.z) +
           abs(splat<F>(m[9 + axis]));
  };
  return (of_axis(0) + of_axis(1) + of_axis(2) + way) * splat<F>(16.0f * 0x1p-24f);
}

// The part of the ray that lies in the ball, in units of its direction.
template <class F>
struct BallInterval {
  F entry, exit;
};

template <class F>
FT_HD_INLINE BallInterval<F> interval_in_ball(const UnitSegment<F>& segment) {
  const F zero = splat<F>(0.0f);
  const F half = sqrt(max(zero, splat<F>(1.0f) - dot(segment.foot, segment.foot)));
  const F middle = dot(segment.foot - segment.origin, segment.direction);
  return {max(zero, middle - half) / segment.scale, (middle + half) / segment.scale};
}

// The ray in unit space, and where it lies in the ball; it crosses nothing if it enters beyond the limit.
template <class F>
FT_HD_INLINE BallInterval<F> write_hit_segment(const SegmentTask& task, const Vec3Lanes<F>& o, const Vec3Lanes<F>& d,
                                               F tmax, F limit, UnitSegment<F>& segment) {
  write_segment(task.to_unit, o, d, tmax, segment);
  const BallInterval<F> ball = interval_in_ball(segment);
  segment.crosses = segment.crosses & (ball.entry <= limit);
  segment.origin_inside = segment.origin_inside & segment.crosses;
  segment.end_inside = segment.end_inside & segment.crosses;
  return ball;
}

// As HitAnswers (field/query/hit_batch.h), and what is not baked.
template <class F>
struct HitAnswer {
  Int_t<F> verdict;
  F from, t, error;
  Vec3Lanes<F> normal;
  Int_t<F> primitive, lookups;
  Int_t<F> slice;  // to bake where one of these is missing:
  Mask_t<F> lacks_visibility, lacks_depth, lacks_primitive;
};

// limit, most_error, most_bend: as HitQueries. on_object: the ray leaves the task's instance.
template <class F>
FT_HD_INLINE HitAnswer<F> answer_hit(const SegmentTask& task, const Vec3Lanes<F>& o, const UnitSegment<F>& segment,
                                     const BallInterval<F>& ball, F limit, F most_error, F most_bend,
                                     Mask_t<F> on_object) {
  const NearestAnswer<F> answer = nearest_on_segment(task.field, task.policy, segment, on_object);
  const F one = splat<F>(1.0f);
  const F cosine = max(abs(dot(answer.normal, segment.direction)), splat<F>(0x1p-20f));
  const F rounding = rounding_in_unit_space(task.to_unit, o, abs(answer.distance) + one);
  HitAnswer<F> hit;
  hit.t = answer.distance / segment.scale;
  hit.error = (answer.error + rounding / cosine) / segment.scale;
  const Mask_t<F> found = answer.verdict == splat_int<F>(k_verdict_blocked);
  const Mask_t<F> in_ball = (hit.t + hit.error >= ball.entry) & (hit.t - hit.error <= ball.exit);
  hit.from = select(found & in_ball, max(hit.t - hit.error, ball.entry), ball.entry);
  const Mask_t<F> within = found & (hit.from <= limit);
  const Mask_t<F> fine = within & in_ball & (hit.error <= most_error * hit.t) & (answer.bend <= most_bend);
  const Mask_t<F> known = fine & (answer.primitive > splat_int<F>(k_none_found));
  const Int_t<F> verdict = select(found, splat_int<F>(k_verdict_none), answer.verdict);
  hit.verdict =
      select(known, splat_int<F>(k_verdict_blocked), select(within, splat_int<F>(k_verdict_undecided), verdict));
  hit.normal = world_normal(task.to_unit, answer.normal);
  hit.primitive = answer.primitive;
  hit.lookups = answer.lookups;
  hit.slice = answer.slice;
  hit.lacks_visibility = answer.verdict == splat_int<F>(k_verdict_unknown_visibility);
  hit.lacks_depth = answer.verdict == splat_int<F>(k_verdict_unknown_depth);
  hit.lacks_primitive = fine & (answer.primitive == splat_int<F>(k_not_baked));
  return hit;
}

FT_LANES_END

#endif  // toggled guard
