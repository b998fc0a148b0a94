// The loops over samples behind SegmentKernels::lobes_meet and filter_lobes. Included once per Highway target and once
// for floats.

#if defined(FIELDTRACE_FIELD_QUERY_LOBE_BATCH_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_FIELD_QUERY_LOBE_BATCH_INL_H_
#undef FIELDTRACE_FIELD_QUERY_LOBE_BATCH_INL_H_
#else
#define FIELDTRACE_FIELD_QUERY_LOBE_BATCH_INL_H_
#endif

#include "field/query/cone_batch-inl.h"

FT_LANES_BEGIN

template <class F>
FT_HD_INLINE LobeLanes<F> load_lobes(const ConeTask& task, const RayBatch& r, const float* density, size_t i) {
  const RayLanes<F> ray = load_rays<F>(r, i);
  return make_lobe<F>(task, ray.o, ray.d, ray.tmax, load_lanes<F>(&density[i]));
}

template <class F>
inline void lobes_meet_batch(const ConeTask& task, const RayBatch& rays, const float* density, int32_t* met) {
  for (size_t i = 0; i < padded(rays.size); i += size_t(Lanes<F>::k_count)) {
    const Int_t<F> meets = select(load_lobes<F>(task, rays, density, i).meets, splat_int<F>(1), splat_int<F>(0));
    store_lanes(load_int_lanes<F>(&met[i]) | meets, &met[i]);
  }
}

template <class F>
inline uint64_t filter_lobes_batch(const ConeTask& task, const LobeBatch& lobes, std::span<const uint32_t> blocks,
                                   LobeAnswers& out, ConeUnknowns& unknowns) {
  uint64_t all_lookups = 0;
  for (const uint32_t block : blocks) {
    bool missing = false;
    uint64_t lookups = 0;
    for (size_t i = block; i < block + k_batch_padding; i += size_t(Lanes<F>::k_count)) {
      const LobeLanes<F> lobe = load_lobes<F>(task, lobes.rays, lobes.density.data(), i);
      const Vec3Lanes<F> normal = {load_lanes<F>(&lobes.nx[i]), load_lanes<F>(&lobes.ny[i]),
                                   load_lanes<F>(&lobes.nz[i])};
      const Mask_t<F> self = load_uint_lanes<F>(&lobes.instance[i]) == splat_uint<F>(task.segment.instance);
      const LobeAnswer<F> answer =
          answer_lobe<F>(task, lobe, normal, self, load_lanes<F>(&lobes.blur[i]), MissingList<F>{unknowns.tiles});
      missing = missing || any(answer.unknown);
      lookups += uint64_t(sum_of(answer.lookups));
      store_lanes(answer.clear, &out.clear[i]);
      store_lanes(answer.radiance.red, &out.red[i]);
      store_lanes(answer.radiance.green, &out.green[i]);
      store_lanes(answer.radiance.blue, &out.blue[i]);
      store_lanes(answer.distance, &out.distance[i]);
      store_lanes(select(answer.refused, splat_int<F>(1), splat_int<F>(0)), &out.refused[i]);
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
