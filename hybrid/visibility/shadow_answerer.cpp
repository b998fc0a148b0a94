#include "hybrid/visibility/shadow_answerer.h"

#include <algorithm>

#include "hybrid/visibility/shadow_workspace.h"

namespace fieldtrace {

namespace {

// Bounds of position -/+ error along one axis. Eight running bounds let the compiler use vectors.
void bound_axis(const AlignedVector<float>& position, const AlignedVector<float>& error, size_t count, float& lower,
                float& upper) {
  constexpr size_t k_chains = 8;
  float low[k_chains], high[k_chains];
  std::fill_n(low, k_chains, k_infinity);
  std::fill_n(high, k_chains, -k_infinity);
  size_t r = 0;
  for (; r + k_chains <= count; r += k_chains) {
    for (size_t j = 0; j < k_chains; ++j) {
      low[j] = std::min(low[j], position[r + j] - error[r + j]);
      high[j] = std::max(high[j], position[r + j] + error[r + j]);
    }
  }
  for (size_t j = 0; r < count; ++r, ++j) {
    low[j] = std::min(low[j], position[r] - error[r]);
    high[j] = std::max(high[j], position[r] + error[r]);
  }
  lower = *std::min_element(low, low + k_chains);
  upper = *std::max_element(high, high + k_chains);
}

// Of all points that rays may leave from.
Bounds3 bounds_of(const ReceiverBatch& receivers) {
  Bounds3 b;
  bound_axis(receivers.px, receivers.error, receivers.size, b.lower.x, b.upper.x);
  bound_axis(receivers.py, receivers.error, receivers.size, b.lower.y, b.upper.y);
  bound_axis(receivers.pz, receivers.error, receivers.size, b.lower.z, b.upper.z);
  return b;
}

// Of all rays that may leave one receiver.
Shaft shaft_to(const ReceiverBatch& receivers, size_t r, const LightExtent& light) {
  const Vec3 p(receivers.px[r], receivers.py[r], receivers.pz[r]), error(receivers.error[r]);
  return {{p - error, p + error}, light};
}

}  // namespace

ShadowAnswerer::ShadowAnswerer(const Scene& scene, const Accel& accel, std::span<const ShapeTraits> traits,
                               const std::vector<Field*>& fields, const AnswererSettings& settings,
                               const std::vector<const ThesisField*>& thesis_fields)
    : scene_(scene),
      accel_(accel),
      kernels_(segment_kernels(settings.isa)),
      thesis_kernels_(thesis_kernels(settings.isa)),
      settings_(settings),
      candidates_(scene),
      workspaces_([] { return std::make_unique<Workspace>(); }) {
  occluders_.reserve(scene.instances.size());
  for (uint32_t i = 0; i < scene.instances.size(); ++i) {
    const uint32_t s = scene.instances[i].shape;
    const ThesisField* thesis = thesis_fields.empty() ? nullptr : thesis_fields[s];
    occluders_.push_back(make_occluder(scene, i, traits[s], fields[s], thesis, settings));
  }
}

ShadowAnswerer::~ShadowAnswerer() = default;

void ShadowAnswerer::find_candidates(const ReceiverBatch& receivers, ShadowGroup& group, Stats& stats) const {
  const Bounds3 bounds = bounds_of(receivers);
  if (settings_.whole_scene) {
    group.candidates.assign(k_most_candidates + 1, 0);  // too many to test one by one
  } else {
    candidates_.select(bounds, group.light, k_most_candidates, group.candidates);
  }
  const bool test_each = group.light.kind == LightExtent::Kind::bounded && group.candidates.size() <= k_most_candidates;
  group.met.assign(padded(receivers.size), 0);
  const int32_t all = !group.candidates.empty() && !test_each ? k_may_shadow : 0;
  group.shadow.assign(padded(receivers.size), all);
  group.by_rays.assign(padded(receivers.size), all);
  group.by_leaves.assign(padded(receivers.size), 0);
  if (!test_each) return;
  Workspace& work = *workspaces_.local();
  Sphere light = group.light.ball;
  // The origin of a ray lies up to `error` beside the receiver.
  for (size_t r = 0; r < receivers.size; ++r) light.radius = std::max(light.radius, receivers.error[r]);
  for (size_t slot = 0; slot < group.candidates.size(); ++slot) {
    const Occluder& o = occluders_[group.candidates[slot]];
    work.flags.assign(padded(receivers.size), 0);
    if (o.in_ball) {
      kernels_.hull_meets_ball(o.cone.segment, receivers, light, work.flags.data());
    } else {
      kernels_.hull_meets_box(o.box, receivers, light, work.flags.data());
    }
    std::fill(work.flags.begin() + std::ptrdiff_t(receivers.size), work.flags.end(), 0);
    for (size_t r = 0; r < work.flags.size(); ++r) {
      group.met[r] |= work.flags[r];
      if (group.shadow[r] & k_light_blocked) work.flags[r] = 0;  // nothing more to learn
    }
    if (o.answers_cones && group.light_samples >= k_fewest_cone_samples) {
      const auto own_open = [&] {
        uint64_t n = 0;
        for (size_t r = 0; r < receivers.size; ++r) {
          n += receivers.instance[r] == group.candidates[slot] && work.flags[r] == k_may_shadow;
        }
        return n;
      };
      const uint64_t before = settings_.count_uses ? own_open() : 0;
      ask_cones(o, receivers, group, work, stats);
      if (settings_.count_uses) use_of(o, stats).own_answered += (before - own_open()) * uint64_t(group.light_samples);
    }
    for (size_t r = 0; r < work.flags.size(); ++r) {
      const int32_t flag = work.flags[r];
      group.shadow[r] |= flag & ~k_by_leaves;
      group.by_leaves[r] |= flag & k_by_leaves ? 1 << slot : 0;
      group.by_rays[r] |= (flag & (k_may_shadow | k_by_leaves)) == k_may_shadow;
    }
  }
  // For fewer samples this costs more than it saves.
  if (group.light_samples >= k_fewest_cone_samples) forget_distant(receivers, group);
  const auto is_spared = [&](size_t r) {
    return group.met[r] && (!group.shadow[r] || group.shadow[r] & k_light_blocked);
  };
  for (size_t r = 0; r < receivers.size; ++r) stats.samples_spared += is_spared(r) ? uint64_t(group.light_samples) : 0;
}

bool ShadowAnswerer::extrapolates(const ShadowGroup& group) const {
  if (settings_.tolerance < k_estimating_tolerance || group.candidates.size() > k_most_candidates) return false;
  return std::any_of(group.candidates.begin(), group.candidates.end(),
                     [this](uint32_t candidate) { return occluders_[candidate].answers_cones; });
}

// Receivers that none of the candidates can shadow, by the test that chose these, which is finer than the kernels'.
// What becomes of a receiver then does not depend on which candidates the others of its group have.
void ShadowAnswerer::forget_distant(const ReceiverBatch& receivers, ShadowGroup& group) const {
  for (size_t r = 0; r < receivers.size; ++r) {
    if (!group.met[r]) continue;
    const Shaft shaft = shaft_to(receivers, r, group.light);
    const bool is_met = std::any_of(group.candidates.begin(), group.candidates.end(),
                                    [&](uint32_t instance) { return candidates_.meets(shaft, instance); });
    if (!is_met) group.met[r] = group.shadow[r] = group.by_rays[r] = group.by_leaves[r] = 0;
  }
}

uint32_t ShadowAnswerer::fields_before(const ShadowGroup& group, const ReceiverBatch& receivers,
                                       uint32_t receiver) const {
  const Shaft shaft = shaft_to(receivers, receiver, group.light);
  uint32_t fields = 0;
  for (size_t slot = 0; slot < group.candidates.size(); ++slot) {
    const uint32_t instance = group.candidates[slot];
    fields |= occluders_[instance].answers_cones && candidates_.meets(shaft, instance) ? 1u << slot : 0u;
  }
  return fields;
}

bool ShadowAnswerer::gains_by_halving(const ShadowGroup& group) const {
  // Where every cell asks, the groups are those of Monte Carlo, so that both trace the same rays.
  if (settings_.force_ask || group.candidates.size() <= k_most_candidates) return false;
  return std::any_of(group.candidates.begin(), group.candidates.end(), [this](uint32_t candidate) {
    return occluders_[candidate].field != nullptr || occluders_[candidate].thesis;
  });
}

void ShadowAnswerer::answer(const ShadowGroup& group, LightSeen seen, ShadowBatch& batch, Stats& stats) const {
  if (group.candidates.empty()) return;
  Workspace& work = *workspaces_.local();
  if (group.candidates.size() > k_most_candidates) {
    trace_all(batch, work, stats);
    return;
  }
  work.states.keep_verdicts = settings_.check || settings_.count_uses;
  work.states.reset(batch.rays.size);
  classify(group, seen, batch, work, stats);
  kernels_.collect(work.states, batch.rays.size, batch.blocked.data(), work.exact);
  stats.rays_crossing += work.exact.crossing;
  trace(group, batch, work, stats);
}

}  // namespace fieldtrace
