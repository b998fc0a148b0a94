// The loop over rays behind SegmentKernels::nearest_hits. Included once per Highway target and once for floats.

#if defined(FIELDTRACE_FIELD_QUERY_HIT_BATCH_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_FIELD_QUERY_HIT_BATCH_INL_H_
#undef FIELDTRACE_FIELD_QUERY_HIT_BATCH_INL_H_
#else
#define FIELDTRACE_FIELD_QUERY_HIT_BATCH_INL_H_
#endif

#include "field/query/cone_batch-inl.h"
#include "field/query/nearest.hd.h"

FT_LANES_BEGIN

// The world-space direction of a unit-space normal: by the transpose of world -> unit.
template <class F>
FT_HD_INLINE Vec3Lanes<F> world_normal(const float* m, const Vec3Lanes<F>& n) {
  const auto along_column = [&](int i) {
    return splat<F>(m[i]) * n.x + splat<F>(m[i + 1]) * n.y + splat<F>(m[i + 2]) * n.z;
  };
  const Vec3Lanes<F> w = {along_column(0), along_column(3), along_column(6)};
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

// Answers one vector of rays. Unknown slices are added to `unknowns`; returns false if there are any.
template <class F>
FT_HD_INLINE bool answer_hits(const SegmentTask& task, const HitQueries& queries, size_t i, HitAnswers& out,
                              HitUnknowns& unknowns, uint64_t& lookups) {
  const RayBatch& rays = queries.rays;
  const Vec3Lanes<F> o = {load_lanes<F>(&rays.ox[i]), load_lanes<F>(&rays.oy[i]), load_lanes<F>(&rays.oz[i])};
  const Vec3Lanes<F> d = {load_lanes<F>(&rays.dx[i]), load_lanes<F>(&rays.dy[i]), load_lanes<F>(&rays.dz[i])};
  const F limit = load_lanes<F>(&queries.limit[i]);
  UnitSegment<F> segment;
  write_segment(task.to_unit, o, d, load_lanes<F>(&rays.tmax[i]), segment);
  const BallInterval<F> ball = interval_in_ball(segment);
  segment.crosses = segment.crosses & (ball.entry <= limit);
  if (!any(segment.crosses)) {
    store_lanes(splat_int<F>(k_verdict_none), &out.verdict[i]);
    return true;
  }
  segment.origin_inside = segment.origin_inside & segment.crosses;
  segment.end_inside = segment.end_inside & segment.crosses;
  const Mask_t<F> self = load_uint_lanes<F>(&queries.instance[i]) == splat_uint<F>(task.instance);
  const NearestAnswer<F> answer = nearest_on_segment(task.field, task.policy, segment, self);
  lookups += uint64_t(sum_of(answer.lookups));

  const F one = splat<F>(1.0f);
  const F cosine = max(abs(dot(answer.normal, segment.direction)), splat<F>(0x1p-20f));
  const F rounding = rounding_in_unit_space(task.to_unit, o, abs(answer.distance) + one);
  const F t = answer.distance / segment.scale, error = (answer.error + rounding / cosine) / segment.scale;
  const Mask_t<F> hit = answer.verdict == splat_int<F>(k_verdict_blocked);
  const Mask_t<F> in_ball = (t + error >= ball.entry) & (t - error <= ball.exit);
  const F from = select(hit & in_ball, max(t - error, ball.entry), ball.entry);
  const Mask_t<F> within = hit & (from <= limit);
  const Mask_t<F> fine = within & in_ball & (error <= load_lanes<F>(&queries.most_error[i]) * t) &
                         (answer.bend <= load_lanes<F>(&queries.most_bend[i]));
  const Mask_t<F> lacks_primitive = fine & (answer.primitive == splat_int<F>(k_not_baked));
  const Mask_t<F> known = fine & (answer.primitive > splat_int<F>(k_none_found));
  Int_t<F> verdict = select(hit, splat_int<F>(k_verdict_none), answer.verdict);
  verdict = select(within, splat_int<F>(k_verdict_undecided), verdict);
  store_lanes(select(known, splat_int<F>(k_verdict_blocked), verdict), &out.verdict[i]);
  const Vec3Lanes<F> normal = world_normal(task.to_unit, answer.normal);
  store_lanes(from, &out.from[i]);
  store_lanes(t, &out.t[i]);
  store_lanes(error, &out.error[i]);
  store_lanes(normal.x, &out.nx[i]);
  store_lanes(normal.y, &out.ny[i]);
  store_lanes(normal.z, &out.nz[i]);
  store_lanes(answer.primitive, &out.primitive[i]);

  bool missing = false;
  const auto collect = [&](Mask_t<F> unknown, std::vector<uint32_t>& list) {
    if (!any(unknown)) return;
    missing = true;
    MissingList<F>{list}(answer.slice, unknown);
  };
  collect(answer.verdict == splat_int<F>(k_verdict_unknown_visibility), unknowns.visibility);
  collect(answer.verdict == splat_int<F>(k_verdict_unknown_depth), unknowns.depth);
  collect(lacks_primitive, unknowns.primitive);
  return !missing;
}

template <class F>
inline uint64_t nearest_hits_batch(const SegmentTask& task, const HitQueries& queries, std::span<const uint32_t> blocks,
                                   HitAnswers& out, HitUnknowns& unknowns) {
  uint64_t all_lookups = 0;
  for (const uint32_t block : blocks) {
    bool known = true;
    uint64_t lookups = 0;
    for (size_t i = block; i < block + k_batch_padding; i += size_t(Lanes<F>::k_count)) {
      known = answer_hits<F>(task, queries, i, out, unknowns, lookups) && known;
    }
    if (known) {
      all_lookups += lookups;
    } else {
      unknowns.blocks.push_back(block);
    }
  }
  return all_lookups;
}

FT_LANES_END

#endif  // toggled guard
