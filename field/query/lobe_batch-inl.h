// The loops over samples behind SegmentKernels::lobes_meet and filter_lobes. Included once per Highway target and once
// for floats.

#if defined(FIELDTRACE_FIELD_QUERY_LOBE_BATCH_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_FIELD_QUERY_LOBE_BATCH_INL_H_
#undef FIELDTRACE_FIELD_QUERY_LOBE_BATCH_INL_H_
#else
#define FIELDTRACE_FIELD_QUERY_LOBE_BATCH_INL_H_
#endif

#include "field/query/cone_batch-inl.h"
#include "field/query/lobe.hd.h"

FT_LANES_BEGIN

// Half width of a sample's tube, relative to the side of a square of its solid angle. Half of that area is read, which
// leaves three fifths of the bias of reading all of it, with a twentieth more noise (docs/decisions/015-glossy.md).
constexpr float k_lobe_share = 0.35f;
// A sample in the far tail of a lobe stands for a large part of the sphere: no tube is wider than this tangent.
constexpr float k_widest_lobe = 0.12f;

template <class F>
struct LobeLanes {
  LightStratum<F> stratum;
  Vec3Lanes<F> p;    // the shading point
  F scale, stretch;  // unit-space length of the ray's world direction; bound on that of its neighbours, relative to it
  Mask_t<F> meets;   // the object's ball
};

template <class F>
FT_HD_INLINE LobeLanes<F> load_lobes(const ConeTask& task, const RayBatch& r, const float* density, size_t i) {
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f);
  const float* m = task.segment.to_unit;
  const Vec3Lanes<F> d = {load_lanes<F>(&r.dx[i]), load_lanes<F>(&r.dy[i]), load_lanes<F>(&r.dz[i])};
  const Vec3Lanes<F> q = transformed_vector(m, d);
  LobeLanes<F> lobe;
  lobe.scale = sqrt(dot(q, q));
  const Vec3Lanes<F> o = {load_lanes<F>(&r.ox[i]), load_lanes<F>(&r.oy[i]), load_lanes<F>(&r.oz[i])};
  lobe.p = transformed_point(m, o);
  // The side of a square of about the sample's solid angle.
  const F given = load_lanes<F>(&density[i]);
  const F side = sqrt(one / max(given, splat<F>(1e-30f)));
  lobe.stretch = splat<F>(task.segment.to_unit_stretch) / lobe.scale;
  const F width = min(side * splat<F>(k_lobe_share) * lobe.stretch, splat<F>(k_widest_lobe));
  lobe.stratum = round_stratum<F>(lobe.p, q * (one / lobe.scale), width);
  const Mask_t<F> active = (load_lanes<F>(&r.tmax[i]) >= zero) & (given > zero);
  if (!task.segment.keeps_angles) {
    LightStratum<F>& stratum = lobe.stratum;
    transform_tube(task.segment, o, d, side * splat<F>(k_lobe_share), stratum);
    const F narrowed = splat<F>(k_widest_lobe) / max(stratum.width, splat<F>(k_widest_lobe));
    for (F* extent : {&stratum.width, &stratum.world_width, &stratum.bend}) *extent = *extent * narrowed;
  }
  lobe.meets = active & ((span_of_stratum(lobe.stratum).half > zero) | (lobe.stratum.bend > splat<F>(k_most_bend)));
  return lobe;
}

// Rays that leave another object, from outside this one's ball or with all of this one in front.
template <class F>
FT_HD_INLINE Mask_t<F> suited_lobes(const ConeTask& task, const LobeBatch& lobes, const LobeLanes<F>& lobe, size_t i) {
  LightCone<F> cone;
  cone.near = splat<F>(0.0f);
  cone.p = lobe.p;
  cone.axis = lobe.stratum.direction;
  cone.sine = lobe.stratum.width;
  const Mask_t<F> self = load_uint_lanes<F>(&lobes.instance[i]) == splat_uint<F>(task.segment.instance);
  const Mask_t<F> outside = !(dot(lobe.p, lobe.p) < splat<F>(1.0f));
  const Vec3Lanes<F> normal = {load_lanes<F>(&lobes.nx[i]), load_lanes<F>(&lobes.ny[i]), load_lanes<F>(&lobes.nz[i])};
  return and_not(self, lobe.meets & (outside | faces_object<F>(task, cone, normal)));
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
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f);
  for (const uint32_t block : blocks) {
    bool missing = false;
    uint64_t lookups = 0;
    for (size_t i = block; i < block + k_batch_padding; i += size_t(Lanes<F>::k_count)) {
      const LobeLanes<F> lobe = load_lobes<F>(task, lobes.rays, lobes.density.data(), i);
      const Mask_t<F> wanted = suited_lobes(task, lobes, lobe, i), unsuited = and_not(wanted, lobe.meets);
      store_lanes(one, &out.clear[i]);
      for (auto* colour : {&out.red, &out.green, &out.blue, &out.distance}) store_lanes(zero, colour->data() + i);
      store_lanes(select(unsuited, splat_int<F>(1), splat_int<F>(0)), &out.refused[i]);
      if (!any(wanted)) continue;
      F blur = load_lanes<F>(&lobes.blur[i]);
      if (task.segment.keeps_angles) blur = blur / max(lobe.stretch, one);
      const LobeAnswer<F> answer =
          filter_lobe<F>(task.segment.field, lobe.stratum, blur, wanted, MissingList<F>{unknowns.tiles});
      missing = missing || any(answer.unknown);
      lookups += uint64_t(sum_of(answer.lookups));
      store_lanes(answer.clear, &out.clear[i]);
      store_lanes(answer.radiance.red, &out.red[i]);
      store_lanes(answer.radiance.green, &out.green[i]);
      store_lanes(answer.radiance.blue, &out.blue[i]);
      store_lanes(answer.distance / lobe.scale, &out.distance[i]);
      store_lanes(select(unsuited | answer.refused, splat_int<F>(1), splat_int<F>(0)), &out.refused[i]);
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
