// The shadow ray from a shading point to one sample of a light, for one lane type: what the CPU's loops
// (core/light/light_batch-inl.h) and the GPU's kernel (gpu/kernels.cu) share.
//
// A ray depends on its shading point, its sample's number and the light alone, never on its lane, so that all lane
// types give the same bits. What rays are: light_sampling.h. Thread-safety: pure functions; random samples read the
// table of point sets.

#if defined(FIELDTRACE_CORE_LIGHT_LIGHT_RAY_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_CORE_LIGHT_LIGHT_RAY_HD_H_
#undef FIELDTRACE_CORE_LIGHT_LIGHT_RAY_HD_H_
#else
#define FIELDTRACE_CORE_LIGHT_LIGHT_RAY_HD_H_
#endif

#include "core/light/light_shapes.hd.h"
#include "core/sampling/point_sets.hd.h"
#include "core/sampling/sobol.hd.h"

FT_LANES_BEGIN

// Shading points as their arrays hold them (shading_points.h).
template <class F>
struct ShadingPointInput {
  Vec3Lanes<F> point, normal, shading;
  F error, transmits;  // 1 or 0
  Uint_t<F> seed, sample, instance;
};

template <class F>
struct ShadingPointLanes {
  LightShadingPoint<F> at;
  Vec3Lanes<F> normal;  // geometric
  F slip;               // for shading points that transmit: the origin's offset, to the side of the direction
  SetSequence<F> points;
  SobolSeeds<F> third_seeds;
  Uint_t<F> first_index, instance;

  template <class Op>
  FT_HD_INLINE ShadingPointLanes map(const Op& op) const {
    return {{op(at.origin), op(at.shading), op(at.delta), op(at.transmits)},
            op(normal),
            op(slip),
            {op(points.set), op(points.shift_x), op(points.shift_y)},
            {op(third_seeds.order), op(third_seeds.x), op(third_seeds.y)},
            op(first_index),
            op(instance)};
  }
};

// dimension: of the light's first pair; stream: set_stream(dimension). k_transmits: some shading point of the batch
// transmits.
template <class F, class Kind, bool k_transmits>
FT_HD_INLINE ShadingPointLanes<F> shading_point_lanes(const Light& light, uint32_t dimension, uint32_t stream,
                                                      const LightSampleRange& range, const ShadingPointInput<F>& in) {
  ShadingPointLanes<F> r;
  r.normal = in.normal;
  r.at.shading = in.shading;
  const F reach = abs(in.point.x) + abs(in.point.y) + abs(in.point.z);
  const F offset = in.error * splat<F>(k_offset_error_scale) + reach * splat<F>(k_offset_rounding);
  r.at.transmits = in.transmits;
  if constexpr (k_transmits) {
    const auto opaque = in.transmits == splat<F>(0.0f);
    r.at.origin = in.point + in.normal * select(opaque, offset, splat<F>(0.0f));
    r.slip = select(opaque, splat<F>(0.0f), offset);
  } else {
    r.at.origin = in.point + in.normal * offset;
    r.slip = splat<F>(0.0f);
  }
  r.at.delta = splat<F>(light.error_base) + splat<F>(light.error_slope) * reach;
  r.points = set_sequence<F>(in.seed, stream);
  if constexpr (Kind::k_third_number) {
    r.third_seeds = sobol_seeds<F>(in.seed, dimension + 1);
  } else {
    r.third_seeds = {in.seed, in.seed, in.seed};
  }
  r.first_index = in.sample * splat_uint<F>(uint32_t(range.total)) + splat_uint<F>(uint32_t(range.first));
  r.instance = in.instance;
  return r;
}

// The centre of cell k of the range's grid.
template <class F>
FT_HD_INLINE CentredPair<F> centre_of_cell(const LightSampleRange& range, Uint_t<F> k) {
  return grid_point<F>(k, range.columns, range.total / range.columns);
}

// Sample k of a shading point: its point of the light's square and, where the kind of light takes one, a third number.
template <class F>
struct LightSamplePoint {
  CentredPair<F> point;
  F third;
};
template <class F, class Kind>
FT_HD_INLINE LightSamplePoint<F> light_sample_point(const LightSampleRange& range, const int32_t* point_sets,
                                                    const ShadingPointLanes<F>& r, Uint_t<F> k) {
  const Uint_t<F> index = r.first_index + k;
  F third = splat<F>(0.0f);
  if constexpr (Kind::k_third_number) third = sample_2d<F>(index, r.third_seeds).x;
  return {range.columns > 0 ? centre_of_cell<F>(range, splat_uint<F>(uint32_t(range.first)) + k)
                            : gather_point<F>(point_sets, r.points, index),
          third};
}

template <class F, class Sample>
struct LightRay {
  Sample sample;
  Vec3Lanes<F> origin, d;
  F cos_s;
  Mask_t<F> active;
};

// The ray to the sample at `point` of the light's square (and `third`, for mesh lights).
template <class F, class Kind, bool k_transmits>
FT_HD_INLINE auto light_ray(const Kind& kind, const ShadingPointLanes<F>& r, const typename Kind::Setup& setup,
                            const CentredPair<F>& point, F third) {
  const F zero = splat<F>(0.0f);
  const auto s = kind.sample(r.at, setup, point.x, point.y, third);
  Vec3Lanes<F> origin = r.at.origin, d = s.d;
  const F cos_g = dot(r.normal, d);
  const auto above = (cos_g > zero) & (s.cos_s > zero);
  F height = s.height, cos_s = s.cos_s;
  Mask_t<F> active = above;
  if constexpr (k_transmits) {
    const Vec3Lanes<F> shift = r.normal * copysign(r.slip, cos_g);
    origin = origin + shift;
    if constexpr (Kind::k_finite) d = d - shift;
    if constexpr (Kind::k_surface) height = height + dot(s.normal, shift);
    active = above | (r.at.transmits > zero);
    cos_s = abs(cos_s);
  }
  active = active & (height >= zero);
  return LightRay<F, decltype(kind.sample(r.at, setup, point.x, point.y, third))>{s, origin, d, cos_s, active};
}

// What rays are stored as: inactive ones have tmax < 0, a direction and no weight.
template <class F>
struct StoredRay {
  Vec3Lanes<F> d;
  F tmax, weight, pdf;
};
template <class F, class Kind, class Sample>
FT_HD_INLINE StoredRay<F> stored_ray(const LightRay<F, Sample>& ray, Mask_t<F> active) {
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f);
  const F t_max = splat<F>(Kind::k_finite ? 1.0f : k_no_end);
  return {{select(active, ray.d.x, zero), select(active, ray.d.y, zero), select(active, ray.d.z, one)},
          select(active, t_max, splat<F>(-1.0f)),
          select(active, ray.cos_s * ray.sample.inverse_pdf, zero),
          select(active, ray.sample.pdf, zero)};
}

FT_LANES_END

#endif  // toggled guard
