// Rays of the caller, an array of structures, made into a RayBatch; and what is to be known of them: one variant per
// instruction set. Thread-safety: pure functions.
#pragma once

#include "core/math/math.h"
#include "core/simd/isa.h"
#include "core/trace/rays.h"

namespace fieldtrace::api {

inline constexpr float k_most_square = 0x1p36f, k_least_square = 0x1p-36f;  // scene_limits.h: k_longest_direction
// Whether a direction of this squared length may go to Embree as it is, in the space of any shape.
inline bool is_usual_square(float square) { return square >= k_least_square && square <= k_most_square; }

// Strides are the bytes from one ray to the next. t_max null: infinite.
struct RaySource {
  const float* origins;
  size_t origin_stride;
  const float* directions;
  size_t direction_stride;
  const float* t_max;
  size_t t_max_stride;
};

// Of the rays with t_max >= 0, but for `faulty`.
struct RayExtent {
  Bounds3 origins;         // empty: there are none
  Bounds3 ends;            // of the points at t_max, as computed; unless unbounded
  bool unbounded = false;  // some point at t_max is not finite
  bool uneven = false;     // the square of some direction's length is not usual
  bool faulty = false;     // some ray has numbers that are not finite, no direction, or NaN as t_max
};

// Copies rays [0, rays.size) of the source to `rays`.
using GatherKernel = RayExtent (*)(const RaySource& from, RayBatch& rays);

// `isa` must be resolved: supported by this processor, not `automatic`.
GatherKernel gather_kernel_for(Isa isa);

RayExtent gather_rays_scalar(const RaySource& from, RayBatch& rays);

}  // namespace fieldtrace::api
