// The loops over shading points behind light_irradiance.h, for one lane type. Thread-safety: write their result only.

#if defined(FIELDTRACE_CORE_LIGHT_LIGHT_IRRADIANCE_BATCH_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_CORE_LIGHT_LIGHT_IRRADIANCE_BATCH_INL_H_
#undef FIELDTRACE_CORE_LIGHT_LIGHT_IRRADIANCE_BATCH_INL_H_
#else
#define FIELDTRACE_CORE_LIGHT_LIGHT_IRRADIANCE_BATCH_INL_H_
#endif

#include "core/light/light_irradiance.h"
#include "core/light/light_irradiance.hd.h"

FT_LANES_BEGIN

template <class D>
FT_HD_INLINE Vec3Lanes<D> load_vectors(const float* x, const float* y, const float* z) {
  return {load_floats<D>(x), load_floats<D>(y), load_floats<D>(z)};
}

// `out` has room for the batch and its padding.
template <class D, class Seen>
inline void whole_irradiance_loop(const Seen& light, const ShadingPointBatch& p, float* out) {
  for (size_t i = 0; i < p.size; i += size_t(DoubleLanes<D>::k_count)) {
    const Vec3Lanes<D> point = load_vectors<D>(&p.px[i], &p.py[i], &p.pz[i]);
    const Vec3Lanes<D> geometric = load_vectors<D>(&p.gx[i], &p.gy[i], &p.gz[i]);
    const Vec3Lanes<D> shading = load_vectors<D>(&p.sx[i], &p.sy[i], &p.sz[i]);
    const Vec3Lanes<D> vector = light.vector(point);
    const D value = dot(shading, vector);
    const auto whole = light.above(geometric, point) & light.above(shading, point) &
                       (splat_double<D>(k_no_vector) > vector.x) & (value > splat_double<D>(0.0));
    store_floats(select(whole, value, splat_double<D>(k_no_irradiance)), out + i);
  }
}

template <class D>
inline void whole_irradiance_batch(const Light& light, const ShadingPointBatch& points, float* out) {
  if (light.kind == LightKind::sphere) return whole_irradiance_loop<D>(SphereSeen<D>(light), points, out);
  if (light.kind == LightKind::rectangle) return whole_irradiance_loop<D>(ParallelogramSeen<D>(light), points, out);
  for (size_t i = 0; i < points.size; ++i) out[i] = float(k_no_irradiance);
}

// `out` has room for the batch and its padding; x is k_no_vector where there is no closed form.
template <class D, class Seen>
inline void irradiance_vectors_loop(const Seen& light, const ShadingPointBatch& p, IrradianceVectors& out) {
  float *x = out.x.data(), *y = out.y.data(), *z = out.z.data();
  for (size_t i = 0; i < p.size; i += size_t(DoubleLanes<D>::k_count)) {
    const Vec3Lanes<D> vector = light.vector(load_vectors<D>(&p.px[i], &p.py[i], &p.pz[i]));
    store_floats(vector.x, x + i);
    store_floats(vector.y, y + i);
    store_floats(vector.z, z + i);
  }
}

// For the kinds of light that have a closed form.
template <class D>
inline void irradiance_vectors_batch(const Light& light, const ShadingPointBatch& points, IrradianceVectors& out) {
  if (light.kind == LightKind::sphere) return irradiance_vectors_loop<D>(SphereSeen<D>(light), points, out);
  if (light.kind == LightKind::disk) return irradiance_vectors_loop<D>(DiskSeen<D>(light), points, out);
  irradiance_vectors_loop<D>(ParallelogramSeen<D>(light), points, out);
}

FT_LANES_END

#endif  // toggled guard
