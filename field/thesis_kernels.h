// The look-up loops of the thesis' fields, one set per instruction set.
//
// Thread-safety: pure functions over const fields; a batch belongs to one thread.
#pragma once

#include <cstdint>

#include "core/isa.h"
#include "tools/thesis/field_view.h"

namespace fieldtrace {

struct ThesisKernels {
  // Moves `hits` to this instance where its field says that it is nearer. A ray i with skip[i] == view.instance passes
  // through, as does an inactive one. `skip` is padded like the batch.
  void (*nearest)(const ThesisInstanceView& view, const RayBatch& rays, const uint32_t* skip, ThesisHits& hits);
  // Rays run from a light, o, through a receiver at o + tmax d. Sets hidden[i] to 1 where the field says that this
  // instance lies in front of the receiver by more than view.slack; leaves it else. Padded like the batch.
  void (*hide)(const ThesisInstanceView& view, const RayBatch& rays, uint32_t* hidden);
};

// For an instruction set of this processor (resolve_isa).
const ThesisKernels& thesis_kernels(Isa isa);
const ThesisKernels& thesis_kernels_scalar();

}  // namespace fieldtrace
