// Look-ups in a thesis field: the nearest sample's distance and normal. Written once for a float and a SIMD vector.
//
// Source: A. Andreadis, 2008, algorithms 1 to 7 and section 3.2.3 (shadows). Thread-safety: pure functions.

#if defined(FIELDTRACE_TOOLS_THESIS_LOOK_UP_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_TOOLS_THESIS_LOOK_UP_HD_H_
#undef FIELDTRACE_TOOLS_THESIS_LOOK_UP_HD_H_
#else
#define FIELDTRACE_TOOLS_THESIS_LOOK_UP_HD_H_
#endif

#include "core/lanes.hd.h"
#include "field/chart_thesis.hd.h"
#include "tools/thesis/field_view.h"

FT_LANES_BEGIN

// A ray in an instance's unit space, with what its field says.
template <class F>
struct ThesisFound {
  Mask_t<F> hit;
  F along;          // unit space, from the ray's origin
  F scale;          // unit-space length of the ray's direction: t = along / scale
  Int_t<F> sample;  // 0 where there is no hit
};

// `active`: lanes to look up. A hit lies in front of the origin: the field knows the first surface only, and where that
// lies behind the origin it knows nothing of the rest of the line.
template <class F>
FT_HD_INLINE ThesisFound<F> look_up_thesis(const ThesisInstanceView& view, const Vec3Lanes<F>& o, const Vec3Lanes<F>& d,
                                           Mask_t<F> active) {
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f);
  const float* m = view.to_unit;
  const auto rotated = [&](const Vec3Lanes<F>& v) {
    return Vec3Lanes<F>{splat<F>(m[0]) * v.x + splat<F>(m[3]) * v.y + splat<F>(m[6]) * v.z,
                        splat<F>(m[1]) * v.x + splat<F>(m[4]) * v.y + splat<F>(m[7]) * v.z,
                        splat<F>(m[2]) * v.x + splat<F>(m[5]) * v.y + splat<F>(m[8]) * v.z};
  };
  const Vec3Lanes<F> origin = rotated(o) + Vec3Lanes<F>{splat<F>(m[9]), splat<F>(m[10]), splat<F>(m[11])};
  const Vec3Lanes<F> q = rotated(d);
  ThesisFound<F> found;
  found.scale = sqrt(dot(q, q));
  const Vec3Lanes<F> direction = q * (one / found.scale);
  const ThesisEntry<F> entry = enter_ball(origin, direction);
  const Mask_t<F> crosses = entry.crosses & active & (entry.along + splat<F>(2.0f) > zero);
  found.hit = and_not(crosses, crosses);
  found.along = zero;
  found.sample = splat_int<F>(0);
  if (!any(crosses)) return found;
  // The other lanes look up along the axis: any sample will do.
  const Vec3Lanes<F> up = {zero, zero, one}, down = {zero, zero, -one};
  const Vec3Lanes<F> point = select3(crosses, entry.point, up), inwards = select3(crosses, direction, down);
  const ThesisAddress<F> at = address_of_entry(point, inwards, view.field.directions);
  const Int_t<F> row = at.position * splat_int<F>(view.field.m) + at.v;
  const Int_t<F> sample = row * splat_int<F>(view.field.m) + at.u;
  const Int_t<F> code = gather_bytes(view.field.distance, sample) & splat_int<F>(255);
  const F depth = to_float(code) * splat<F>(2.0f / float(k_thesis_steps));
  found.along = entry.along + depth;
  found.hit = crosses & (code < splat_int<F>(k_thesis_miss)) & (found.along > zero);
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
  const float* m = view.to_normal;
  const Vec3Lanes<F> n = {splat<F>(m[0]) * x + splat<F>(m[3]) * y + splat<F>(m[6]) * z,
                          splat<F>(m[1]) * x + splat<F>(m[4]) * y + splat<F>(m[7]) * z,
                          splat<F>(m[2]) * x + splat<F>(m[5]) * y + splat<F>(m[8]) * z};
  return n * (splat<F>(1.0f) / sqrt(max(dot(n, n), splat<F>(Tiny::k_smallest_normal))));
}

FT_LANES_END

#endif  // toggled guard
