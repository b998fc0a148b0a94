// Scratch memory of one thread of the shadow answerer.
#pragma once

#include <array>
#include <vector>

#include "hybrid/visibility/query_and_bake.h"
#include "hybrid/visibility/shadow_answerer.h"
#include "hybrid/visibility/shadow_instance.h"

namespace fieldtrace {

struct ShadowAnswerer::Workspace {
  RayStates states;
  ExactLists exact;
  std::vector<uint32_t> indices, blocks;
  std::vector<uint8_t> exact_blocked;
  AlignedVector<int32_t> flags, before, refused;
  // Of each stratum: the share that the present occluder leaves clear, its cluster's radius, the slots of occluders
  // that hide it in part, and whether those depend on one another.
  AlignedVector<float> clear, radius;
  std::vector<std::array<uint32_t, 2>> partial;
  std::vector<uint8_t> dependent;
  std::vector<uint32_t> place;  // of shading points among those that are filtered
  ConeUnknowns unknowns;
};

}  // namespace fieldtrace
