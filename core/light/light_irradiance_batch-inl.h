// The loop over shading points behind whole_irradiance(), for one lane type. Thread-safety: writes its result only.

#if defined(FIELDTRACE_CORE_LIGHT_LIGHT_IRRADIANCE_BATCH_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_CORE_LIGHT_LIGHT_IRRADIANCE_BATCH_INL_H_
#undef FIELDTRACE_CORE_LIGHT_LIGHT_IRRADIANCE_BATCH_INL_H_
#else
#define FIELDTRACE_CORE_LIGHT_LIGHT_IRRADIANCE_BATCH_INL_H_
#endif

#include "core/light/light_irradiance.hd.h"
#include "core/light/shading_points.h"

FT_LANES_BEGIN

// `out` has room for the batch and its padding.
template <class D>
inline void whole_irradiance_batch(const Light& light, const ShadingPointBatch& points, float* out) {
  for (size_t i = 0; i < points.size; i += size_t(DoubleLanes<D>::k_count)) {
    const auto load = [i](const AlignedVector<float>& x, const AlignedVector<float>& y, const AlignedVector<float>& z) {
      return Vec3Lanes<D>{load_floats<D>(&x[i]), load_floats<D>(&y[i]), load_floats<D>(&z[i])};
    };
    const LitSurface<D> surface = {load(points.px, points.py, points.pz), load(points.gx, points.gy, points.gz),
                                   load(points.sx, points.sy, points.sz)};
    D irradiance = splat_double<D>(k_no_irradiance);
    if (light.kind == LightKind::sphere) irradiance = irradiance_of_sphere(light, surface);
    if (light.kind == LightKind::rectangle) irradiance = irradiance_of_rectangle(light, surface);
    store_floats(irradiance, out + i);
  }
}

FT_LANES_END

#endif  // toggled guard
