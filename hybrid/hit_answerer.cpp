#include "hybrid/hit_answerer.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "field/bake.h"
#include "field/bake_full.h"
#include "field/query.hd.h"
#include "hybrid/ask_and_bake.h"
#include "hybrid/occluder.h"
#include "hybrid/shadow_answerer.h"

namespace fieldtrace {
namespace {

// Disagreement that counts as wrong: more than this many error bounds, or than the lobe's own spread of directions.
constexpr float k_wrong_errors = 4.0f;
constexpr float k_lobe_spread = 2.0f;

// The tangent by which a sheet's normal may differ from the surface's, of a lobe's, for each unit of tolerance: at the
// default .2 % of hits are then off by more than the lobe's spread (docs/decisions/016-certified-hits.md).
constexpr float k_bend_of_tolerance = 8.0f;

// Half the angle over which a lobe reflects.
float spread_of(float alpha) { return std::min(k_lobe_spread * std::atan(alpha), 0.5f * k_pi * (1.0f - 0x1p-10f)); }

bool is_masked(const Scene& scene, const Instance& instance) {
  const Bsdf& bsdf = scene.bsdfs[instance.bsdf];
  return bsdf.opacity != k_none || (bsdf.back != k_none && scene.bsdfs[bsdf.back].opacity != k_none);
}

}  // namespace

SurfacePoint surface_of(const Scene& scene, const RayBatch& rays, const HitBatch& hits, const CertifiedHit& hit) {
  const size_t i = hit.ray;
  const Vec3 way = rays.direction(i) * hits.t[i], p = rays.origin(i) + way;
  const Vec3 magnitude = glm::abs(rays.origin(i)) + glm::abs(way);
  const float rounding = gamma_bound(2) * glm::dot(magnitude, glm::abs(hit.normal));
  return surface_near(scene, hits.instance[i], hits.primitive[i], p, hit.normal, hit.error + rounding);
}

struct HitAnswerer::Object {
  SegmentTask task;
  Field* field = nullptr;
  Vec3 centre = Vec3(0.0f);  // of its ball, world space
};

struct HitAnswerer::Nearest {
  Verdict verdict = Verdict::miss;
  int object = -1;       // of a certified hit; -1: what is nearest was traced, or nothing
  bool crossed = false;  // some object's ball
};

std::vector<uint32_t> HitAnswerer::suited_instances(const Scene& scene, const std::vector<Field*>& fields) {
  std::vector<uint32_t> suited;
  for (uint32_t i = 0; i < scene.instances.size(); ++i) {
    const Instance& instance = scene.instances[i];
    if (!fields[instance.shape] || instance.emitter != k_none || is_masked(scene, instance)) continue;
    suited.push_back(i);
    if (suited.size() > k_most_objects) return {};
  }
  return suited;
}

double HitAnswerer::estimated_bake_rays(const FieldParameters& p) {
  return double(reachable_cells(p, FieldLayer::visibility)) * p.lines +
         double(reachable_cells(p, FieldLayer::depth)) * (p.lines + 2);
}

HitAnswerer::HitAnswerer(const Scene& scene, const Accel& accel, std::span<const ShapeTraits> traits,
                         const std::vector<Field*>& fields, std::span<const uint32_t> instances, Isa isa,
                         float tolerance, bool check)
    : scene_(scene),
      accel_(accel),
      kernels_(segment_kernels(isa)),
      tolerance_(tolerance),
      check_(check) {
  AnswererSettings settings;
  settings.isa = isa;
  settings.tolerance = tolerance;
  is_object_.resize(scene.instances.size(), 0);
  for (const uint32_t i : instances) {
    const uint32_t shape = scene.instances[i].shape;
    Field* field = fields[shape];
    objects_.push_back({make_occluder(scene, i, traits[shape], field, nullptr, settings).cone.segment, field,
                        transform_point(scene.instances[i].to_world, field->ball().centre)});
    is_object_[i] = 1;
  }
  std::vector<uint32_t> others;
  for (uint32_t i = 0; i < scene.instances.size(); ++i) {
    if (!is_object_[i]) others.push_back(i);
  }
  if (!others.empty()) others_ = accel.group(others);
}

HitAnswerer::~HitAnswerer() = default;

void HitAnswerer::bake(const Object& object, const HitUnknowns& unknowns, Stats& stats) const {
  BakeCounters counters;
  const uint32_t shape = scene_.instances[object.task.instance].shape;
  const auto bake_layer = [&](FieldLayer layer, const std::vector<uint32_t>& slices) {
    if (!slices.empty()) bake_slices(*object.field, layer, slices, accel_, shape, counters);
  };
  bake_layer(FieldLayer::visibility, unknowns.visibility);
  bake_layer(FieldLayer::depth, unknowns.depth);
  bake_layer(FieldLayer::primitive, unknowns.primitive);
  stats.bake_rays += counters.rays;
  stats.time_bake += counters.seconds;
}

void HitAnswerer::ask(HitWorkspace& work, Stats& stats) const {
  const size_t n = work.rays.size;
  work.limit.assign(padded(n), k_infinity);
  if (others_) {
    work.others.resize(n);
    accel_.intersect(*others_, work.rays, work.others, Coherence::incoherent);
    for (size_t j = 0; j < n; ++j) {
      if (work.others.instance[j] != k_none) work.limit[j] = work.others.t[j];
    }
  }
  // Front to back, about: what lies behind a hit is not looked up. The answers do not depend on it.
  work.front_to_back.resize(objects_.size());
  std::iota(work.front_to_back.begin(), work.front_to_back.end(), 0u);
  const auto distance = [&](uint32_t k) { return glm::length(objects_[k].centre - work.rays.origin(0)); };
  std::sort(work.front_to_back.begin(), work.front_to_back.end(),
            [&](uint32_t a, uint32_t b) { return distance(a) < distance(b); });
  work.answers.resize(objects_.size());
  for (const uint32_t k : work.front_to_back) {
    const Object& object = objects_[k];
    HitAnswers& answers = work.answers[k];
    answers.resize(n);
    ask_and_bake(
        n, work.unknowns,
        [&](std::span<const uint32_t> blocks) {
          stats.lookups += kernels_.nearest_hits(object.task, work.rays, work.instance.data(), work.limit.data(),
                                                 blocks, answers, work.unknowns);
        },
        [&] {
          bake(object, work.unknowns, stats);
          return !object.field->pool_full();
        });
    for (const uint32_t block : work.unknowns.blocks) {
      for (uint32_t j = block; j < block + k_batch_padding; ++j) {
        if (answers.verdict[j] != scalar::k_verdict_none) answers.verdict[j] = scalar::k_verdict_ask;
      }
    }
    for (size_t j = 0; j < n; ++j) {
      if (answers.verdict[j] != scalar::k_verdict_blocked) continue;
      work.limit[j] = std::min(work.limit[j], answers.t[j] + answers.error[j]);
    }
  }
}

HitAnswerer::Nearest HitAnswerer::put_together(const HitWorkspace& work, size_t j, float alpha) const {
  const float limit = work.limit[j];  // the nearest surface lies there or before
  Nearest nearest;
  int candidates = others_ && work.others.instance[j] != k_none && work.others.t[j] <= limit ? 1 : 0;
  for (size_t k = 0; k < objects_.size(); ++k) {
    const HitAnswers& a = work.answers[k];
    nearest.crossed = nearest.crossed || a.verdict[j] != scalar::k_verdict_none;
    if (a.verdict[j] == scalar::k_verdict_ask && a.entry[j] <= limit) nearest.verdict = Verdict::ask;
    if (a.verdict[j] != scalar::k_verdict_blocked || std::max(a.t[j] - a.error[j], a.entry[j]) > limit) continue;
    nearest.object = int(k);
    ++candidates;
  }
  if (candidates > 1) nearest.verdict = Verdict::ask;  // they may lie either way round
  if (nearest.verdict == Verdict::ask || nearest.object < 0) return nearest;
  const HitAnswers& a = work.answers[size_t(nearest.object)];
  const bool is_near = a.error[j] <= k_blur_of_tolerance * tolerance_ * alpha * a.t[j];
  const bool is_flat = a.bend[j] <= k_bend_of_tolerance * tolerance_ * std::tan(spread_of(alpha));
  nearest.verdict = is_near && is_flat && a.primitive[j] >= 0 ? Verdict::hit : Verdict::ask;
  return nearest;
}

bool HitAnswerer::is_wrong(const HitWorkspace& work, size_t j, const Nearest& nearest, float alpha) const {
  const uint32_t found = work.found.instance[j];
  if (nearest.object < 0) return found != k_none && is_object_[found];
  const HitAnswers& a = work.answers[size_t(nearest.object)];
  if (found != objects_[size_t(nearest.object)].task.instance) return true;
  if (std::abs(work.found.t[j] - a.t[j]) > k_wrong_errors * a.error[j]) return true;
  const Vec3 normal = surface_at(scene_, work.rays, work.found, j).geometric_normal;
  const float cosine = std::abs(glm::dot(normal, Vec3(a.nx[j], a.ny[j], a.nz[j])));
  return cosine < std::cos(spread_of(alpha));
}

void HitAnswerer::check_answers(std::span<const PathState> paths, HitWorkspace& work, Stats& stats) const {
  const size_t n = work.rays.size;
  work.found.resize(n);
  accel_.intersect(work.rays, work.found, Coherence::incoherent);
  for (size_t j = 0; j < n; ++j) {
    const PathState& path = paths[work.asked[j]];
    const Nearest nearest = put_together(work, j, path.alpha);
    if (nearest.verdict == Verdict::ask || !nearest.crossed) continue;
    const bool is_hit = nearest.object >= 0;
    const bool own = is_hit ? objects_[size_t(nearest.object)].task.instance == path.instance
                            : path.instance != k_none && is_object_[path.instance];
    stats.add_check(is_hit ? CheckedVerdict::hit : CheckedVerdict::miss, own, is_wrong(work, j, nearest, path.alpha));
  }
}

// The glossy ones of `which`, in an order that suits look-ups; the others are exact.
void HitAnswerer::choose_asked(const RayBatch& rays, std::span<const PathState> paths, std::span<const uint32_t> which,
                               HitWorkspace& work) const {
  work.asked.clear();
  work.exact.clear();
  for (const uint32_t i : which) (paths[i].alpha > 0.0f && !paths[i].unweighted ? work.asked : work.exact).push_back(i);
  order_by_direction(rays, work.asked, work.order);
  const size_t n = work.asked.size();
  work.rays.resize(n);
  work.instance.assign(padded(n), k_none);
  for (size_t j = 0; j < n; ++j) {
    work.rays.copy(j, rays, work.asked[j]);
    work.instance[j] = paths[work.asked[j]].instance;
  }
}

// Of the rays asked about, what is known; the others become exact.
void HitAnswerer::settle(std::span<const PathState> paths, HitBatch& hits, HitWorkspace& work, Stats& stats) const {
  for (size_t j = 0; j < work.asked.size(); ++j) {
    const uint32_t i = work.asked[j];
    const Nearest nearest = put_together(work, j, paths[i].alpha);
    if (nearest.verdict == Verdict::ask) {
      work.exact.push_back(i);
      continue;
    }
    stats.rays_glossy_hits += nearest.crossed;
    if (nearest.verdict == Verdict::miss) {
      hits.instance[i] = k_none;
      if (others_) hits.copy(i, work.others, j);
      continue;
    }
    const HitAnswers& a = work.answers[size_t(nearest.object)];
    const Vec3 normal(a.nx[j], a.ny[j], a.nz[j]);
    hits.t[i] = a.t[j];
    hits.instance[i] = objects_[size_t(nearest.object)].task.instance;
    hits.primitive[i] = uint32_t(a.primitive[j]);
    work.certified.push_back({i, normal, a.error[j] * std::abs(glm::dot(normal, work.rays.direction(j)))});
  }
  std::sort(work.certified.begin(), work.certified.end(),
            [](const CertifiedHit& a, const CertifiedHit& b) { return a.ray < b.ray; });
}

void HitAnswerer::intersect(const RayBatch& rays, std::span<const PathState> paths, std::span<const uint32_t> which,
                            HitBatch& hits, HitWorkspace& work, Stats& stats) const {
  work.certified.clear();
  choose_asked(rays, paths, which, work);
  if (!work.asked.empty()) {
    ask(work, stats);
    if (check_) check_answers(paths, work, stats);
    settle(paths, hits, work, stats);
  }
  for (const uint32_t i : work.exact) stats.rays_glossy_exact += !paths[i].diffuse;
  intersect_some(accel_, rays, work.exact, hits, work.some);
}

}  // namespace fieldtrace
