// The loop over samples behind sample_conductor(), for one lane type. Thread-safety: writes `out` only.

#if defined(FIELDTRACE_CORE_MATERIAL_CONDUCTOR_BATCH_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_CORE_MATERIAL_CONDUCTOR_BATCH_INL_H_
#undef FIELDTRACE_CORE_MATERIAL_CONDUCTOR_BATCH_INL_H_
#else
#define FIELDTRACE_CORE_MATERIAL_CONDUCTOR_BATCH_INL_H_
#endif

#include "core/material/conductor.hd.h"
#include "core/material/conductor_kernels.h"

FT_LANES_BEGIN

template <class F>
FT_HD_INLINE Vec3Lanes<F> splat_vector(const Vec3& v) {
  return {splat<F>(v.x), splat<F>(v.y), splat<F>(v.z)};
}

template <class F>
inline void sample_conductor_batch(const ConductorTask& task, LobeSamples& out) {
  const Material& material = task.material;
  const SobolSeeds<float> seeds = sobol_seeds<float>(task.seed, 0);
  const SobolSeeds<F> points = {splat_uint<F>(seeds.order), splat_uint<F>(seeds.x), splat_uint<F>(seeds.y)};
  const Vec3Lanes<F> wi = splat_vector<F>(task.wi);
  const Vec3Lanes<F> eta = splat_vector<F>(material.eta), k = splat_vector<F>(material.k);
  const Vec3Lanes<F> s = splat_vector<F>(task.frame.s), t = splat_vector<F>(task.frame.t);
  const Vec3Lanes<F> n = splat_vector<F>(task.frame.n), reflectance = splat_vector<F>(material.reflectance);
  const GgxView<F> view = ggx_view(splat<F>(material.microfacet.alpha_u), splat<F>(material.microfacet.alpha_v), wi);
  for (int i = 0; i < task.count; i += Lanes<F>::k_count) {
    const Uint_t<F> index = as_uint(lane_sequence<F>(i)) + splat_uint<F>(task.first);
    const ConductorSample<F> sample = sample_conductor_lobe(view, wi, eta, k, sample_2d<F>(index, points));
    const Vec3Lanes<F> d = s * sample.wo.x + t * sample.wo.y + n * sample.wo.z;
    store_lanes(d.x, &out.dx[size_t(i)]);
    store_lanes(d.y, &out.dy[size_t(i)]);
    store_lanes(d.z, &out.dz[size_t(i)]);
    store_lanes(reflectance.x * sample.weight.x, &out.red[size_t(i)]);
    store_lanes(reflectance.y * sample.weight.y, &out.green[size_t(i)]);
    store_lanes(reflectance.z * sample.weight.z, &out.blue[size_t(i)]);
    store_lanes(sample.pdf, &out.pdf[size_t(i)]);
  }
}

FT_LANES_END

#endif  // toggled guard
