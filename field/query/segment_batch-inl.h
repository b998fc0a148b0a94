// The loops behind segment_kernels.h, generic over the lane type: one lane for the scalar table, vectors otherwise.
// Included once per Highway target and once for plain floats.

#if defined(FIELDTRACE_FIELD_QUERY_SEGMENT_BATCH_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_FIELD_QUERY_SEGMENT_BATCH_INL_H_
#undef FIELDTRACE_FIELD_QUERY_SEGMENT_BATCH_INL_H_
#else
#define FIELDTRACE_FIELD_QUERY_SEGMENT_BATCH_INL_H_
#endif

#include "field/query/bounds.hd.h"
#include "field/query/cone_batch-inl.h"
#include "field/query/hit_batch-inl.h"
#include "field/query/lobe_batch-inl.h"
#include "field/query/ray_states-inl.h"
#include "field/query/segment_kernels.h"
#include "field/query/task_answers.hd.h"

FT_LANES_BEGIN

// Rays that are repeated together once missing cells are baked: k_batch_padding, whatever the vector length.
constexpr size_t k_block = k_batch_padding;

// Blocks of rays that go through a query step by step. Each step is a short loop whose vectors the processor overlaps;
// a whole query at once would be one dependency chain longer than its reorder window
// (docs/decisions/008-two-chains.md). Few enough for the first-level cache.
constexpr size_t k_blocks_at_once = 4;

// What the steps pass on: the vectors that meet the ball, packed to the front, then those of them that need depth
// cells.
template <class F>
struct QueryScratch {
  static constexpr int k_vectors = int(k_blocks_at_once * k_block) / Lanes<F>::k_count;
  UnitSegment<F> segment[k_vectors];
  Mask_t<F> wanted[k_vectors], self[k_vectors];
  CellAddress<F> at[k_vectors];
  int vector[k_vectors];                // index of the vector in the batch
  SegmentVerdict<F> result[k_vectors];  // by that index
};

// Adds the verdicts of one block of rays to their states, or sets the block aside if it met cells that are not baked.
template <class F>
inline void finish_block(const SegmentVerdict<F>* results, size_t block, int32_t candidate_slot, RayStates& states,
                         SegmentCounts& counts) {
  constexpr int k_vectors = int(k_block) / Lanes<F>::k_count;
  bool crossed = false, unknown = false;
  for (int part = 0; part < k_vectors; ++part) {
    const Int_t<F> verdict = results[part].verdict;
    crossed = crossed || any(!(verdict == splat_int<F>(k_verdict_none)));
    unknown = unknown || any(verdict > splat_int<F>(k_verdict_undecided));
    if (states.keep_verdicts) store_lanes(verdict, &states.verdict[block + size_t(part * Lanes<F>::k_count)]);
  }
  if (!crossed) return;
  if (unknown) {
    states.unknown_blocks.push_back(uint32_t(block));
    for (int part = 0; part < k_vectors; ++part) {
      alignas(64) int32_t slices[Lanes<F>::k_count];
      const auto append = [&](int verdict, std::vector<uint32_t>& list) {
        const int n = compress_store(results[part].slice, results[part].verdict == splat_int<F>(verdict), slices);
        list.insert(list.end(), slices, slices + n);
      };
      append(k_verdict_unknown_visibility, states.unknown_visibility);
      append(k_verdict_unknown_depth, states.unknown_depth);
    }
    return;
  }
  Int_t<F> lookups = splat_int<F>(0);
  for (int part = 0; part < k_vectors; ++part) {
    const Int_t<F> verdict = results[part].verdict;
    const Mask_t<F> crosses = !(verdict == splat_int<F>(k_verdict_none));
    lookups = lookups + results[part].lookups;
    counts.crossings += size_t(count_true(crosses));
    update_states<F>(states, block + size_t(part * Lanes<F>::k_count), crosses,
                     verdict == splat_int<F>(k_verdict_blocked), verdict == splat_int<F>(k_verdict_undecided),
                     candidate_slot);
  }
  counts.lookups += size_t(sum_of(lookups));
}

