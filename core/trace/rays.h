// Batches of rays and hits as structures of arrays, the form in which all stages exchange them.
//
// Memory layout: each array is cache-line aligned and padded to a multiple of k_batch_padding entries, or longer.
// Entries in [size, padded(size)) hold an inactive ray (tmax < 0), so that SIMD loops need no tail. Thread-safety: a
// value.
#pragma once

#include <cstddef>
#include <cstdint>

#include "core/math/math.h"
#include "core/platform/aligned_vector.h"

namespace fieldtrace {

// Two of the widest SIMD vectors in floats: some loops process pairs.
inline constexpr size_t k_batch_padding = 32;
constexpr size_t padded(size_t n) { return (n + k_batch_padding - 1) / k_batch_padding * k_batch_padding; }

// Rays o + t d with t in [0, tmax], world space; d is not normalised. tmax < 0: inactive.
struct RayBatch {
  size_t size = 0;
  AlignedVector<float> ox, oy, oz, dx, dy, dz, tmax;

  // Never shrinks the arrays; the contents of entries below n are unspecified, padding entries are made inactive.
  void resize(size_t n) {
    size = n;
    for (auto* v : {&ox, &oy, &oz, &dx, &dy, &dz, &tmax}) make_room(*v, padded(n));
    for (size_t i = n; i < padded(n); ++i) {
      ox[i] = oy[i] = oz[i] = dx[i] = dy[i] = 0.0f;
      dz[i] = 1.0f;
      tmax[i] = -1.0f;
    }
  }
  Vec3 origin(size_t i) const { return {ox[i], oy[i], oz[i]}; }
  Vec3 direction(size_t i) const { return {dx[i], dy[i], dz[i]}; }
  void copy(size_t i, const RayBatch& from, size_t j) { set(i, from.origin(j), from.direction(j), from.tmax[j]); }
  void set(size_t i, const Vec3& o, const Vec3& d, float t_max) {
    ox[i] = o.x, oy[i] = o.y, oz[i] = o.z;
    dx[i] = d.x, dy[i] = d.y, dz[i] = d.z;
    tmax[i] = t_max;
  }
};

// The nearest hit of each ray. instance == 0xffffffff: a miss (the other members are then unspecified). (u, v):
// barycentric coordinates of vertices 1 and 2 for triangles; unused for analytic kinds.
struct HitBatch {
  AlignedVector<float> t, u, v;
  AlignedVector<uint32_t> instance, primitive;

  // As RayBatch::resize().
  void resize(size_t n) {
    for (auto* a : {&t, &u, &v}) make_room(*a, padded(n));
    for (auto* a : {&instance, &primitive}) make_room(*a, padded(n));
  }
  void copy(size_t i, const HitBatch& from, size_t j) {
    t[i] = from.t[j], u[i] = from.u[j], v[i] = from.v[j];
    instance[i] = from.instance[j], primitive[i] = from.primitive[j];
  }
};

}  // namespace fieldtrace
