// The loop over rays behind SegmentKernels::nearest_hits. Included once per Highway target and once for floats.

#if defined(FIELDTRACE_FIELD_HIT_BATCH_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_FIELD_HIT_BATCH_INL_H_
#undef FIELDTRACE_FIELD_HIT_BATCH_INL_H_
#else
#define FIELDTRACE_FIELD_HIT_BATCH_INL_H_
#endif

#include "field/cone_batch-inl.h"
#include "field/nearest.hd.h"

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

// Where the segment enters the ball, in units of the ray's direction.
template <class F>
FT_HD_INLINE F entry_of(const UnitSegment<F>& segment) {
  const F zero = splat<F>(0.0f);
  const F half = sqrt(max(zero, splat<F>(1.0f) - dot(segment.foot, segment.foot)));
  return max(zero, dot(segment.foot - segment.origin, segment.direction) - half) / segment.scale;
}

template <class F>
inline uint64_t nearest_hits_batch(const SegmentTask& task, const RayBatch& rays, const uint32_t* ray_instance,
                                   const float* limit, std::span<const uint32_t> blocks, HitAnswers& out,
                                   HitUnknowns& unknowns) {
  uint64_t all_lookups = 0;
  for (const uint32_t block : blocks) {
    bool missing = false;
    uint64_t lookups = 0;
    for (size_t i = block; i < block + k_batch_padding; i += size_t(Lanes<F>::k_count)) {
      const Vec3Lanes<F> o = {load_lanes<F>(&rays.ox[i]), load_lanes<F>(&rays.oy[i]), load_lanes<F>(&rays.oz[i])};
      const Vec3Lanes<F> d = {load_lanes<F>(&rays.dx[i]), load_lanes<F>(&rays.dy[i]), load_lanes<F>(&rays.dz[i])};
      UnitSegment<F> segment;
      write_segment(task.to_unit, o, d, load_lanes<F>(&rays.tmax[i]), segment);
      const F entry = entry_of(segment);
      segment.crosses = segment.crosses & (entry <= load_lanes<F>(limit + i));
      store_lanes(entry, &out.entry[i]);
      if (!any(segment.crosses)) {
        store_lanes(splat_int<F>(k_verdict_none), &out.verdict[i]);
        continue;
      }
      segment.origin_inside = segment.origin_inside & segment.crosses;
      segment.end_inside = segment.end_inside & segment.crosses;
      const Mask_t<F> own = load_uint_lanes<F>(ray_instance + i) == splat_uint<F>(task.instance);
      const NearestAnswer<F> answer = nearest_on_segment(task.field, task.policy, segment, own);
      store_lanes(answer.verdict, &out.verdict[i]);
      lookups += uint64_t(sum_of(answer.lookups));
      const auto collect = [&](int verdict, std::vector<uint32_t>& list) {
        const Mask_t<F> unknown = answer.verdict == splat_int<F>(verdict);
        if (!any(unknown)) return;
        missing = true;
        MissingList<F>{list}(answer.slice, unknown);
      };
      collect(k_verdict_unknown_visibility, unknowns.visibility);
      collect(k_verdict_unknown_depth, unknowns.depth);
      collect(k_verdict_unknown_primitive, unknowns.primitive);
      const Vec3Lanes<F> normal = world_normal(task.to_unit, answer.normal);
      store_lanes(answer.distance / segment.scale, &out.t[i]);
      store_lanes(answer.error / segment.scale, &out.error[i]);
      store_lanes(answer.bend, &out.bend[i]);
      store_lanes(normal.x, &out.nx[i]);
      store_lanes(normal.y, &out.ny[i]);
      store_lanes(normal.z, &out.nz[i]);
      store_lanes(answer.primitive, &out.primitive[i]);
    }
    if (missing) {
      unknowns.blocks.push_back(block);
    } else {
      all_lookups += lookups;
    }
  }
  return all_lookups;
}

FT_LANES_END

#endif  // toggled guard
