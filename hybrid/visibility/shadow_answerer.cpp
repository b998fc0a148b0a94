#include "hybrid/visibility/shadow_answerer.h"

#include <algorithm>

#include "hybrid/visibility/shadow_workspace.h"

namespace fieldtrace {

namespace {

// Bounds of position -/+ error along one axis. Eight running bounds let the compiler vectorise.
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

// Bounds of all points that rays may leave from.
Bounds3 bounds_of(const ShadingPointBatch& shading_points) {
  Bounds3 b;
  bound_axis(shading_points.px, shading_points.error, shading_points.size, b.lower.x, b.upper.x);
  bound_axis(shading_points.py, shading_points.error, shading_points.size, b.lower.y, b.upper.y);
  bound_axis(shading_points.pz, shading_points.error, shading_points.size, b.lower.z, b.upper.z);
  return b;
}

// The shaft of all rays that may leave one shading point.
Shaft shaft_to(const ShadingPointBatch& shading_points, size_t r, const LightExtent& light) {
  const Vec3 p(shading_points.px[r], shading_points.py[r], shading_points.pz[r]), error(shading_points.error[r]);
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
  instances_.reserve(scene.instances.size());
  for (uint32_t i = 0; i < scene.instances.size(); ++i) {
    const uint32_t s = scene.instances[i].shape;
    const ThesisField* thesis = thesis_fields.empty() ? nullptr : thesis_fields[s];
    instances_.push_back(make_shadow_instance(scene, i, traits[s], fields[s], thesis, settings));
  }
}

ShadowAnswerer::~ShadowAnswerer() = default;

void ShadowAnswerer::find_candidates(const ShadingPointBatch& shading_points, ShadowGroup& group, Stats& stats) const {
  const Bounds3 bounds = bounds_of(shading_points);
  if (settings_.whole_scene) {
    group.candidates.assign(k_most_candidates + 1, 0);  // candidate overflow
  } else {
    candidates_.select(bounds, group.light, k_most_candidates, group.candidates);
  }
  const bool test_each = group.light.kind == LightExtent::Kind::bounded && group.candidates.size() <= k_most_candidates;
  group.met.assign(padded(shading_points.size), 0);
  const int32_t all = !group.candidates.empty() && !test_each ? k_may_shadow : 0;
  group.shadow.assign(padded(shading_points.size), all);
  group.by_rays.assign(padded(shading_points.size), all);
  group.by_strata.assign(padded(shading_points.size), 0);
  if (settings_.check) group.blocked_by.assign(shading_points.size, k_none);
  if (!test_each) return;
  Workspace& work = *workspaces_.local();
  Sphere light = group.light.ball;
  // The origin of a ray lies up to `error` away from its shading point.
  for (size_t r = 0; r < shading_points.size; ++r) light.radius = std::max(light.radius, shading_points.error[r]);
  for (size_t slot = 0; slot < group.candidates.size(); ++slot) {
    const ShadowInstance& o = instances_[group.candidates[slot]];
    work.flags.assign(padded(shading_points.size), 0);
    if (o.in_ball) {
      kernels_.hull_meets_ball(o.cone.segment, shading_points, light, work.flags.data());
    } else {
      kernels_.hull_meets_box(o.box, shading_points, light, work.flags.data());
    }
    std::fill(work.flags.begin() + std::ptrdiff_t(shading_points.size), work.flags.end(), 0);
    for (size_t r = 0; r < work.flags.size(); ++r) {
      group.met[r] |= work.flags[r];
      if (group.shadow[r] & k_light_blocked) work.flags[r] = 0;  // already settled
    }
    if (o.answers_cones && group.light_samples >= k_fewest_cone_samples) {
      const auto self_undecided = [&] {
        uint64_t n = 0;
        for (size_t r = 0; r < shading_points.size; ++r) {
          n += shading_points.instance[r] == group.candidates[slot] && work.flags[r] == k_may_shadow;
        }
        return n;
      };
      const uint64_t before = settings_.count_uses ? self_undecided() : 0;
      query_cones(o, shading_points, group, work, stats);
      if (settings_.count_uses)
        use_of(o, stats).self_answered += (before - self_undecided()) * uint64_t(group.light_samples);
    }
    for (size_t r = 0; settings_.check && r < shading_points.size; ++r) {
      if (work.flags[r] & k_light_blocked) group.blocked_by[r] = group.candidates[slot];
    }
    for (size_t r = 0; r < work.flags.size(); ++r) {
      const int32_t flag = work.flags[r];
      group.shadow[r] |= flag & ~k_by_strata;
      group.by_strata[r] |= flag & k_by_strata ? 1 << slot : 0;
      group.by_rays[r] |= (flag & (k_may_shadow | k_by_strata)) == k_may_shadow;
    }
  }
  // With fewer samples this costs more than it saves.
  if (group.light_samples >= k_fewest_cone_samples) forget_distant(shading_points, group);
  const auto is_spared = [&](size_t r) {
    return group.met[r] && (!group.shadow[r] || group.shadow[r] & k_light_blocked);
  };
  for (size_t r = 0; r < shading_points.size; ++r)
    stats.samples_spared += is_spared(r) ? uint64_t(group.light_samples) : 0;
}

bool ShadowAnswerer::extrapolates(const ShadowGroup& group) const {
  if (settings_.tolerance < k_estimating_tolerance || group.candidates.size() > k_most_candidates) return false;
  return std::any_of(group.candidates.begin(), group.candidates.end(),
                     [this](uint32_t candidate) { return instances_[candidate].answers_cones; });
}

// Clears shading points that no candidate can shadow by the test that chose the candidates, which is tighter than the
// kernels'. What becomes of a shading point then does not depend on the candidates of the others in its group.
void ShadowAnswerer::forget_distant(const ShadingPointBatch& shading_points, ShadowGroup& group) const {
  for (size_t r = 0; r < shading_points.size; ++r) {
    if (!group.met[r]) continue;
    const Shaft shaft = shaft_to(shading_points, r, group.light);
    const bool is_met = std::any_of(group.candidates.begin(), group.candidates.end(),
                                    [&](uint32_t instance) { return candidates_.meets(shaft, instance); });
    if (!is_met) group.met[r] = group.shadow[r] = group.by_rays[r] = group.by_strata[r] = 0;
  }
}

uint32_t ShadowAnswerer::fields_before(const ShadowGroup& group, const ShadingPointBatch& shading_points,
                                       uint32_t shading_point) const {
  const Shaft shaft = shaft_to(shading_points, shading_point, group.light);
  uint32_t fields = 0;
  for (size_t slot = 0; slot < group.candidates.size(); ++slot) {
    const uint32_t instance = group.candidates[slot];
    fields |= instances_[instance].answers_cones && candidates_.meets(shaft, instance) ? 1u << slot : 0u;
  }
  return fields;
}

bool ShadowAnswerer::gains_by_splitting(const ShadowGroup& group) const {
  // Where every cell is undecided, the groups are those of Monte Carlo, so that both trace the same rays.
  if (settings_.force_undecided || group.candidates.size() <= k_most_candidates) return false;
  return std::any_of(group.candidates.begin(), group.candidates.end(), [this](uint32_t candidate) {
    return instances_[candidate].field != nullptr || instances_[candidate].thesis;
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
