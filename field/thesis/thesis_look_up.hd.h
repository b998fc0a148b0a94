// Look-ups in a thesis field: the nearest sample's distance and normal. Written once for a float and a SIMD vector.
//
// Source: A. Andreadis, 2008, algorithms 1 to 7 and section 3.2.3 (shadows). Thread-safety: pure functions.

#if defined(FIELDTRACE_FIELD_THESIS_THESIS_LOOK_UP_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_FIELD_THESIS_THESIS_LOOK_UP_HD_H_
#undef FIELDTRACE_FIELD_THESIS_THESIS_LOOK_UP_HD_H_
#else
#define FIELDTRACE_FIELD_THESIS_THESIS_LOOK_UP_HD_H_
#endif

#include "core/simd/lanes.hd.h"
#include "field/query/query.hd.h"
#include "field/thesis/chart_thesis.hd.h"
#include "field/thesis/thesis_view.h"

FT_LANES_BEGIN

// A ray in an instance's unit space.
template <class F>
struct ThesisUnitRay {
  Vec3Lanes<F> origin, direction;  // direction: unit
  F scale;                         // unit-space length of the caller's direction: t = along / scale
};

template <class F>
FT_HD_INLINE ThesisUnitRay<F> thesis_unit_ray(const ThesisInstanceView& view, const Vec3Lanes<F>& o,
                                              const Vec3Lanes<F>& d) {
  const Vec3Lanes<F> q = transformed_vector(view.to_unit, d);
  const F scale = sqrt(dot(q, q));
  return {transformed_point(view.to_unit, o), q * (splat<F>(1.0f) / scale), scale};
}

// The result of a look-up along a line.
template <class F>
struct ThesisFound {
  Mask_t<F> crosses;  // the queried part of the line meets the ball
  Mask_t<F> hit;      // the surface lies within that part
  F along;            // of the surface
  Int_t<F> sample;    // 0 where there is no hit
};

// The first surface along a line whose part from < along < to is queried, in unit space from `origin`. The field knows
// the first surface only: where that lies before `from`, the rest of the line is unknown. `active`: lanes to look up.
template <class F>
FT_HD_INLINE ThesisFound<F> look_up_thesis(const ThesisFieldView& field, const Vec3Lanes<F>& origin,
                                           const Vec3Lanes<F>& direction, F from, F to, Mask_t<F> active) {
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f);
  const ThesisEntry<F> entry = enter_ball(origin, direction);
  ThesisFound<F> found;
  found.crosses = entry.crosses & active & (entry.along + splat<F>(2.0f) > from) & (entry.along < to);
  found.hit = and_not(found.crosses, found.crosses);
  found.along = zero;
  found.sample = splat_int<F>(0);
  if (!any(found.crosses)) return found;
  // The other lanes look up a line along the z axis, whose sample always exists.
  const Vec3Lanes<F> up = {zero, zero, one}, down = {zero, zero, -one};
  const Vec3Lanes<F> point = select3(found.crosses, entry.point, up);
  const ThesisAddress<F> at = address_of_entry(point, select3(found.crosses, direction, down), field.directions);
  const Int_t<F> row = at.position * splat_int<F>(field.m) + at.v;
  const Int_t<F> sample = row * splat_int<F>(field.m) + at.u;
  const Int_t<F> code = gather_bytes(field.distance, sample) & splat_int<F>(255);
  found.along = entry.along + to_float(code) * splat<F>(2.0f / float(k_thesis_steps));
  const Mask_t<F> within = (found.along > from) & (found.along < to);
  found.hit = found.crosses & (code < splat_int<F>(k_thesis_miss)) & within;
  found.sample = select(found.hit, sample, splat_int<F>(0));
  return found;
}

// The stored normal in world space, unit.
template <class F>
FT_HD_INLINE Vec3Lanes<F> thesis_normal(const ThesisInstanceView& view, Int_t<F> sample) {
  const Int_t<F> word = gather_bytes(view.field.normal, sample * splat_int<F>(3));
  const auto component = [](Int_t<F> byte) {
    return to_float((byte & splat_int<F>(255)) - splat_int<F>(k_thesis_normal_zero));
  };
  const F x = component(word), y = component(shift_right<8>(word)), z = component(shift_right<16>(word));
  const Vec3Lanes<F> n = transformed_vector<F>(view.to_normal, {x, y, z});
  return n * (splat<F>(1.0f) / sqrt(max(dot(n, n), splat<F>(Tiny::k_smallest_normal))));
}

FT_LANES_END

#endif  // toggled guard
