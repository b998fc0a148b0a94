// Loops over batches of rays against one instance's thesis field, for any lane type.
//
// Included once by the scalar file and once per Highway target. Thread-safety: reads the field, writes the batch only.

#if defined(FIELDTRACE_TOOLS_THESIS_LOOK_UP_BATCH_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_TOOLS_THESIS_LOOK_UP_BATCH_INL_H_
#undef FIELDTRACE_TOOLS_THESIS_LOOK_UP_BATCH_INL_H_
#else
#define FIELDTRACE_TOOLS_THESIS_LOOK_UP_BATCH_INL_H_
#endif

#include "tools/thesis/look_up.hd.h"
#include "tools/thesis/look_up_kernels.h"

FT_LANES_BEGIN

template <class F>
FT_HD_INLINE Vec3Lanes<F> load_vector(const AlignedVector<float>& x, const AlignedVector<float>& y,
                                      const AlignedVector<float>& z, size_t i) {
  return {load_lanes<F>(&x[i]), load_lanes<F>(&y[i]), load_lanes<F>(&z[i])};
}

template <class F>
void thesis_nearest(const ThesisInstanceView& view, const RayBatch& rays, const uint32_t* skip, ThesisHits& hits) {
  const Uint_t<F> own = splat_uint<F>(view.instance);
  for (size_t i = 0; i < rays.size; i += size_t(Lanes<F>::k_count)) {
    const Vec3Lanes<F> o = load_vector<F>(rays.ox, rays.oy, rays.oz, i);
    const Vec3Lanes<F> d = load_vector<F>(rays.dx, rays.dy, rays.dz, i);
    Mask_t<F> active = load_lanes<F>(&rays.tmax[i]) >= splat<F>(0.0f);
    active = and_not(load_uint_lanes<F>(&skip[i]) == own, active);
    const ThesisFound<F> found = look_up_thesis(view, o, d, active);
    if (!any(found.hit)) continue;
    const F t = found.along / found.scale, before = load_lanes<F>(&hits.t[i]);
    const Mask_t<F> nearer = found.hit & (t < before);
    if (!any(nearer)) continue;
    const Vec3Lanes<F> n = thesis_normal<F>(view, found.sample);
    store_lanes(select(nearer, t, before), &hits.t[i]);
    store_lanes(select(nearer, n.x, load_lanes<F>(&hits.nx[i])), &hits.nx[i]);
    store_lanes(select(nearer, n.y, load_lanes<F>(&hits.ny[i])), &hits.ny[i]);
    store_lanes(select(nearer, n.z, load_lanes<F>(&hits.nz[i])), &hits.nz[i]);
    store_lanes(select(nearer, own, load_uint_lanes<F>(&hits.instance[i])), &hits.instance[i]);
  }
}

template <class F>
void thesis_hide(const ThesisInstanceView& view, const RayBatch& rays, uint32_t* hidden) {
  for (size_t i = 0; i < rays.size; i += size_t(Lanes<F>::k_count)) {
    const Vec3Lanes<F> o = load_vector<F>(rays.ox, rays.oy, rays.oz, i);
    const Vec3Lanes<F> d = load_vector<F>(rays.dx, rays.dy, rays.dz, i);
    const F length = load_lanes<F>(&rays.tmax[i]);
    const ThesisFound<F> found = look_up_thesis(view, o, d, length >= splat<F>(0.0f));
    if (!any(found.hit)) continue;
    const Mask_t<F> blocks = found.hit & (found.along + splat<F>(view.slack) < length * found.scale);
    const Uint_t<F> before = load_uint_lanes<F>(&hidden[i]);
    store_lanes(select(blocks, splat_uint<F>(1u), before), &hidden[i]);
  }
}

template <class F>
constexpr ThesisKernels make_thesis_kernels() {
  return {&thesis_nearest<F>, &thesis_hide<F>};
}

FT_LANES_END

#endif  // toggled guard
