// Merges what a device has answered about one occluder as the CPU's kernels merge their answers, and has these kernels
// answer the blocks that it left.
//
// Thread-safety: pure functions apart from what they write.
#pragma once

#include <bit>
#include <span>

#include "hybrid/visibility/visibility_device.h"

namespace fieldtrace {

// As the functions of the same name in SegmentKernels. `question`: the device's; null, or not answered: none. Its
// answers count for entries that it was asked about alone; flags may have been settled since.
ConeCounts light_cones(const SegmentKernels& kernels, const ConeQuestion* question, const ConeTask& task,
                       const ShadingPointBatch& points, const Sphere& light, std::span<const uint32_t> blocks,
                       int32_t* flags, ConeUnknowns& unknowns);
uint64_t filter_strata(const SegmentKernels& kernels, const StratumQuestion* question, const StratumTask& task,
                       const ShadowBatch& batch, const float* radius, const int32_t* wanted,
                       std::span<const uint32_t> blocks, float* clear, int32_t* refused, ConeUnknowns& unknowns);
// For the rays of all `blocks`, in ascending order.
SegmentCounts query(const SegmentKernels& kernels, const RayQuestion* question, const SegmentTask& task,
                    const ShadowBatch& batch, std::span<const uint32_t> blocks, int32_t candidate_slot,
                    RayStates& states);

uint64_t filter_lobes(const SegmentKernels& kernels, const LobeQuestion* question, const ConeTask& task,
                      const LobeBatch& batch, std::span<const uint32_t> blocks, LobeAnswers& answers,
                      ConeUnknowns& unknowns);

// Asks about a block where any entry is meant.
inline void add_block(DeviceQuestion& question, uint32_t block, uint32_t wanted) {
  if (wanted == 0) return;
  question.blocks.push_back(block);
  question.wanted.push_back(wanted);
}
// The mask of the entries of a block for which `is_wanted(entry)`.
template <class IsWanted>
uint32_t wanted_mask(uint32_t block, const IsWanted& is_wanted) {
  uint32_t mask = 0;
  for (uint32_t lane = 0; lane < k_batch_padding; ++lane) mask |= uint32_t(bool(is_wanted(block + lane))) << lane;
  return mask;
}
// Calls visit(entry) for all entries meant by block i of a question, in order.
template <class Visit>
void for_each_wanted(const DeviceQuestion& question, size_t i, const Visit& visit) {
  for (uint32_t mask = question.wanted[i]; mask != 0; mask &= mask - 1) {
    visit(question.blocks[i] + uint32_t(std::countr_zero(mask)));
  }
}

}  // namespace fieldtrace
