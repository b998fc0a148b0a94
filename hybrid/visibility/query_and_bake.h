// Queries fields for a batch, and bakes what the answers need until all are known.
//
// Thread-safety: that of the callbacks.
#pragma once

#include <algorithm>
#include <memory>
#include <span>
#include <vector>

#include "core/trace/rays.h"
#include "field/bake/slice_demand.h"
#include "field/query/segment_kernels.h"

namespace fieldtrace {

// How many rounds of baking one batch can need: the line's cell, the anchored cell, the re-anchored one, and the last
// two again from the other end of the segment; for nearest hits also the primitive's. Lobes and strata need fewer:
// tiles, and two rounds for discs. Whole lights need two for each direction from a surface, one direction after
// another.
inline constexpr int k_most_bake_rounds = 6;

// One entry a ray in `list`; leaves what is to be baked, sorted, without repeats.
inline void sort_unique(std::vector<uint32_t>& list) {
  std::sort(list.begin(), list.end());
  list.erase(std::unique(list.begin(), list.end()), list.end());
}

// Bakes by shape that wait until they are due; empty: none does.
using SliceDemands = std::span<const std::unique_ptr<SliceDemand>>;

// sort_unique() of the slices that are due. One entry a ray.
inline void keep_due(SliceDemands demands, uint32_t shape, FieldLayer layer, std::vector<uint32_t>& slices) {
  if (demands.empty()) {
    sort_unique(slices);
  } else {
    demands[shape]->count(layer, slices);
  }
}

// Calls query(blocks) for all blocks of k_batch_padding among `size` entries, and again for those that it put into
// unknowns.blocks, after bake() has baked what it reported there (unknowns.lists(), an entry each time). Ends when
// nothing is unknown, after the round in which bake() returned false, or after `most_rounds` of baking, which must be
// at least the longest chain of cells that one answer needs. Blocks still unknown then stay in unknowns.blocks.
// Unknowns: ConeUnknowns or HitUnknowns.
template <class Unknowns, class Query, class Bake>
void query_and_bake(size_t size, Unknowns& unknowns, const Query& query, const Bake& bake,
                    int most_rounds = k_most_bake_rounds) {
  for (std::vector<uint32_t>* list : unknowns.lists()) list->clear();
  unknowns.blocks.clear();
  for (size_t i = 0; i < size; i += k_batch_padding) unknowns.blocks.push_back(uint32_t(i));
  std::vector<uint32_t> blocks;
  bool goes_on = true;
  for (int round = 0; !unknowns.blocks.empty() && goes_on && round <= most_rounds; ++round) {
    blocks.swap(unknowns.blocks);
    unknowns.blocks.clear();
    query(blocks);
    if (unknowns.blocks.empty()) break;
    goes_on = bake();
    for (std::vector<uint32_t>* list : unknowns.lists()) list->clear();
  }
}

}  // namespace fieldtrace
