// Loops over batches of rays against one instance's thesis field, for any lane type.
//
// Included once by the scalar file and once per Highway target. Thread-safety: reads the field, writes the batch only.

#if defined(FIELDTRACE_FIELD_THESIS_THESIS_BATCH_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_FIELD_THESIS_THESIS_BATCH_INL_H_
#undef FIELDTRACE_FIELD_THESIS_THESIS_BATCH_INL_H_
#else
#define FIELDTRACE_FIELD_THESIS_THESIS_BATCH_INL_H_
#endif

#include "field/query/ray_states-inl.h"
#include "field/thesis/thesis_kernels.h"
#include "field/thesis/thesis_look_up.hd.h"

FT_LANES_BEGIN

template <class F>
void thesis_nearest(const ThesisInstanceView& view, const RayBatch& rays, const AlignedVector<uint32_t>& skip,
                    ThesisHits& hits) {
  const Uint_t<F> self = splat_uint<F>(view.instance);
  for (size_t i = 0; i < rays.size; i += size_t(Lanes<F>::k_count)) {
    const RayLanes<F> r = load_rays<F>(rays, i);
    const Mask_t<F> active = and_not(load_uint_lanes<F>(&skip[i]) == self, r.tmax >= splat<F>(0.0f));
    const ThesisUnitRay<F> ray = thesis_unit_ray(view, r.o, r.d);
    const F end = splat<F>(k_infinity);
    const ThesisFound<F> found = look_up_thesis(view.field, ray.origin, ray.direction, splat<F>(0.0f), end, active);
    if (!any(found.hit)) continue;
    const F t = found.along / ray.scale, before = load_lanes<F>(&hits.t[i]);
    const Mask_t<F> nearer = found.hit & (t < before);
    if (!any(nearer)) continue;
    const Vec3Lanes<F> n = thesis_normal<F>(view, found.sample);
    store_lanes(select(nearer, t, before), &hits.t[i]);
    store_lanes(select(nearer, n.x, load_lanes<F>(&hits.nx[i])), &hits.nx[i]);
    store_lanes(select(nearer, n.y, load_lanes<F>(&hits.ny[i])), &hits.ny[i]);
    store_lanes(select(nearer, n.z, load_lanes<F>(&hits.nz[i])), &hits.nz[i]);
    store_lanes(select(nearer, self, load_uint_lanes<F>(&hits.instance[i])), &hits.instance[i]);
  }
}

// Along the reversed ray from the shading point, the light lies at -length; blockers lie before -slack.
template <class F>
SegmentCounts thesis_shadow(const ThesisInstanceView& view, const RayBatch& rays, size_t begin, size_t end,
                            int32_t candidate_slot, RayStates& states) {
  const F zero = splat<F>(0.0f);
  SegmentCounts counts;
  for (size_t i = begin; i < end; i += size_t(Lanes<F>::k_count)) {
    const RayLanes<F> r = load_rays<F>(rays, i);
    const ThesisUnitRay<F> ray = thesis_unit_ray(view, r.o, r.d);
    const Vec3Lanes<F> from_light = {zero - ray.direction.x, zero - ray.direction.y, zero - ray.direction.z};
    const F from = zero - r.tmax * ray.scale, to = splat<F>(-view.slack);
    const ThesisFound<F> found = look_up_thesis(view.field, ray.origin, from_light, from, to, r.tmax >= zero);
    if (states.keep_verdicts) {
      const Int_t<F> clear = select(found.crosses, splat_int<F>(k_verdict_clear), splat_int<F>(k_verdict_none));
      store_lanes(select(found.hit, splat_int<F>(k_verdict_blocked), clear), &states.verdict[i]);
    }
    if (!any(found.crosses)) continue;
    counts.crossings += size_t(count_true(found.crosses));
    update_states<F>(states, i, found.crosses, found.hit, and_not(found.hit, found.hit), candidate_slot);
  }
  counts.lookups = counts.crossings;
  return counts;
}

template <class F>
constexpr ThesisKernels make_thesis_kernels() {
  return {&thesis_nearest<F>, &thesis_shadow<F>};
}

FT_LANES_END

#endif  // toggled guard
