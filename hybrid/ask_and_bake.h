// Asking fields about blocks of a batch until all that the answers need is baked.
//
// Thread-safety: as that of what is called.
#pragma once

#include <algorithm>
#include <vector>

#include "core/rays.h"
#include "field/segment_kernels.h"

namespace fieldtrace {

// How many rounds of baking one batch can need: the line's cell, the anchored cell, the re-anchored one, and the last
// two again from the other end of the segment. Cones and lobes need fewer: tiles, and two for sheets or discs.
inline constexpr int k_most_bake_rounds = 6;

inline void sort_unique(std::vector<uint32_t>& list) {
  std::sort(list.begin(), list.end());
  list.erase(std::unique(list.begin(), list.end()), list.end());
}

// Calls ask(blocks) for all blocks of k_batch_padding among `size` entries, and again for those that it put into
// unknowns.blocks, after bake() has baked the tiles and slices (sorted, once each) that it reported beside them. Ends
// when nothing is unknown, or with the round in which bake() returned false. Blocks still unknown then stay in
// unknowns.blocks.
template <class Ask, class Bake>
void ask_and_bake(size_t size, ConeUnknowns& unknowns, const Ask& ask, const Bake& bake) {
  unknowns.tiles.clear();
  unknowns.slices.clear();
  unknowns.blocks.clear();
  for (size_t i = 0; i < size; i += k_batch_padding) unknowns.blocks.push_back(uint32_t(i));
  std::vector<uint32_t> blocks;
  bool goes_on = true;
  for (int round = 0; !unknowns.blocks.empty() && goes_on && round <= k_most_bake_rounds; ++round) {
    blocks.swap(unknowns.blocks);
    unknowns.blocks.clear();
    ask(blocks);
    if (unknowns.blocks.empty()) break;
    sort_unique(unknowns.tiles);
    sort_unique(unknowns.slices);
    goes_on = bake();
    unknowns.tiles.clear();
    unknowns.slices.clear();
  }
}

}  // namespace fieldtrace
