// The loops behind SegmentKernels::light_cones and filter_strata. Included once per Highway target and once for
// floats.

#if defined(FIELDTRACE_FIELD_QUERY_CONE_BATCH_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_FIELD_QUERY_CONE_BATCH_INL_H_
#undef FIELDTRACE_FIELD_QUERY_CONE_BATCH_INL_H_
#else
#define FIELDTRACE_FIELD_QUERY_CONE_BATCH_INL_H_
#endif

#include "field/query/ray_states-inl.h"
#include "field/query/task_answers.hd.h"

FT_LANES_BEGIN

template <class F>
FT_HD_INLINE Vec3Lanes<F> load_points(const ShadingPointBatch& r, size_t i) {
  return {load_lanes<F>(&r.px[i]), load_lanes<F>(&r.py[i]), load_lanes<F>(&r.pz[i])};
}

// Collects the numbers of slices or tiles that are not baked.
template <class F>
struct MissingList {
  std::vector<uint32_t>& list;
  void operator()(Int_t<F> numbers, Mask_t<F> missing) const {
    alignas(64) int32_t chosen[2 * Lanes<F>::k_count];
    const int n = compress_store(numbers, missing, chosen);
    list.insert(list.end(), chosen, chosen + n);
  }
};

template <class F>
FT_HD_INLINE PointLanes<F> load_point_lanes(const ShadingPointBatch& r, size_t i, uint32_t instance) {
  return {load_points<F>(r, i),
          {load_lanes<F>(&r.gx[i]), load_lanes<F>(&r.gy[i]), load_lanes<F>(&r.gz[i])},
          load_lanes<F>(&r.error[i]),
          load_lanes<F>(&r.radius[i]),
          load_uint_lanes<F>(&r.instance[i]) == splat_uint<F>(instance),
          load_byte_lanes<F>(&r.transmits[i]) == splat_uint<F>(0)};
}

template <class F>
inline ConeCounts light_cones_batch(const ConeTask& task, const ShadingPointBatch& shading_points, const Sphere& light,
                                    std::span<const uint32_t> blocks, int32_t* flags, ConeUnknowns& unknowns) {
  ConeCounts counts;
  const Vec3Lanes<F> centre = {splat<F>(light.centre.x), splat<F>(light.centre.y), splat<F>(light.centre.z)};
  const Int_t<F> may = splat_int<F>(k_may_shadow);
  for (const uint32_t block : blocks) {
    bool missing = false;
    uint64_t open_lookups = 0;
    for (size_t i = block; i < block + k_batch_padding; i += size_t(Lanes<F>::k_count)) {
      const Int_t<F> flag = load_int_lanes<F>(flags + i);
      const Mask_t<F> queried = (flag & may) == may;
      if (!any(queried)) continue;
      const PointAnswer<F> answer = answer_light<F>(task, load_point_lanes<F>(shading_points, i, task.segment.instance),
                                                    centre, splat<F>(light.radius), queried,
                                                    MissingList<F>{unknowns.tiles}, MissingList<F>{unknowns.slices});
      const ConeAnswer<F>& cone = answer.cone;
      missing = missing || any(cone.unknown);
      const Int_t<F> settled = select(cone.clear | cone.blocked, cone.lookups, splat_int<F>(0));
      counts.lookups += uint64_t(sum_of(settled));
      open_lookups += uint64_t(sum_of(cone.lookups - settled));
      counts.clear += uint64_t(count_true(cone.clear));
      counts.blocked += uint64_t(count_true(cone.blocked));
      store_lanes(updated_flag<F>(flag, cone.clear, cone.blocked, answer.by_strata), flags + i);
    }
    // What is not settled is asked again once the block's tiles are baked.
    if (missing) {
      unknowns.blocks.push_back(block);
    } else {
      counts.lookups += open_lookups;
    }
  }
  return counts;
}

template <class F>
inline uint64_t filter_strata_batch(const StratumTask& task, const RayBatch& rays, const float* pdf,
                                    const float* radius, const int32_t* wanted, std::span<const uint32_t> blocks,
                                    float* clear, int32_t* refused, ConeUnknowns& unknowns) {
  uint64_t all_lookups = 0;
  constexpr size_t k_vectors = k_batch_padding / size_t(Lanes<F>::k_count);
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f);
  for (const uint32_t block : blocks) {
    F found[k_vectors];
    Mask_t<F> failed[k_vectors];
    bool missing = false;
    uint64_t lookups = 0;
    for (size_t v = 0; v < k_vectors; ++v) {
      const size_t i = block + v * size_t(Lanes<F>::k_count);
      const RayLanes<F> r = load_rays<F>(rays, i);
      const Mask_t<F> queried = (load_int_lanes<F>(wanted + i) > splat_int<F>(0)) & (r.tmax >= zero);
      found[v] = one;
      failed[v] = and_not(queried, queried);
      if (!any(queried)) continue;
      const StratumAnswer<F> answer =
          answer_stratum<F>(task, r.o, r.d, r.tmax, load_lanes<F>(pdf + i), load_lanes<F>(radius + i), queried,
                            MissingList<F>{unknowns.tiles});
      found[v] = answer.clear;
      failed[v] = answer.refused;
      missing = missing || any(answer.unknown);
      lookups += uint64_t(sum_of(answer.lookups));
    }
    if (missing) {
      unknowns.blocks.push_back(block);
      continue;
    }
    all_lookups += lookups;
    for (size_t v = 0; v < k_vectors; ++v) {
      const size_t i = block + v * size_t(Lanes<F>::k_count);
      store_lanes(load_lanes<F>(clear + i) * found[v], clear + i);
      store_lanes(select(failed[v], splat_int<F>(1), load_int_lanes<F>(refused + i)), refused + i);
    }
  }
  return all_lookups;
}

FT_LANES_END

#endif  // toggled guard
