// Camera rays in lanes: filter importance sampling, pinhole and thin lens (see core/camera/camera.h for the
// conventions). Thread-safety: pure functions.

#if defined(FIELDTRACE_CORE_CAMERA_CAMERA_RAYS_HD_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef FIELDTRACE_CORE_CAMERA_CAMERA_RAYS_HD_H_
#undef FIELDTRACE_CORE_CAMERA_CAMERA_RAYS_HD_H_
#else
#define FIELDTRACE_CORE_CAMERA_CAMERA_RAYS_HD_H_
#endif

#include "core/sampling/warp.hd.h"
#include "core/scene/camera_lens.h"

FT_LANES_BEGIN

// Offset from the pixel centre along one axis, in pixels, distributed as the filter. u in [0, 1).
template <class F>
FT_HD_INLINE F filter_offset(const CameraLens& lens, F u) {
  const F one = splat<F>(1.0f);
  const F centred = splat<F>(2.0f) * u - one;  // exact: u is a multiple of 2^-24
  const F r = splat<F>(lens.filter_radius);
  if (lens.filter == FilterKind::box) return r * centred;
  if (lens.filter == FilterKind::tent) return copysign(r * (one - sqrt(one - abs(centred))), centred);
  const F position = abs(centred) * splat<F>(float(lens.gaussian_steps));
  const Int_t<F> k = min(to_int(position), splat_int<F>(lens.gaussian_steps - 1));
  const F f = position - to_float(k);
  const F low = gather(lens.gaussian, k), high = gather(lens.gaussian, k + splat_int<F>(1));
  return copysign((one - f) * low + f * high, centred);
}

template <class F>
struct CameraRayLanes {
  Vec3Lanes<F> origin, direction;
  F tmax, near_distance;
};

template <class F>
FT_HD_INLINE Vec3Lanes<F> normalized(const Vec3Lanes<F>& v) {
  return v * (splat<F>(1.0f) / sqrt(dot(v, v)));
}

// The ray through film position (x, y) in pixels.
template <class F>
FT_HD_INLINE CameraRayLanes<F> camera_ray(const CameraLens& c, F x, F y, F u_lens, F v_lens) {
  const F one = splat<F>(1.0f), two = splat<F>(2.0f), zero = splat<F>(0.0f);
  const F fx = x / splat<F>(c.width) + splat<F>(c.principal_offset[0]);
  const F fy = y / splat<F>(c.height) + splat<F>(c.principal_offset[1]);
  Vec3Lanes<F> d = {(one - two * fx) * splat<F>(c.tan_x), (one - two * fy) * splat<F>(c.tan_y), one};
  Vec3Lanes<F> lens = {zero, zero, zero};
  if (c.aperture_radius > 0.0f) {
    const DiskPoint<F> disk = concentric_disk<F>(u_lens, v_lens);
    const F radius = disk.radius * splat<F>(c.aperture_radius);
    lens = {disk.cosine * radius, disk.sine * radius, zero};
    d = d * splat<F>(c.focus_distance) - lens;
  }
  d = normalized(d);
  const F near_t = splat<F>(c.near_clip) / d.z;
  const auto column = [&](int i) {
    return Vec3Lanes<F>{splat<F>(c.to_world[i][0]), splat<F>(c.to_world[i][1]), splat<F>(c.to_world[i][2])};
  };
  const auto to_world = [&](const Vec3Lanes<F>& v) { return column(0) * v.x + column(1) * v.y + column(2) * v.z; };
  CameraRayLanes<F> ray;
  ray.origin = to_world(lens + d * near_t) + column(3);
  ray.direction = normalized(to_world(d));
  ray.near_distance = near_t * splat<F>(c.scale);
  ray.tmax = (splat<F>(c.far_clip) / d.z - near_t) * splat<F>(c.scale);
  return ray;
}

FT_LANES_END

#endif  // toggled guard
