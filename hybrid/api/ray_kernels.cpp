// The rays of a chunk for every Highway target.

// clang-format off: foreach_target.h includes this file again for each target and must come first.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "hybrid/api/ray_kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
// clang-format on

#include "core/simd/lanes-inl.h"
#include "hybrid/api/ray_kernels.h"

#if HWY_TARGET != HWY_SCALAR  // the scalar target is served by gather_rays_scalar
FT_LANES_BEGIN

struct BoundsLanes {
  hn::Vec<DF> lower[3], upper[3];

  BoundsLanes() {
    for (int c = 0; c < 3; ++c) lower[c] = hn::Set(DF(), k_infinity), upper[c] = hn::Set(DF(), -k_infinity);
  }
  void extend(int c, hn::Vec<DF> v, hn::Mask<DF> where) {
    lower[c] = hn::Min(lower[c], hn::IfThenElse(where, v, hn::Set(DF(), k_infinity)));
    upper[c] = hn::Max(upper[c], hn::IfThenElse(where, v, hn::Set(DF(), -k_infinity)));
  }
  Bounds3 bounds() const {
    Bounds3 b;
    for (int c = 0; c < 3; ++c) {
      b.lower[c] = hn::GetLane(hn::MinOfLanes(DF(), lower[c]));
      b.upper[c] = hn::GetLane(hn::MaxOfLanes(DF(), upper[c]));
    }
    return b;
  }
};

// Separates the three numbers of `count` elements.
inline void separate(const float* from, size_t stride, size_t count, float* x, float* y, float* z) {
  size_t i = 0;
  if (stride == 3 * sizeof(float)) {
    const size_t lanes = hn::Lanes(DF());
    for (; i + lanes <= count; i += lanes) {
      hn::Vec<DF> a, b, c;
      hn::LoadInterleaved3(DF(), from + 3 * i, a, b, c);
      hn::StoreU(a, DF(), x + i), hn::StoreU(b, DF(), y + i), hn::StoreU(c, DF(), z + i);
    }
  }
  for (; i < count; ++i) {
    const float* const v = reinterpret_cast<const float*>(reinterpret_cast<const char*>(from) + i * stride);
    x[i] = v[0], y[i] = v[1], z[i] = v[2];
  }
}

inline api::RayExtent gather_rays_lanes(const api::RaySource& from, RayBatch& rays) {
  const DF d;
  separate(from.origins, from.origin_stride, rays.size, rays.ox.data(), rays.oy.data(), rays.oz.data());
  separate(from.directions, from.direction_stride, rays.size, rays.dx.data(), rays.dy.data(), rays.dz.data());
  for (size_t i = 0; i < rays.size; ++i) {
    const char* const at = reinterpret_cast<const char*>(from.t_max) + i * from.t_max_stride;
    rays.tmax[i] = from.t_max ? *reinterpret_cast<const float*>(at) : k_infinity;
  }
  const float* const origins[3] = {rays.ox.data(), rays.oy.data(), rays.oz.data()};
  const float* const directions[3] = {rays.dx.data(), rays.dy.data(), rays.dz.data()};
  BoundsLanes starts, ends;
  hn::Vec<DF> bad = hn::Zero(d), far = hn::Zero(d), uneven = hn::Zero(d);  // not 0 where set
  const hn::Vec<DF> least = hn::Set(d, from.usual.least), most = hn::Set(d, from.usual.most);
  const hn::Vec<DF> one = hn::Set(d, 1.0f);
  for (size_t i = 0; i < padded(rays.size); i += hn::Lanes(d)) {
    const hn::Vec<DF> t = hn::Load(d, rays.tmax.data() + i);
    const hn::Mask<DF> active = hn::Ge(t, hn::Zero(d));
    hn::Mask<DF> good = hn::Eq(t, t), finite = good, directed = hn::Ne(t, t);
    hn::Vec<DF> square = hn::Zero(d);
    for (int c = 0; c < 3; ++c) {
      const hn::Vec<DF> o = hn::Load(d, origins[c] + i), v = hn::Load(d, directions[c] + i);
      const hn::Vec<DF> end = hn::Add(o, hn::Mul(t, v));
      good = hn::And(good, hn::And(hn::IsFinite(o), hn::IsFinite(v)));
      square = hn::Add(square, hn::Mul(v, v));
      directed = hn::Or(directed, hn::Ne(v, hn::Zero(d)));
      finite = hn::And(finite, hn::IsFinite(end));
      starts.extend(c, o, active), ends.extend(c, end, active);
    }
    bad = hn::IfThenElse(hn::And(good, directed), bad, one);
    far = hn::IfThenElse(hn::And(active, hn::Not(finite)), one, far);
    const hn::Mask<DF> usual = hn::And(hn::Ge(square, least), hn::Le(square, most));
    uneven = hn::IfThenElse(hn::And(active, hn::Not(usual)), one, uneven);
  }
  api::RayExtent extent;
  extent.origins = starts.bounds(), extent.ends = ends.bounds();
  extent.faulty = !hn::AllTrue(d, hn::Eq(bad, hn::Zero(d)));
  extent.unbounded = !hn::AllTrue(d, hn::Eq(far, hn::Zero(d)));
  extent.uneven = !hn::AllTrue(d, hn::Eq(uneven, hn::Zero(d)));
  return extent;
}

FT_LANES_END
#endif

#if HWY_ONCE
#include <cmath>

#include "core/math/finite.h"
#include "core/simd/isa_dispatch.h"

namespace fieldtrace::api {

RayExtent gather_rays_scalar(const RaySource& from, RayBatch& rays) {
  const auto at = [](const float* data, size_t i, size_t stride) {
    return reinterpret_cast<const float*>(reinterpret_cast<const char*>(data) + i * stride);
  };
  RayExtent extent;
  for (size_t i = 0; i < rays.size; ++i) {
    const float *const p = at(from.origins, i, from.origin_stride), *const v =
                                                                        at(from.directions, i, from.direction_stride);
    const Vec3 o(p[0], p[1], p[2]), d(v[0], v[1], v[2]);
    const float t = from.t_max ? *at(from.t_max, i, from.t_max_stride) : k_infinity;
    rays.set(i, o, d, t);
    if (!is_finite(o) || !is_finite(d) || d == Vec3(0.0f) || std::isnan(t)) extent.faulty = true;
    if (!(t >= 0.0f)) continue;
    const Vec3 end = o + t * d;
    extent.origins.extend(o), extent.ends.extend(end);
    if (!is_finite(end)) extent.unbounded = true;
    if (!from.usual.has(d.x * d.x + d.y * d.y + d.z * d.z)) extent.uneven = true;
  }
  return extent;
}

GatherKernel gather_kernel_for(Isa isa) { FT_RETURN_FORM_FOR(isa, gather_rays_lanes, gather_rays_scalar) }

}  // namespace fieldtrace::api
#endif
