// Whether rays, or all rays from a shading point to a light, can meet an object at all, by its ball or its box.
// Conservative. The loops: field/query/segment_batch-inl.h.
//
// Space: world space, transformed by the tasks. Thread-safety: pure functions.

#if defined(FIELDTRACE_FIELD_QUERY_BOUNDS_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_FIELD_QUERY_BOUNDS_HD_H_
#undef FIELDTRACE_FIELD_QUERY_BOUNDS_HD_H_
#else
#define FIELDTRACE_FIELD_QUERY_BOUNDS_HD_H_
#endif

#include "field/query/query.hd.h"
#include "field/query/query_tasks.h"

FT_LANES_BEGIN

// Clips a ray to a slab, widened by the rounding of the subtraction, the reciprocal and the product (pbrt, section
// 6.8.2: factor 1 + 2 gamma(3)).
template <class F>
FT_HD_INLINE void clip_slab(F o, F d, F lower, F upper, F& enter, F& leave) {
  // A component too small to divide by is replaced by a tiny one of the same sign: the slab is then missed, or met
  // everywhere.
  const F inverse = splat<F>(1.0f) / copysign(max(abs(d), splat<F>(1e-30f)), d);
  const F a = (lower - o) * inverse;
  const F b = (upper - o) * inverse;
  const F widen = splat<F>(1.0f + 2.0f * (3.0f * 0x1p-24f) / (1.0f - 3.0f * 0x1p-24f));
  enter = max(enter, min(a, b));
  leave = min(leave, max(a, b) * widen);
}

// The instance whose own rays pass its box; none unless the task says so.
inline FT_HD uint32_t skipped_instance(const BoxTask& task) { return task.skip_self ? task.instance : 0xfffffffeu; }

// Rays from o along d, up to tmax, that meet the box. `skipped`: they leave the skipped instance.
template <class F>
FT_HD_INLINE Mask_t<F> crosses_box(const BoxTask& task, const Vec3Lanes<F>& o, const Vec3Lanes<F>& d, F tmax,
                                   Mask_t<F> skipped) {
  F enter = splat<F>(0.0f), leave = tmax;
  for (int axis = 0; axis < 3; ++axis) {
    clip_slab(transformed(task.to_object, axis, o) + splat<F>(task.to_object[9 + axis]),
              transformed(task.to_object, axis, d), splat<F>(task.lower[axis]), splat<F>(task.upper[axis]), enter,
              leave);
  }
  return and_not(skipped, (enter <= leave) & (tmax >= splat<F>(0.0f)));
}

// Whether the hull of the ball `radius` about `point` and that of the light about `centre` meets the object's ball.
template <class F>
FT_HD_INLINE Mask_t<F> hull_meets_ball(const SegmentTask& task, const Vec3Lanes<F>& point, F radius,
                                       const Vec3Lanes<F>& centre, F light_radius) {
  const float* m = task.to_unit;
  const F zero = splat<F>(0.0f), one = splat<F>(1.0f), stretch = splat<F>(task.to_unit_stretch);
  const F far = light_radius * stretch, near = radius * stretch;
  const Vec3Lanes<F> p = transformed_point(m, point), axis = transformed_vector(m, centre - point);
  const F length_squared = max(dot(axis, axis), splat<F>(1e-30f));
  // Wherever the hull can touch the ball it is no wider than at t + (1 + radius) / length, that is beyond the axis
  // point nearest to the ball's centre by the ball's reach.
  const F length = sqrt(length_squared);
  const F t = (zero - dot(p, axis)) / length_squared;
  const F t_near = min(max(t, zero), one);
  const F t_far = min(max(t + (one + far) / length, zero), one);
  const Vec3Lanes<F> gap = p + axis * t_near;
  // The added 2^-9 exceeds the rounding of this test many times over.
  const F hull = max(far, near) * t_far + near * (one - t_far);
  const F reach = (one + hull) * splat<F>(1.0f + 0x1p-9f) + (abs(p.x) + abs(p.y) + abs(p.z)) * splat<F>(0x1p-20f);
  return dot(gap, gap) <= reach * reach;
}

// The same for the object's box. The margin covers the light's radius, the shading point's offset from its surface (the
// caller makes the radius no less), and rounding. `skipped`: the points lie on the skipped instance.
template <class F>
FT_HD_INLINE Mask_t<F> hull_meets_box(const BoxTask& task, const Vec3Lanes<F>& point, F radius,
                                      const Vec3Lanes<F>& centre, F light_radius, Mask_t<F> skipped) {
  const float* m = task.to_object;
  const Vec3Lanes<F> to_light = centre - point;
  F enter = splat<F>(0.0f), leave = splat<F>(1.0f);
  const F margin = max(light_radius, radius) * splat<F>(task.to_object_stretch * (1.0f + 0x1p-9f));
  for (int axis = 0; axis < 3; ++axis) {
    const F p = transformed(m, axis, point) + splat<F>(m[9 + axis]);
    const F lower = splat<F>(task.lower[axis]) - margin, upper = splat<F>(task.upper[axis]) + margin;
    clip_slab(p, transformed(m, axis, to_light), lower, upper, enter, leave);
  }
  return and_not(skipped, enter <= leave);
}

FT_LANES_END

#endif  // toggled guard
