// The loops behind segment_kernels.h, generic over the lane type: one lane for the scalar table, vectors otherwise.
// Included once per Highway target and once for plain floats.

#if defined(FIELDTRACE_FIELD_SEGMENT_BATCH_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_FIELD_SEGMENT_BATCH_INL_H_
#undef FIELDTRACE_FIELD_SEGMENT_BATCH_INL_H_
#else
#define FIELDTRACE_FIELD_SEGMENT_BATCH_INL_H_
#endif

#include "field/query.hd.h"
#include "field/segment_kernels.h"

FT_LANES_BEGIN

template <class F>
struct RayLanes {
  Vec3Lanes<F> o, d;
  F tmax;
};

template <class F>
inline RayLanes<F> load_rays(const RayBatch& r, size_t i) {
  return {{load_lanes<F>(&r.ox[i]), load_lanes<F>(&r.oy[i]), load_lanes<F>(&r.oz[i])},
          {load_lanes<F>(&r.dx[i]), load_lanes<F>(&r.dy[i]), load_lanes<F>(&r.dz[i])},
          load_lanes<F>(&r.tmax[i])};
}

template <class F>
inline SegmentCounts query_batch(const SegmentTask& task, const RayBatch& rays, const uint32_t* receiver_instance,
                                 size_t begin, size_t end, int32_t* verdict, int32_t* slice) {
  SegmentCounts counts;
  const Uint_t<F> instance = splat_uint<F>(task.instance);
  const Int_t<F> none = splat_int<F>(k_verdict_none);
  for (size_t i = begin; i < end; i += size_t(Lanes<F>::k_count)) {
    const RayLanes<F> r = load_rays<F>(rays, i);
    const UnitSegment<F> segment = segment_in_unit_space(task.to_unit, r.o, r.d, r.tmax);
    if (!any(segment.crosses)) {
      store(none, verdict + i);
      continue;
    }
    const Mask_t<F> own = load_uint_lanes<F>(receiver_instance + i) == instance;
    const SegmentVerdict<F> result = query_segment(task.field, task.policy, segment, own);
    store(result.verdict, verdict + i);
    store(result.slice, slice + i);
    counts.crossings += size_t(count_true(segment.crosses));
    counts.lookups += size_t(sum_of(result.lookups));
    counts.unknown += size_t(count_true(result.verdict > splat_int<F>(k_verdict_ask)));
  }
  return counts;
}

template <class F>
inline SegmentCounts cross_ball_batch(const SegmentTask& task, const RayBatch& rays, size_t begin, size_t end,
                                      int32_t* verdict) {
  SegmentCounts counts;
  for (size_t i = begin; i < end; i += size_t(Lanes<F>::k_count)) {
    const RayLanes<F> r = load_rays<F>(rays, i);
    const UnitSegment<F> segment = segment_in_unit_space(task.to_unit, r.o, r.d, r.tmax);
    store(select(segment.crosses, splat_int<F>(k_verdict_ask), splat_int<F>(k_verdict_none)), verdict + i);
    counts.crossings += size_t(count_true(segment.crosses));
  }
  return counts;
}

// Distance at which a slab is entered and left, widened by the rounding of the subtraction, the reciprocal and the
// product (pbrt, section 6.8.2: factor 1 + 2 gamma(3)).
template <class F>
inline void clip_slab(F o, F d, float lower, float upper, F& enter, F& leave) {
  // A component too small to divide by becomes a tiny one of the same sign: the slab is then met nowhere or everywhere.
  const F inverse = splat<F>(1.0f) / copysign(max(abs(d), splat<F>(1e-30f)), d);
  const F a = (splat<F>(lower) - o) * inverse;
  const F b = (splat<F>(upper) - o) * inverse;
  const F widen = splat<F>(1.0f + 2.0f * (3.0f * 0x1p-24f) / (1.0f - 3.0f * 0x1p-24f));
  enter = max(enter, min(a, b));
  leave = min(leave, max(a, b) * widen);
}

template <class F>
inline SegmentCounts cross_box_batch(const BoxTask& task, const RayBatch& rays, const uint32_t* receiver_instance,
                                     size_t begin, size_t end, int32_t* verdict) {
  SegmentCounts counts;
  const Uint_t<F> instance = splat_uint<F>(task.skip_own ? task.instance : 0xfffffffeu);
  const float* m = task.to_object;
  for (size_t i = begin; i < end; i += size_t(Lanes<F>::k_count)) {
    const RayLanes<F> r = load_rays<F>(rays, i);
    F enter = splat<F>(0.0f), leave = r.tmax;
    for (int axis = 0; axis < 3; ++axis) {
      const F mx = splat<F>(m[axis]), my = splat<F>(m[3 + axis]), mz = splat<F>(m[6 + axis]);
      const F o = mx * r.o.x + my * r.o.y + mz * r.o.z + splat<F>(m[9 + axis]);
      const F d = mx * r.d.x + my * r.d.y + mz * r.d.z;
      clip_slab(o, d, task.lower[axis], task.upper[axis], enter, leave);
    }
    const Mask_t<F> own = load_uint_lanes<F>(receiver_instance + i) == instance;
    const Mask_t<F> crosses = and_not(own, (enter <= leave) & (r.tmax >= splat<F>(0.0f)));
    store(select(crosses, splat_int<F>(k_verdict_ask), splat_int<F>(k_verdict_none)), verdict + i);
    counts.crossings += size_t(count_true(crosses));
  }
  return counts;
}

template <class F>
constexpr SegmentKernels make_segment_kernels() {
  return {&query_batch<F>, &cross_ball_batch<F>, &cross_box_batch<F>};
}

FT_LANES_END

#endif  // toggled guard