// Transforms segments to unit space; returns how many vectors meet the ball.
template <class F>
inline int transform_step(const SegmentTask& task, const RayBatch& rays, const uint32_t* shading_point_instance,
                          size_t first, int vectors, QueryScratch<F>& s) {
  const Uint_t<F> instance = splat_uint<F>(task.instance);
  int crossing = 0;
  for (int v = 0; v < vectors; ++v) {
    const size_t i = first + size_t(v * Lanes<F>::k_count);
    const RayLanes<F> r = load_rays<F>(rays, i);
    UnitSegment<F>& segment = s.segment[crossing];
    write_segment(task.to_unit, r.o, r.d, r.tmax, segment);
    const Mask_t<F> self = segment.crosses & (load_uint_lanes<F>(shading_point_instance + i) == instance);
    s.self[crossing] = self & segment.origin_inside;
    s.wanted[crossing] = task.self_only ? and_not(self, self) : line_wanted(segment, self);
    s.vector[crossing] = v;
    s.result[v].verdict = splat_int<F>(k_verdict_none);
    s.result[v].lookups = splat_int<F>(0);
    crossing += any(segment.crosses);
  }
  return crossing;
}

// Addresses the visibility cells that are wanted.
template <class F>
inline void line_step(const SegmentTask& task, int count, QueryScratch<F>& s) {
  for (int k = 0; k < count; ++k) {
    if (any(s.wanted[k])) find_direction_cell(upward(s.segment[k].direction), task.field.directions, s.at[k]);
  }
  for (int k = 0; k < count; ++k) {
    if (any(s.wanted[k])) find_plane_cell(s.segment[k].foot, task.field.directions, task.field.plane, s.at[k]);
  }
}

// Verdicts by visibility cells; returns how many vectors need depth cells, packed to the front with their masks in
// `wanted`.
template <class F>
inline int answer_step(const SegmentTask& task, int count, QueryScratch<F>& s) {
  int deep = 0;
  for (int k = 0; k < count; ++k) {
    const Mask_t<F> wanted = s.wanted[k];
    LineView<F> line = {wanted, wanted, wanted, splat_int<F>(0)};
    if (any(wanted)) line = look_up_line(task.field, task.policy, s.at[k]);
    LineAnswer<F> answer = answer_by_line(s.segment[k], wanted, line);
    if (task.self_only) answer.depth_wanted = s.self[k];
    s.result[s.vector[k]] = answer.verdict;
    if (!any(answer.depth_wanted)) continue;
    s.segment[deep] = s.segment[k];
    s.wanted[deep] = answer.depth_wanted;
    s.vector[deep++] = s.vector[k];
  }
  return deep;
}

// Verdicts by depth cells.
template <class F>
inline void depth_step(const SegmentTask& task, int count, QueryScratch<F>& s) {
  for (int k = 0; k < count; ++k) {
    find_direction_cell(depth_anchor(s.segment[k]).direction, task.field.directions, s.at[k]);
  }
  for (int k = 0; k < count; ++k) {
    find_plane_cell(depth_anchor(s.segment[k]).p, task.field.directions, task.field.plane, s.at[k]);
  }
  for (int k = 0; k < count; ++k) {
    answer_by_depth(task.field, task.policy, s.segment[k], depth_anchor(s.segment[k]), s.at[k], s.wanted[k],
                    s.result[s.vector[k]]);
  }
}

template <class F>
inline SegmentCounts query_batch(const SegmentTask& task, const RayBatch& rays, const uint32_t* shading_point_instance,
                                 size_t begin, size_t end, int32_t candidate_slot, RayStates& states) {
  SegmentCounts counts;
  constexpr size_t k_count = size_t(Lanes<F>::k_count);
  QueryScratch<F> s;
  for (size_t first = begin; first < end; first += k_blocks_at_once * k_block) {
    const size_t last = end - first < k_blocks_at_once * k_block ? end : first + k_blocks_at_once * k_block;
    const int vectors = int((last - first) / k_count);
    const int crossing = transform_step(task, rays, shading_point_instance, first, vectors, s);
    line_step(task, crossing, s);
    const int deep = answer_step(task, crossing, s);
    if (task.reads_depth) depth_step(task, deep, s);
    for (size_t block = first; block < last; block += k_block) {
      finish_block(&s.result[(block - first) / k_count], block, candidate_slot, states, counts);
    }
  }
  return counts;
}

template <class F>
inline SegmentCounts cross_ball_batch(const SegmentTask& task, const RayBatch& rays, size_t begin, size_t end,
                                      int32_t candidate_slot, RayStates& states) {
  SegmentCounts counts;
  for (size_t i = begin; i < end; i += size_t(Lanes<F>::k_count)) {
    const RayLanes<F> r = load_rays<F>(rays, i);
    const UnitSegment<F> segment = segment_in_unit_space(task.to_unit, r.o, r.d, r.tmax);
    if (!any(segment.crosses)) continue;
    counts.crossings += size_t(count_true(segment.crosses));
    const Mask_t<F> never = and_not(segment.crosses, segment.crosses);
    update_states<F>(states, i, segment.crosses, never, segment.crosses, candidate_slot);
  }
  return counts;
}

