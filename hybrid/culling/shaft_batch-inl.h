// The loop behind hybrid/culling/shaft_kernels.h. Thread-safety: writes its flags only.

#if defined(FIELDTRACE_HYBRID_CULLING_SHAFT_BATCH_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_HYBRID_CULLING_SHAFT_BATCH_INL_H_
#undef FIELDTRACE_HYBRID_CULLING_SHAFT_BATCH_INL_H_
#else
#define FIELDTRACE_HYBRID_CULLING_SHAFT_BATCH_INL_H_
#endif

#include "hybrid/culling/shaft.hd.h"
#include "hybrid/culling/shaft_kernels.h"

FT_LANES_BEGIN

template <class D>
inline Vec3Lanes<D> splat_doubles(const double (&v)[3]) {
  return {splat_double<D>(v[0]), splat_double<D>(v[1]), splat_double<D>(v[2])};
}

template <class D>
inline void keep_met_by_shafts(const ShaftTask& task, const ShadingPointBatch& points, int32_t* flags) {
  const Vec3Lanes<D> light = splat_doubles<D>(task.light_centre), object = splat_doubles<D>(task.object_centre);
  const D light_radius = splat_double<D>(task.light_radius), object_radius = splat_double<D>(task.object_radius);
  alignas(64) float lower[3][k_batch_padding], upper[3][k_batch_padding], met[k_batch_padding];
  for (size_t first = 0; first < padded(points.size); first += k_batch_padding) {
    int32_t* const f = flags + first;
    int32_t any = 0;
    for (size_t i = 0; i < k_batch_padding; ++i) any |= f[i];
    if (any == 0) continue;
    const float *error = &points.error[first], *radius = &points.radius[first];
    const float* const position[3] = {&points.px[first], &points.py[first], &points.pz[first]};
    for (int a = 0; a < 3; ++a) {
      for (size_t i = 0; i < k_batch_padding; ++i) {
        const float reach = error[i] + radius[i];
        lower[a][i] = position[a][i] - reach, upper[a][i] = position[a][i] + reach;
        const bool overlaps = min(lower[a][i], task.light_lower[a]) <= task.object_upper[a] &&
                              task.object_lower[a] <= max(upper[a][i], task.light_upper[a]);
        f[i] = overlaps ? f[i] : 0;
      }
    }
    any = 0;
    for (size_t i = 0; i < k_batch_padding; ++i) any |= f[i];
    if (any == 0) continue;
    for (size_t i = 0; i < k_batch_padding; i += size_t(DoubleLanes<D>::k_count)) {
      const auto load = [i](const float(&v)[3][k_batch_padding]) -> Vec3Lanes<D> {
        return {load_floats<D>(&v[0][i]), load_floats<D>(&v[1][i]), load_floats<D>(&v[2][i])};
      };
      const auto misses = misses_ball(hull_to_light(load(lower), load(upper), light, light_radius), object,
                                      object_radius, task.rounding);
      store_floats(select(misses, splat_double<D>(0.0), splat_double<D>(1.0)), met + i);
    }
    for (size_t i = 0; i < k_batch_padding; ++i) f[i] = met[i] > 0.0f ? f[i] : 0;
  }
}

FT_LANES_END

#endif  // toggled guard
