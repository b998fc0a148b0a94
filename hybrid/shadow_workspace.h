// What a thread of the shadow answerer works in, and the baking that its parts have in common.
#pragma once

#include <algorithm>
#include <vector>

#include "hybrid/occluder.h"
#include "hybrid/shadow_answerer.h"

namespace fieldtrace {

// How many rounds of baking one batch can need: the line's cell, the anchored cell, the re-anchored one, and the last
// two again from the other end of the segment. Cones need fewer: tiles, and two for sheets.
inline constexpr int k_most_bake_rounds = 6;

inline void sort_unique(std::vector<uint32_t>& list) {
  std::sort(list.begin(), list.end());
  list.erase(std::unique(list.begin(), list.end()), list.end());
}

struct ShadowAnswerer::Workspace {
  RayStates states;
  ExactLists exact;
  std::vector<uint32_t> indices;
  std::vector<uint8_t> exact_blocked;
  AlignedVector<int32_t> flags, refused;
  ConeUnknowns unknowns;
};

}  // namespace fieldtrace
