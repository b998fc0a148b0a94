// Directions sampled from the lobe of a rough metal, many at one surface point, in SIMD lanes.
//
// Directions, weights and densities are bit-identical to those of sample_bsdf() and Frame::to_world() for every
// instruction set. Thread-safety: pure functions; values.
#pragma once

#include <cstdint>

#include "core/material/bsdf.h"
#include "core/math/frame.h"
#include "core/platform/aligned_vector.h"
#include "core/simd/isa.h"

namespace fieldtrace {

struct LobeSamples {
  AlignedVector<float> dx, dy, dz;        // unit, world space
  AlignedVector<float> red, green, blue;  // bsdf * |cos wo| / pdf
  AlignedVector<float> pdf;               // per solid angle; 0: nothing is scattered, other members undefined

  Vec3 direction(size_t i) const { return {dx[i], dy[i], dz[i]}; }
  Rgb weight(size_t i) const { return {red[i], green[i], blue[i]}; }
};

// Whether sample_conductor() supports the material: GGX microfacets of metal, without a mask.
bool samples_in_lanes(const Material& material);

// Fills `out` with samples first ... first + count - 1 of dimension pair 0 of sequence `seed`
// (core/sampling/sobol.hd.h). `wi` is unit, in `frame`, with wi.z > 0. Throws UsageError if this processor cannot run
// `isa`.
void sample_conductor(const Material& material, const Frame& frame, const Vec3& wi, uint32_t seed, uint32_t first,
                      int count, Isa isa, LobeSamples& out);

}  // namespace fieldtrace
