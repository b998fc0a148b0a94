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
  AlignedVector<int32_t> flags, refused;
  ConeUnknowns unknowns;
};

}  // namespace fieldtrace
