// What is counted beside the answers: their agreement with exact rays, and the uses of each field.
#include "field/query/query.hd.h"
#include "hybrid/visibility/shadow_workspace.h"

namespace fieldtrace {
namespace {

CheckedVerdict checked_verdict(bool blocked) { return blocked ? CheckedVerdict::blocked : CheckedVerdict::clear; }

}  // namespace

void ShadowAnswerer::check_whole(const ShadowGroup& group, bool blocked, const ShadowBatch& batch, Stats& stats) const {
  Workspace& work = *workspaces_.local();
  std::vector<uint8_t> hidden(batch.rays.size, 0), asked(batch.rays.size, 0);
  for (const uint32_t candidate : group.candidates) {
    const Occluder& o = occluders_[candidate];
    if (!o.answers_cones) continue;
    work.states.keep_verdicts = false;
    work.states.reset(batch.rays.size);
    kernels_.cross_ball(o.cone.segment, batch.rays, 0, padded(batch.rays.size), 0, work.states);
    work.indices.clear();
    for (uint32_t i = 0; i < batch.rays.size; ++i) {
      if (work.states.state[i] & RayStates::k_crosses) work.indices.push_back(i);
    }
    for (const uint32_t i : work.indices) asked[i] = 1;
    accel_.occluded_by(candidate, batch.rays, work.indices, hidden.data());
  }
  for (size_t i = 0; i < batch.rays.size; ++i) {
    if (!asked[i]) continue;
    const bool wrong = blocked != (hidden[i] != 0);
    const bool own = occluders_[batch.instance[i]].answers_cones;
    stats.add_check(checked_verdict(blocked), own, wrong);
  }
}

void ShadowAnswerer::check_answers(const Occluder& o, const ShadowBatch& batch, Workspace& work, Stats& stats) const {
  const auto& verdict = work.states.verdict;
  work.indices.clear();
  for (size_t i = 0; i < batch.rays.size; ++i) {
    if (verdict[i] == scalar::k_verdict_clear || verdict[i] == scalar::k_verdict_blocked) {
      work.indices.push_back(uint32_t(i));
    }
  }
  work.exact_blocked.assign(batch.rays.size, 0);
  accel_.occluded_by(o.cone.segment.instance, batch.rays, work.indices, work.exact_blocked.data());
  for (const uint32_t i : work.indices) {
    const bool blocked = verdict[i] == scalar::k_verdict_blocked;
    const bool own = batch.instance[i] == o.cone.segment.instance;
    const bool wrong = blocked != (work.exact_blocked[i] != 0);
    stats.add_check(checked_verdict(blocked), own, wrong);
  }
}

FieldUse& ShadowAnswerer::use_of(const Occluder& o, Stats& stats) const {
  stats.field_uses.resize(scene_.shapes.size());
  return stats.field_uses[scene_.instances[o.cone.segment.instance].shape];
}

void ShadowAnswerer::count_uses(const Occluder& o, const ShadowBatch& batch, const Workspace& work,
                                Stats& stats) const {
  FieldUse& use = use_of(o, stats);
  for (size_t i = 0; i < batch.rays.size; ++i) {
    const int32_t verdict = work.states.verdict[i];
    const bool own = batch.instance[i] == o.cone.segment.instance;
    const bool asked = verdict == scalar::k_verdict_ask;
    const bool answered = verdict == scalar::k_verdict_clear || verdict == scalar::k_verdict_blocked;
    use.asked += asked;
    use.answered += answered;
    use.own_asked += own && asked;
    use.own_answered += own && answered;
  }
}

void ShadowAnswerer::count_filtered(const ShadowGroup& group, uint32_t receiver, Stats& stats) const {
  if (!settings_.count_uses) return;
  for (size_t slot = 0; slot < group.candidates.size(); ++slot) {
    if (!(group.by_leaves[receiver] >> slot & 1)) continue;
    use_of(occluders_[group.candidates[slot]], stats).answered += uint64_t(group.light_samples);
  }
}

void ShadowAnswerer::count_extrapolated(const ShadowGroup& group, uint32_t fields, uint32_t instance, uint64_t answered,
                                        uint64_t asked, Stats& stats) const {
  if (!settings_.count_uses) return;
  for (size_t slot = 0; slot < group.candidates.size(); ++slot) {
    if (!(fields >> slot & 1)) continue;
    FieldUse& use = use_of(occluders_[group.candidates[slot]], stats);
    const bool own = group.candidates[slot] == instance;
    use.answered += answered;
    use.asked += asked;
    use.own_answered += own ? answered : 0;
    use.own_asked += own ? asked : 0;
  }
}

}  // namespace fieldtrace
