#include "hybrid/visibility/shadow_answerer.h"

#include <tbb/enumerable_thread_specific.h>

#include <algorithm>

#include "hybrid/visibility/device_answers.h"
#include "hybrid/visibility/shadow_workspace.h"

namespace fieldtrace {

namespace {

// Bounds of position -/+ reach along one axis. Eight running bounds let the compiler vectorise.
void bound_axis(const AlignedVector<float>& position, const ShadingPointBatch& of, float& lower, float& upper) {
  constexpr size_t k_chains = 8;
  float low[k_chains], high[k_chains];
  std::fill_n(low, k_chains, k_infinity);
  std::fill_n(high, k_chains, -k_infinity);
  const auto extend = [&](size_t j, size_t r) {
    const float reach = of.error[r] + of.radius[r];
    low[j] = std::min(low[j], position[r] - reach);
    high[j] = std::max(high[j], position[r] + reach);
  };
  size_t r = 0;
  for (; r + k_chains <= of.size; r += k_chains) {
    for (size_t j = 0; j < k_chains; ++j) extend(j, r + j);
  }
  for (size_t j = 0; r < of.size; ++r, ++j) extend(j, r);
  lower = *std::min_element(low, low + k_chains);
  upper = *std::max_element(high, high + k_chains);
}

// Bounds of all points that rays may leave from.
Bounds3 bounds_of(const ShadingPointBatch& shading_points) {
  Bounds3 b;
  bound_axis(shading_points.px, shading_points, b.lower.x, b.upper.x);
  bound_axis(shading_points.py, shading_points, b.lower.y, b.upper.y);
  bound_axis(shading_points.pz, shading_points, b.lower.z, b.upper.z);
  return b;
}

}  // namespace

// The origin of a ray lies up to `error` away from its shading point.
Sphere ShadowAnswerer::light_with_errors(const ShadingPointBatch& shading_points, const LightExtent& extent) {
  Sphere light = extent.ball;
  for (size_t r = 0; r < shading_points.size; ++r) light.radius = std::max(light.radius, shading_points.error[r]);
  return light;
}

struct ShadowAnswerer::Workspaces {
  tbb::enumerable_thread_specific<std::unique_ptr<Workspace>> by_thread{[] { return std::make_unique<Workspace>(); }};
};

ShadowAnswerer::ShadowAnswerer(const Scene& scene, const Accel& accel, std::span<const ShapeTraits> traits,
                               const std::vector<Field*>& fields, const AnswererSettings& settings,
                               const std::vector<const ThesisField*>& thesis_fields)
    : scene_(scene),
      accel_(accel),
      kernels_(segment_kernels(settings.isa)),
      thesis_kernels_(thesis_kernels(settings.isa)),
      keep_met_by_shafts_(shaft_kernel(settings.isa)),
      settings_(settings),
      tree_(scene),
      workspaces_(std::make_unique<Workspaces>()) {
  instances_.reserve(scene.instances.size());
  for (uint32_t i = 0; i < scene.instances.size(); ++i) {
    const uint32_t s = scene.instances[i].shape;
    Field* const field = fields.empty() ? nullptr : fields[s];
    const ThesisField* const thesis = thesis_fields.empty() ? nullptr : thesis_fields[s];
    instances_.push_back(make_shadow_instance(scene, i, traits[s], field, thesis, settings));
  }
}

ShadowAnswerer::~ShadowAnswerer() = default;

ShadowAnswerer::Workspace& ShadowAnswerer::workspace() const { return *workspaces_->by_thread.local(); }

void ShadowAnswerer::choose_candidates(const CandidateRequest& request) const {
  const ShadingPointBatch& shading_points = request.points;
  ShadowGroup& group = request.group;
  group.candidates.clear();
  group.open.clear();
  group.open_points.clear();
  if (settings_.whole_scene) {
    group.candidates.assign(k_most_candidates + 1, 0);  // candidate overflow
  } else {
    const size_t limit = group.few_samples() ? k_most_candidates : instances_.size();
    tree_.find(Shaft(bounds_of(shading_points), group.light), group.light.instance, limit, group.candidates);
  }
  const size_t size = padded(shading_points.size);
  group.is_tested = group.light.kind == LightExtent::Kind::bounded && !settings_.whole_scene &&
                    (!group.few_samples() || group.candidates.size() <= k_most_candidates);
  group.met.assign(size, 0);
  const int32_t all = !group.candidates.empty() && !group.is_tested ? k_may_shadow : 0;
  group.shadow.assign(size, all);
  group.by_rays.assign(size, all);
  if (settings_.check) group.blocked_by.assign(shading_points.size, k_none);
  if (group.is_tested || !settings_.count_uses || settings_.whole_scene) return;
  count_untested(shading_points, group, request.stats);
}

void ShadowAnswerer::test_candidates(const CandidateRequest& request) const {
  ShadowGroup& group = request.group;
  if (!group.is_tested) return;
  Workspace& work = workspace();
  const Sphere light = light_with_errors(request.points, group.light);
  for (uint32_t slot = 0; slot < group.candidates.size(); ++slot) {
    const ConeQuestion* const question = request.questions.empty() ? nullptr : &request.questions[slot];
    test_candidate(slot, question, request, light, work);
  }
}

void ShadowAnswerer::find_candidates(const CandidateRequest& request) const {
  choose_candidates(request);
  test_candidates(request);
}

void ShadowAnswerer::meet_bounds(uint32_t slot, const ShadingPointBatch& shading_points, const Sphere& light,
                                 const ShadowGroup& group, Workspace& work) const {
  const ShadowInstance& o = instances_[group.candidates[slot]];
  work.flags.assign(padded(shading_points.size), 0);
  if (o.in_ball) {
    kernels_.hull_meets_ball(o.cone.segment, shading_points, light, work.flags.data());
  } else {
    kernels_.hull_meets_box(o.box, shading_points, light, work.flags.data());
  }
  for (size_t r = 0; r < work.flags.size(); ++r) {
    if (r >= shading_points.size || group.shadow[r] & k_light_blocked) work.flags[r] = 0;  // padding, or settled
  }
  // By the test that chose the candidates, too: else an instance that only other shading points brought in could count.
  const ShaftTask task = shaft_task(group.light, tree_.bounds(group.candidates[slot]));
  keep_met_by_shafts_(task, shading_points, work.flags.data());
}

void ShadowAnswerer::test_candidate(uint32_t slot, const ConeQuestion* question, const CandidateRequest& request,
                                    const Sphere& light, Workspace& work) const {
  const ShadingPointBatch& shading_points = request.points;
  ShadowGroup& group = request.group;
  const ShadowInstance& o = instances_[group.candidates[slot]];
  if (question) {
    work.flags.assign(padded(shading_points.size), 0);
    for (size_t i = 0; i < question->blocks.size(); ++i) {
      for_each_wanted(*question, i, [&](uint32_t r) {
        if (!(group.shadow[r] & k_light_blocked)) work.flags[r] = k_may_shadow;
      });
    }
  } else {
    meet_bounds(slot, shading_points, light, group, work);
  }
  uint32_t most_samples = 0;
  for (size_t r = 0; r < work.flags.size(); ++r) {
    if (!work.flags[r]) continue;
    group.met[r] = 1;
    if (settings_.count_uses)
      use_of(o, request.stats).add_met(group.light_samples[r], shading_points.instance[r] == group.candidates[slot]);
    most_samples = std::max(most_samples, group.light_samples[r]);
  }
  if (most_samples == 0) return;
  work.before = work.flags;
  if (o.answers_cones && most_samples >= k_fewest_cone_samples) {
    // Clusters with few samples send rays.
    for (size_t r = 0; r < shading_points.size; ++r) {
      if (group.light_samples[r] < k_fewest_cone_samples) work.flags[r] = 0;
    }
    query_cones(o, cone_task(o, group), question, request, work);
    for (size_t r = 0; r < shading_points.size; ++r) {
      if (group.light_samples[r] < k_fewest_cone_samples) work.flags[r] = work.before[r];
    }
  }
  const uint32_t begin = uint32_t(group.open_points.size());
  for (uint32_t r = 0; r < shading_points.size; ++r) {
    const int32_t flag = work.flags[r];
    group.shadow[r] |= flag & ~k_by_strata;
    if (flag & k_by_strata) group.open_points.push_back(r);
    group.by_rays[r] |= (flag & (k_may_shadow | k_by_strata)) == k_may_shadow;
    if (settings_.check && flag & k_light_blocked) group.blocked_by[r] = group.candidates[slot];
    const bool is_answered = o.field && work.before[r] && (!flag || flag & k_light_blocked);
    if (settings_.count_uses && is_answered && shading_points.instance[r] == group.candidates[slot])
      use_of(o, request.stats).self_answered += group.light_samples[r];
  }
  const uint32_t end = uint32_t(group.open_points.size());
  if (end > begin) group.open.push_back({slot, begin, end});
}

void ShadowAnswerer::collect(const RayRequest& request, Workspace& work) const {
  work.states.keep_verdicts = settings_.check || settings_.count_uses;
  work.states.reset(request.batch.rays.size);
  classify(request, work);
  kernels_.collect(work.states, request.batch.rays.size, request.batch.blocked.data(), work.exact);
  request.stats.rays_crossing += work.exact.crossing;
}

void ShadowAnswerer::answer(const RayRequest& request) const {
  const ShadowGroup& group = request.group;
  Stats& stats = request.stats;
  if (group.candidates.empty()) return;
  Workspace& work = workspace();
  const uint64_t traced = stats.rays_exact;
  if (group.candidates.size() > k_most_candidates) {
    trace_all(request.batch, work, stats);
  } else {
    collect(request, work);
    trace(group, request.batch, work, stats);
  }
  if (request.counts_open) stats.rays_open += stats.rays_exact - traced;
}

void ShadowAnswerer::find_ray_candidates(const Bounds3& origins, ShadowGroup& group) const {
  group.pixel_samples = 1;
  group.is_tested = false;
  group.open.clear();
  tree_.find(Shaft(origins, group.light), group.light.instance, k_most_candidates, group.candidates);
}

void ShadowAnswerer::look_up(const ShadowGroup& group, ShadowBatch& batch, Stats& stats) const {
  if (group.candidates.empty()) return;
  if (group.candidates.size() > k_most_candidates) {
    for (size_t i = 0; i < batch.rays.size; ++i) batch.exact[i] = batch.rays.tmax[i] >= 0.0f;
    return;
  }
  Workspace& work = workspace();
  collect({group, batch, stats}, work);
  for (size_t k = 0; k < work.exact.one_count; ++k) batch.exact[size_t(work.exact.one_undecided_slot[k])] = 1;
  for (size_t k = 0; k < work.exact.many_count; ++k) batch.exact[size_t(work.exact.many_undecided_slots[k])] = 1;
}

}  // namespace fieldtrace