template <class F>
inline SegmentCounts cross_box_batch(const BoxTask& task, const RayBatch& rays, const uint32_t* shading_point_instance,
                                     size_t begin, size_t end, int32_t candidate_slot, RayStates& states) {
  SegmentCounts counts;
  const Uint_t<F> skipped = splat_uint<F>(skipped_instance(task));
  for (size_t i = begin; i < end; i += size_t(Lanes<F>::k_count)) {
    const RayLanes<F> r = load_rays<F>(rays, i);
    const Mask_t<F> crosses =
        crosses_box(task, r.o, r.d, r.tmax, load_uint_lanes<F>(shading_point_instance + i) == skipped);
    if (!any(crosses)) continue;
    counts.crossings += size_t(count_true(crosses));
    update_states<F>(states, i, crosses, and_not(crosses, crosses), crosses, candidate_slot);
  }
  return counts;
}

template <class F>
FT_HD_INLINE void raise_flags(Mask_t<F> raised, int32_t* flags) {
  const Int_t<F> old = load_int_lanes<F>(flags);
  store_lanes(old | select(raised, splat_int<F>(k_may_shadow), splat_int<F>(0)), flags);
}

template <class F>
inline void hull_meets_ball_batch(const SegmentTask& task, const ShadingPointBatch& shading_points, const Sphere& light,
                                  int32_t* flags) {
  const Vec3Lanes<F> centre = {splat<F>(light.centre.x), splat<F>(light.centre.y), splat<F>(light.centre.z)};
  const F light_radius = splat<F>(light.radius);
  for (size_t i = 0; i < padded(shading_points.size); i += size_t(Lanes<F>::k_count)) {
    const F radius = load_lanes<F>(&shading_points.radius[i]);
    raise_flags<F>(hull_meets_ball(task, load_points<F>(shading_points, i), radius, centre, light_radius), flags + i);
  }
}

template <class F>
inline void hull_meets_box_batch(const BoxTask& task, const ShadingPointBatch& shading_points, const Sphere& light,
                                 int32_t* flags) {
  const Vec3Lanes<F> centre = {splat<F>(light.centre.x), splat<F>(light.centre.y), splat<F>(light.centre.z)};
  const F light_radius = splat<F>(light.radius);
  const Uint_t<F> skipped = splat_uint<F>(skipped_instance(task));
  for (size_t i = 0; i < padded(shading_points.size); i += size_t(Lanes<F>::k_count)) {
    const F radius = load_lanes<F>(&shading_points.radius[i]);
    const Mask_t<F> is_skipped = load_uint_lanes<F>(&shading_points.instance[i]) == skipped;
    raise_flags<F>(hull_meets_box(task, load_points<F>(shading_points, i), radius, centre, light_radius, is_skipped),
                   flags + i);
  }
}

template <class F>
inline void collect_batch(const RayStates& states, size_t rays, uint8_t* blocked, ExactLists& lists) {
  lists.one_undecided_slot.resize(padded(rays) + k_block);
  lists.many_undecided_slots.resize(padded(rays) + k_block);
  lists.one_count = lists.many_count = 0;
  lists.crossing = 0;
  const Int_t<F> zero = splat_int<F>(0);
  for (size_t i = 0; i < padded(rays); i += size_t(Lanes<F>::k_count)) {
    const Int_t<F> state = load_int_lanes<F>(&states.state[i]);
    const Mask_t<F> touched = !(state == zero);
    if (!any(touched)) continue;
    lists.crossing += size_t(count_true(touched));
    const UndecidedRays<F> undecided = undecided_rays<F>(state);
    const Int_t<F> index = lane_sequence<F>(int32_t(i));
    lists.one_count +=
        size_t(compress_store(index, undecided.by_one, lists.one_undecided_slot.data() + lists.one_count));
    lists.many_count +=
        size_t(compress_store(index, undecided.by_more, lists.many_undecided_slots.data() + lists.many_count));
  }
  for (size_t i = 0; i < rays; ++i) blocked[i] = uint8_t((states.state[i] / RayStates::k_blocked) & 1);
}

template <class F>
constexpr SegmentKernels make_segment_kernels() {
  return {&query_batch<F>,          &cross_ball_batch<F>,   &cross_box_batch<F>,     &hull_meets_ball_batch<F>,
          &hull_meets_box_batch<F>, &light_cones_batch<F>,  &filter_strata_batch<F>, &lobes_meet_batch<F>,
          &filter_lobes_batch<F>,   &nearest_hits_batch<F>, &collect_batch<F>};
}

FT_LANES_END

#endif  // toggled guard
