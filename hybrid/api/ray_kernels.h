// Rays of the caller, an array of structures, made into a RayBatch; and what is to be known of them: one variant per
// instruction set. Thread-safety: pure functions.
#pragma once

#include "core/math/math.h"
#include "core/simd/isa.h"
#include "core/trace/rays.h"

namespace fieldtrace::api {

// Squared lengths of directions that may go to Embree as they are, in the space of every shape.
struct UsualSquares {
  float least = 0.0f, most = k_infinity;
  bool has(float square) const { return square >= least && square <= most; }
};

// Strides are the bytes from one ray to the next. t_max null: infinite.
struct RaySource {
  const float* origins;
  size_t origin_stride;
  const float* directions;
  size_t direction_stride;
  const float* t_max;
  size_t t_max_stride;
  UsualSquares usual;
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
