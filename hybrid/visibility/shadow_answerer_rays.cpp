// Single shadow rays: look-ups in fields, baking what they demand, and exact rays for the undecided.
#include <algorithm>

#include "field/bake/bake.h"
#include "hybrid/visibility/device_answers.h"
#include "hybrid/visibility/shadow_workspace.h"

namespace fieldtrace {
namespace {

std::span<const uint32_t> as_indices(const AlignedVector<int32_t>& list, size_t count) {
  return {reinterpret_cast<const uint32_t*>(list.data()), count};
}

// All blocks of a padded batch.
std::span<const uint32_t> all_blocks(size_t size, std::vector<uint32_t>& blocks) {
  blocks.resize(size / k_batch_padding);
  for (size_t i = 0; i < blocks.size(); ++i) blocks[i] = uint32_t(i * k_batch_padding);
  return blocks;
}

}  // namespace

void ShadowAnswerer::bake_unknown(const ShadowInstance& o, const SegmentTask& task, int32_t slot,
                                  const ShadowBatch& batch, Workspace& work, Stats& stats) const {
  const uint32_t shape = scene_.instances[o.cone.segment.instance].shape;
  RayStates& states = work.states;
  for (int round = 0; !states.unknown_blocks.empty(); ++round) {
    BakeCounters counters;
    bool goes_on = false;
    const auto bake = [&](FieldLayer layer, std::vector<uint32_t>& slices) {
      keep_due(settings_.demands, shape, layer, slices);
      goes_on = goes_on || !slices.empty();
      bake_slices(*o.field, layer, slices, accel_, shape, counters);
      slices.clear();
    };
    bake(FieldLayer::visibility, states.unknown_visibility);
    bake(FieldLayer::depth, states.unknown_depth);
    stats.add_bake(counters);
    std::vector<uint32_t> blocks;
    blocks.swap(states.unknown_blocks);
    const bool give_up = !goes_on || o.field->pool_full() || round >= k_most_bake_rounds;
    SegmentCounts again;
    if (give_up) {
      // Without room to bake, or while bakes wait, all rays of such a block are traced.
      for (const uint32_t begin : blocks) {
        again.crossings +=
            kernels_.cross_ball(task, batch.rays, begin, begin + k_batch_padding, slot, states).crossings;
      }
    } else {
      again = query(kernels_, nullptr, task, batch, blocks, slot, states);
    }
    stats.lookups += again.lookups;
    stats.sphere_crossings += again.crossings;
  }
}

// What coverage maps leave undecided about other objects, cells mostly do as well, and they cost far more to bake.
SegmentTask ShadowAnswerer::ray_task(const ShadowInstance& o, const ShadowGroup& group) const {
  SegmentTask task = o.cone.segment;
  task.self_only = group.is_tested && !group.few_samples() && settings_.whole_lights && settings_.tolerance < 1.0f;
  return task;
}

void ShadowAnswerer::classify(const RayRequest& request, Workspace& work) const {
  const auto& [group, batch, stats, counts_open, questions] = request;
  const size_t n = padded(batch.rays.size);
  for (size_t slot = 0; slot < group.candidates.size(); ++slot) {
    const ShadowInstance& o = instances_[group.candidates[slot]];
    SegmentCounts counts;
    if (!o.in_ball) {
      counts = kernels_.cross_box(o.box, batch.rays, batch.instance.data(), 0, n, int32_t(slot), work.states);
    } else if (o.thesis) {
      counts = thesis_kernels_.shadow(*o.thesis, batch.rays, 0, n, int32_t(slot), work.states);
      if (settings_.check) check_answers(o, batch, work, stats);
    } else if (!o.field) {
      counts = kernels_.cross_ball(o.cone.segment, batch.rays, 0, n, int32_t(slot), work.states);
    } else {
      const SegmentTask task = ray_task(o, group);
      const RayQuestion* const question = questions.empty() ? nullptr : &questions[slot];
      counts = query(kernels_, question, task, batch, all_blocks(n, work.blocks), int32_t(slot), work.states);
      bake_unknown(o, task, int32_t(slot), batch, work, stats);
      if (settings_.check) check_answers(o, batch, work, stats);
      if (settings_.count_uses) count_uses(o, batch, work, stats);
    }
    stats.sphere_crossings += counts.crossings;
    stats.lookups += counts.lookups;
  }
}

void ShadowAnswerer::trace(const ShadowGroup& group, ShadowBatch& batch, Workspace& work, Stats& stats) const {
  const auto one = as_indices(work.exact.one_undecided_slot, work.exact.one_count);
  const auto many = as_indices(work.exact.many_undecided_slots, work.exact.many_count);
  stats.rays_exact += one.size() + many.size();
  for (const uint32_t i : one) batch.exact[i] = 1;
  for (const uint32_t i : many) batch.exact[i] = 1;
  accel_.occluded(batch.rays, many, batch.blocked.data());
  if (group.candidates.size() == 1) {
    accel_.occluded_by(group.candidates[0], batch.rays, one, batch.blocked.data());
    return;
  }
  if (one.empty()) return;
  for (size_t slot = 0; slot < group.candidates.size(); ++slot) {
    work.indices.clear();
    for (const uint32_t i : one) {
      if (work.states.undecided_slot[i] == int32_t(slot)) work.indices.push_back(i);
    }
    if (!work.indices.empty())
      accel_.occluded_by(group.candidates[slot], batch.rays, work.indices, batch.blocked.data());
  }
}

void ShadowAnswerer::trace_all(ShadowBatch& batch, Workspace& work, Stats& stats) const {
  work.indices.clear();
  for (size_t i = 0; i < batch.rays.size; ++i) {
    if (batch.rays.tmax[i] < 0.0f) continue;
    work.indices.push_back(uint32_t(i));
    batch.exact[i] = 1;
  }
  stats.rays_crossing += work.indices.size();
  stats.sphere_crossings += work.indices.size();
  stats.rays_exact += work.indices.size();
  stats.rays_candidate_overflow += work.indices.size();
  accel_.occluded(batch.rays, work.indices, batch.blocked.data());
}

}  // namespace fieldtrace
