#include "hybrid/visibility/device_answers.h"

#include "field/query/query.hd.h"
#include "field/query/states.hd.h"

namespace fieldtrace {
namespace {

bool has_lane(uint32_t mask, uint32_t lane) { return (mask >> lane & 1u) != 0; }

// Calls merge(block, index) for those of `blocks` that the device answered, by their index in the question, adding
// their look-ups to `lookups`. Returns the others.
template <class Question, class Merge>
std::vector<uint32_t> merge_blocks(const Question& question, std::span<const uint32_t> blocks, uint64_t& lookups,
                                   const Merge& merge) {
  std::vector<uint32_t> left;
  size_t i = 0;
  for (const uint32_t block : blocks) {
    while (i < question.blocks.size() && question.blocks[i] < block) ++i;
    if (i == question.blocks.size() || question.blocks[i] != block || question.masks[i].not_baked != 0) {
      left.push_back(block);
      continue;
    }
    lookups += question.masks[i].lookups;
    merge(block, i);
  }
  return left;
}

void merge_rays(const RayMasks& m, uint32_t block, int32_t candidate_slot, RayStates& states) {
  for (uint32_t lane = 0; lane < k_batch_padding; ++lane) {
    const uint32_t i = block + lane;
    const bool crosses = has_lane(m.crosses, lane), blocked = has_lane(m.blocked, lane);
    const bool undecided = has_lane(m.undecided, lane);
    if (states.keep_verdicts) {
      states.verdict[i] = !crosses    ? scalar::k_verdict_none
                          : blocked   ? scalar::k_verdict_blocked
                          : undecided ? scalar::k_verdict_undecided
                                      : scalar::k_verdict_clear;
    }
    if (!crosses) continue;
    states.state[i] = scalar::updated_state<float>(states.state[i], crosses, blocked, undecided);
    if (undecided) states.undecided_slot[i] = candidate_slot;
  }
}

}  // namespace

ConeCounts light_cones(const SegmentKernels& kernels, const ConeQuestion* question, const ConeTask& task,
                       const ShadingPointBatch& points, const Sphere& light, std::span<const uint32_t> blocks,
                       int32_t* flags, ConeUnknowns& unknowns) {
  if (!question || !question->is_answered) return kernels.light_cones(task, points, light, blocks, flags, unknowns);
  ConeCounts counts;
  const std::vector<uint32_t> left = merge_blocks(*question, blocks, counts.lookups, [&](uint32_t block, size_t i) {
    const ConeMasks& m = question->masks[i];
    for (uint32_t lane = 0; lane < k_batch_padding; ++lane) {
      int32_t& flag = flags[block + lane];
      if ((flag & k_may_shadow) == 0) continue;
      const bool clear = has_lane(m.clear, lane), blocked = has_lane(m.blocked, lane);
      counts.clear += clear;
      counts.blocked += blocked;
      flag = scalar::updated_flag<float>(flag, clear, blocked, has_lane(m.by_strata, lane));
    }
  });
  const ConeCounts rest = kernels.light_cones(task, points, light, left, flags, unknowns);
  return {counts.clear + rest.clear, counts.blocked + rest.blocked, counts.lookups + rest.lookups};
}

uint64_t filter_strata(const SegmentKernels& kernels, const StratumQuestion* question, const StratumTask& task,
                       const ShadowBatch& batch, const float* radius, const int32_t* wanted,
                       std::span<const uint32_t> blocks, float* clear, int32_t* refused, ConeUnknowns& unknowns) {
  const auto by_cpu = [&](std::span<const uint32_t> of) {
    return kernels.filter_strata(task, batch.rays, batch.pdf.data(), radius, wanted, of, clear, refused, unknowns);
  };
  if (!question || !question->is_answered) return by_cpu(blocks);
  uint64_t lookups = 0;
  const std::vector<uint32_t> left = merge_blocks(*question, blocks, lookups, [&](uint32_t block, size_t i) {
    for (uint32_t lane = 0; lane < k_batch_padding; ++lane) {
      clear[block + lane] *= question->clear[i * k_batch_padding + lane];
      if (has_lane(question->masks[i].refused, lane)) refused[block + lane] = 1;
    }
  });
  return lookups + by_cpu(left);
}

uint64_t filter_lobes(const SegmentKernels& kernels, const LobeQuestion* question, const ConeTask& task,
                      const LobeBatch& batch, std::span<const uint32_t> blocks, LobeAnswers& answers,
                      ConeUnknowns& unknowns) {
  if (!question || !question->is_answered) return kernels.filter_lobes(task, batch, blocks, answers, unknowns);
  AlignedVector<float>* const to[k_lobe_values] = {&answers.clear, &answers.red, &answers.green, &answers.blue,
                                                   &answers.distance};
  const size_t entries = question->blocks.size() * k_batch_padding;
  uint64_t lookups = 0;
  const std::vector<uint32_t> left = merge_blocks(*question, blocks, lookups, [&](uint32_t block, size_t i) {
    for (size_t v = 0; v < k_lobe_values; ++v) {
      std::copy_n(&question->values[v * entries + i * k_batch_padding], k_batch_padding, &(*to[v])[block]);
    }
    for (uint32_t lane = 0; lane < k_batch_padding; ++lane) {
      answers.refused[block + lane] = has_lane(question->masks[i].refused, lane);
    }
  });
  return lookups + kernels.filter_lobes(task, batch, left, answers, unknowns);
}

SegmentCounts query(const SegmentKernels& kernels, const RayQuestion* question, const SegmentTask& task,
                    const ShadowBatch& batch, std::span<const uint32_t> blocks, int32_t candidate_slot,
                    RayStates& states) {
  SegmentCounts counts;
  std::vector<uint32_t> left;
  if (question && question->is_answered) {
    left = merge_blocks(*question, blocks, counts.lookups, [&](uint32_t block, size_t i) {
      counts.crossings += uint64_t(std::popcount(question->masks[i].crosses));
      merge_rays(question->masks[i], block, candidate_slot, states);
    });
    blocks = left;
  }
  for (size_t i = 0, next = 0; i < blocks.size(); i = next) {
    for (next = i + 1; next < blocks.size() && blocks[next] == blocks[next - 1] + k_batch_padding;) ++next;
    const SegmentCounts run = kernels.query(task, batch.rays, batch.instance.data(), blocks[i],
                                            blocks[next - 1] + k_batch_padding, candidate_slot, states);
    counts.crossings += run.crossings;
    counts.lookups += run.lookups;
  }
  return counts;
}

}  // namespace fieldtrace
