// The loop over rays behind SegmentKernels::nearest_hits. Included once per Highway target and once for floats.

#if defined(FIELDTRACE_FIELD_QUERY_HIT_BATCH_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_FIELD_QUERY_HIT_BATCH_INL_H_
#undef FIELDTRACE_FIELD_QUERY_HIT_BATCH_INL_H_
#else
#define FIELDTRACE_FIELD_QUERY_HIT_BATCH_INL_H_
#endif

#include "field/query/cone_batch-inl.h"
#include "field/query/hit.hd.h"

FT_LANES_BEGIN

// Answers one vector of rays. Unknown slices are added to `unknowns`; returns false if there are any.
template <class F>
FT_HD_INLINE bool answer_hits(const SegmentTask& task, const HitQueries& queries, size_t i, HitAnswers& out,
                              HitUnknowns& unknowns, uint64_t& lookups) {
  const RayLanes<F> r = load_rays<F>(queries.rays, i);
  const F limit = load_lanes<F>(&queries.limit[i]);
  UnitSegment<F> segment;
  const BallInterval<F> ball = write_hit_segment(task, r.o, r.d, r.tmax, limit, segment);
  if (!any(segment.crosses)) {
    store_lanes(splat_int<F>(k_verdict_none), &out.verdict[i]);
    return true;
  }
  const Mask_t<F> on_object = load_uint_lanes<F>(&queries.instance[i]) == splat_uint<F>(task.instance);
  const HitAnswer<F> hit = answer_hit(task, r.o, segment, ball, limit, load_lanes<F>(&queries.most_error[i]),
                                      load_lanes<F>(&queries.most_bend[i]), on_object);
  lookups += uint64_t(sum_of(hit.lookups));
  store_lanes(hit.verdict, &out.verdict[i]);
  store_lanes(hit.from, &out.from[i]);
  store_lanes(hit.t, &out.t[i]);
  store_lanes(hit.error, &out.error[i]);
  store_lanes(hit.normal.x, &out.nx[i]);
  store_lanes(hit.normal.y, &out.ny[i]);
  store_lanes(hit.normal.z, &out.nz[i]);
  store_lanes(hit.primitive, &out.primitive[i]);

  bool missing = false;
  const auto collect = [&](Mask_t<F> lacks, std::vector<uint32_t>& list) {
    if (!any(lacks)) return;
    missing = true;
    MissingList<F>{list}(hit.slice, lacks);
  };
  collect(hit.lacks_visibility, unknowns.visibility);
  collect(hit.lacks_depth, unknowns.depth);
  collect(hit.lacks_primitive, unknowns.primitive);
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
