// The look-up loops of the thesis' fields, one set per instruction set.
//
// Thread-safety: pure functions over const fields; a batch belongs to one thread.
#pragma once

#include <cstdint>

#include "core/simd/isa.h"
#include "core/trace/rays.h"
#include "field/query/segment_kernels.h"
#include "field/thesis/thesis_view.h"

namespace fieldtrace {

// Nearest hits of a batch: t in units of the rays' directions, unit normals. instance k_none: a miss.
struct ThesisHits {
  AlignedVector<float> t, nx, ny, nz;
  AlignedVector<uint32_t> instance;

  void resize(size_t n) {
    for (auto* a : {&t, &nx, &ny, &nz}) a->resize(padded(n));
    instance.resize(padded(n));
  }
};

struct ThesisKernels {
  // Moves `hits` to this instance where its field says that it is nearer. A ray i with skip[i] == view.instance passes
  // through, as does an inactive one. `skip` is padded like the batch.
  void (*nearest)(const ThesisInstanceView& view, const RayBatch& rays, const AlignedVector<uint32_t>& skip,
                  ThesisHits& hits);
  // Rays [begin, end) run from shading points to lights at t = tmax, infinity included; both are multiples of
  // k_batch_padding. They are looked up from the light to the shading point (section 3.2.3). Adds to `states` the rays
  // that this instance blocks: those whose first surface lies between light and shading point, in front of the latter
  // by more than view.slack. No ray is undecided. crossings, lookups: rays that meet the ball in between.
  SegmentCounts (*shadow)(const ThesisInstanceView& view, const RayBatch& rays, size_t begin, size_t end,
                          int32_t candidate_slot, RayStates& states);
};

// For an instruction set of this processor (resolve_isa).
const ThesisKernels& thesis_kernels(Isa isa);
const ThesisKernels& thesis_kernels_scalar();

}  // namespace fieldtrace
