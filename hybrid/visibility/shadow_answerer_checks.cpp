// Counts beside the answers: their agreement with exact rays, and the uses of each field.
#include <cmath>

#include "field/query/query.hd.h"
#include "hybrid/visibility/shadow_workspace.h"

namespace fieldtrace {
namespace {

CheckedVerdict checked_verdict(bool blocked) { return blocked ? CheckedVerdict::blocked : CheckedVerdict::clear; }

}  // namespace

void ShadowAnswerer::check_whole(const ShadowGroup& group, bool blocked, std::span<const uint32_t> shading_points,
                                 int samples, const ShadowBatch& batch, Stats& stats) const {
  Workspace& work = workspace();
  std::vector<uint8_t> hidden(batch.rays.size, 0), crosses(batch.rays.size, 0), crosses_self(batch.rays.size, 0);
  for (const uint32_t candidate : group.candidates) {
    const ShadowInstance& o = instances_[candidate];
    if (!o.answers_cones) continue;
    work.states.keep_verdicts = false;
    work.states.reset(batch.rays.size);
    kernels_.cross_ball(o.cone.segment, batch.rays, 0, padded(batch.rays.size), 0, work.states);
    work.indices.clear();
    for (uint32_t i = 0; i < batch.rays.size; ++i) {
      if (work.states.state[i] & RayStates::k_crosses) work.indices.push_back(i);
    }
    for (const uint32_t i : work.indices) {
      crosses[i] = 1;
      crosses_self[i] |= candidate == batch.instance[i];
    }
    accel_.occluded_by(candidate, batch.rays, work.indices, hidden.data());
  }
  for (size_t i = 0; i < batch.rays.size; ++i) {
    if (!crosses[i]) continue;
    const bool wrong = blocked != (hidden[i] != 0);
    const uint32_t shading_point = shading_points[i / size_t(samples)];
    const bool self = blocked ? group.blocked_by[shading_point] == batch.instance[i] : crosses_self[i] != 0;
    stats.add_check(checked_verdict(blocked), CheckedBundle::cluster, self, wrong);
  }
}

void ShadowAnswerer::check_answers(const ShadowInstance& o, const ShadowBatch& batch, Workspace& work,
                                   Stats& stats) const {
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
    const bool self = batch.instance[i] == o.cone.segment.instance;
    const bool wrong = blocked != (work.exact_blocked[i] != 0);
    stats.add_check(checked_verdict(blocked), CheckedBundle::cell, self, wrong);
  }
}

void ShadowAnswerer::check_shares(const ShadowGroup& group, int rays, const ShadowBatch& batch,
                                  std::span<const float> shares, Stats& stats) const {
  Workspace& work = workspace();
  std::vector<uint8_t> hidden(batch.rays.size, 0);
  work.indices.clear();
  for (uint32_t i = 0; i < batch.rays.size; ++i) {
    if (batch.rays.tmax[i] >= 0.0f && shares[i / size_t(rays)] >= 0.0f) work.indices.push_back(i);
  }
  for (const ShadowGroup::OpenCandidate& open : group.open) {
    accel_.occluded_by(group.candidates[open.slot], batch.rays, work.indices, hidden.data());
  }
  for (size_t s = 0; s < shares.size(); ++s) {
    int active = 0, clear = 0;
    for (size_t i = s * size_t(rays); i < (s + 1) * size_t(rays); ++i) {
      active += batch.rays.tmax[i] >= 0.0f;
      clear += batch.rays.tmax[i] >= 0.0f && !hidden[i];
    }
    if (shares[s] < 0.0f || active < rays) continue;
    stats.checked(CheckedEstimate::strata).add(double(shares[s]) - double(clear) / double(active));
  }
}

FieldUse& ShadowAnswerer::use_of(const ShadowInstance& o, Stats& stats) const {
  stats.field_uses.resize(scene_.shapes.size());
  return stats.field_uses[scene_.instances[o.cone.segment.instance].shape];
}

// Candidates that no shading point was tested against may be met by all of their rays.
void ShadowAnswerer::count_untested(const ShadingPointBatch& shading_points, const ShadowGroup& group,
                                    Stats& stats) const {
  for (const uint32_t candidate : group.candidates) {
    FieldUse& use = use_of(instances_[candidate], stats);
    for (size_t r = 0; r < shading_points.size; ++r) {
      use.add_met(group.light_samples[r], shading_points.instance[r] == candidate);
    }
  }
}

void ShadowAnswerer::count_uses(const ShadowInstance& o, const ShadowBatch& batch, const Workspace& work,
                                Stats& stats) const {
  FieldUse& use = use_of(o, stats);
  for (size_t i = 0; i < batch.rays.size; ++i) {
    const int32_t verdict = work.states.verdict[i];
    const bool self = batch.instance[i] == o.cone.segment.instance;
    const bool undecided = verdict == scalar::k_verdict_undecided;
    const bool answered = verdict == scalar::k_verdict_clear || verdict == scalar::k_verdict_blocked;
    use.self_undecided += self && undecided;
    use.self_answered += self && answered;
  }
}

}  // namespace fieldtrace
