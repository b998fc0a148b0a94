// Scratch memory of one thread of the shadow answerer.
#pragma once

#include <vector>

#include "hybrid/visibility/query_and_bake.h"
#include "hybrid/visibility/shadow_answerer.h"
#include "hybrid/visibility/shadow_instance.h"

namespace fieldtrace {

struct ShadowAnswerer::Workspace {
  RayStates states;
  ExactLists exact;
  std::vector<uint32_t> indices;
  std::vector<uint8_t> exact_blocked;
  AlignedVector<int32_t> flags, refused, refused_by_thin;
  // Of occluders that may overlap: by slot; then of each stratum, the share that the present one leaves clear, the
  // slots that hide it in part, and those of them that may overlap one another.
  std::vector<uint32_t> overlaps;
  AlignedVector<float> clear;
  std::vector<uint32_t> in_part, dependent;
  ConeUnknowns unknowns;
};

}  // namespace fieldtrace
