#include "hybrid/scene_answerer.h"

#include <algorithm>
#include <cstring>

#include "field/bake.h"
#include "field/query.hd.h"
#include "field/risk.h"

namespace fieldtrace {
namespace {

// Beyond this many candidates for one batch, one traversal of the whole scene costs less than their tests.
constexpr size_t k_most_candidates = 32;
// How many rounds of baking one batch can need: the line's cell, the anchored cell, the re-anchored one, and the last
// two again from the other end of the segment.
constexpr int k_most_bake_rounds = 6;

// world -> unit space of a ball in object space, composed in double.
void write_unit_transform(const Instance& instance, const Sphere& ball, float out[12]) {
  const double inverse_radius = 1.0 / double(ball.radius);
  for (int column = 0; column < 4; ++column) {
    for (int row = 0; row < 3; ++row) {
      const double shift = column == 3 ? double(ball.centre[row]) : 0.0;
      out[column * 3 + row] = float((double(instance.to_object[column][row]) - shift) * inverse_radius);
    }
  }
}

}  // namespace

bool is_flat(const Shape& shape) {
  if (shape.kind == ShapeKind::disk || shape.kind == ShapeKind::rectangle) return true;
  if (shape.kind != ShapeKind::mesh || shape.mesh.triangles.empty()) return false;
  const std::vector<Vec3>& p = shape.mesh.positions;
  // The plane of the largest triangle; every vertex must lie in it but for the rounding of the test itself.
  DVec3 normal(0.0);
  double largest = 0.0;
  for (const UVec3& t : shape.mesh.triangles) {
    const DVec3 n = glm::cross(DVec3(p[t.y]) - DVec3(p[t.x]), DVec3(p[t.z]) - DVec3(p[t.x]));
    if (glm::dot(n, n) > largest) {
      largest = glm::dot(n, n);
      normal = n;
    }
  }
  if (largest == 0.0) return true;
  normal = glm::normalize(normal);
  const DVec3 base = DVec3(p[shape.mesh.triangles[0].x]);
  const Vec3 extent = glm::max(glm::abs(shape.bounds.lower), glm::abs(shape.bounds.upper));
  const double slack = double(gamma_bound(1)) * double(glm::length(extent));
  return std::all_of(p.begin(), p.end(),
                     [&](const Vec3& v) { return std::abs(glm::dot(DVec3(v) - base, normal)) <= slack; });
}

bool wants_field(const Shape& shape) {
  return shape.kind == ShapeKind::mesh && shape.triangle_count() >= k_fewest_field_triangles && !is_flat(shape);
}

struct SceneAnswerer::Occluder {
  bool in_ball = false;    // culled by the field's ball, else by the bounding box
  Field* field = nullptr;  // answers within the ball; null: exact rays
  SegmentTask ball;
  BoxTask box;
};

struct SceneAnswerer::Workspace {
  std::vector<uint32_t> candidates;
  AlignedVector<int32_t> verdict, slice;
  std::vector<uint8_t> asks;     // how many candidates ask for a ray; saturates at 2
  std::vector<uint8_t> crosses;  // whether the ray meets any candidate's bounds
  std::vector<uint32_t> asker;   // the last candidate that asked
  std::vector<uint32_t> visibility_slices, depth_slices, chunks;
  std::vector<uint32_t> rays;
  std::vector<uint8_t> exact_blocked;
  std::vector<std::pair<uint32_t, uint32_t>> single_asks;  // candidate, ray
};

SceneAnswerer::SceneAnswerer(const Scene& scene, const Accel& accel, std::vector<Field*> fields,
                             const AnswererSettings& settings)
    : scene_(scene),
      accel_(accel),
      kernels_(segment_kernels(settings.isa)),
      settings_(settings),
      candidates_(scene),
      fields_(std::move(fields)) {
  QueryPolicy policy;
  policy.visibility_max_class = policy.depth_max_class = settings.force_ask ? -1 : max_class_at(settings.tolerance);
  policy.answer_all = settings.tolerance >= 1.0f;
  std::vector<char> flat, wanted;
  for (const Shape& shape : scene.shapes) {
    flat.push_back(is_flat(shape));
    wanted.push_back(wants_field(shape));
  }
  occluders_.resize(scene.instances.size());
  for (uint32_t i = 0; i < scene.instances.size(); ++i) {
    const Instance& instance = scene.instances[i];
    const Shape& shape = scene.shapes[instance.shape];
    Occluder& o = occluders_[i];
    o.field = fields_[instance.shape];
    o.in_ball = wanted[instance.shape];
    o.ball.instance = o.box.instance = i;
    o.ball.policy = policy;
    if (o.field) o.ball.field = o.field->view();
    write_unit_transform(instance, field_ball(shape.bounds), o.ball.to_unit);
    std::memcpy(o.box.to_object, &instance.to_object, sizeof o.box.to_object);
    // The transform of a ray into object space rounds; the box grows by as much.
    const Vec3 extent = glm::max(glm::abs(shape.bounds.lower), glm::abs(shape.bounds.upper));
    const Vec3 slack = Vec3(gamma_bound(8) * glm::length(extent));
    for (int axis = 0; axis < 3; ++axis) {
      o.box.lower[axis] = shape.bounds.lower[axis] - slack[axis];
      o.box.upper[axis] = shape.bounds.upper[axis] + slack[axis];
    }
    o.box.skip_own = flat[instance.shape];
  }
}

SceneAnswerer::~SceneAnswerer() = default;

void SceneAnswerer::bake_unknown(const Occluder& o, const ShadowBatch& batch, Workspace& work, Stats& stats) const {
  const uint32_t shape = scene_.instances[o.ball.instance].shape;
  const size_t n = padded(batch.rays.size);
  for (int round = 0; round < k_most_bake_rounds; ++round) {
    work.visibility_slices.clear();
    work.depth_slices.clear();
    work.chunks.clear();
    for (size_t i = 0; i < n; ++i) {
      const int32_t v = work.verdict[i];
      if (v < scalar::k_verdict_unknown_visibility) continue;
      (v == scalar::k_verdict_unknown_visibility ? work.visibility_slices : work.depth_slices)
          .push_back(uint32_t(work.slice[i]));
      const uint32_t chunk = uint32_t(i / k_batch_padding);
      if (work.chunks.empty() || work.chunks.back() != chunk) work.chunks.push_back(chunk);
    }
    if (work.chunks.empty()) return;
    BakeCounters counters;
    const auto bake = [&](FieldLayer layer, std::vector<uint32_t>& slices) {
      std::sort(slices.begin(), slices.end());
      slices.erase(std::unique(slices.begin(), slices.end()), slices.end());
      bake_slices(*o.field, layer, slices, accel_, shape, counters);
    };
    bake(FieldLayer::visibility, work.visibility_slices);
    bake(FieldLayer::depth, work.depth_slices);
    stats.bake_rays += counters.rays;
    stats.time_bake += counters.seconds;
    for (const uint32_t chunk : work.chunks) {
      const size_t begin = chunk * k_batch_padding;
      const SegmentCounts again = kernels_.query(o.ball, batch.rays, batch.instance.data(), begin,
                                                 begin + k_batch_padding, work.verdict.data(), work.slice.data());
      stats.lookups += again.lookups;
    }
    if (o.field->pool_full()) break;
  }
  // No room to bake: such rays are traced.
  for (size_t i = 0; i < n; ++i) {
    if (work.verdict[i] >= scalar::k_verdict_unknown_visibility) work.verdict[i] = scalar::k_verdict_ask;
  }
}

void SceneAnswerer::classify(const Occluder& o, const ShadowBatch& batch, Workspace& work, Stats& stats) const {
  const size_t n = padded(batch.rays.size);
  SegmentCounts counts;
  if (!o.in_ball) {
    counts = kernels_.cross_box(o.box, batch.rays, batch.instance.data(), 0, n, work.verdict.data());
  } else if (!o.field) {
    counts = kernels_.cross_ball(o.ball, batch.rays, 0, n, work.verdict.data());
  } else {
    counts = kernels_.query(o.ball, batch.rays, batch.instance.data(), 0, n, work.verdict.data(), work.slice.data());
    if (counts.unknown > 0) bake_unknown(o, batch, work, stats);
    if (settings_.check) check_answers(o, batch, work, stats);
  }
  stats.sphere_crossings += counts.crossings;
  stats.lookups += counts.lookups;
}

void SceneAnswerer::check_answers(const Occluder& o, const ShadowBatch& batch, Workspace& work, Stats& stats) const {
  work.rays.clear();
  for (size_t i = 0; i < batch.rays.size; ++i) {
    if (work.verdict[i] == scalar::k_verdict_clear || work.verdict[i] == scalar::k_verdict_blocked) {
      work.rays.push_back(uint32_t(i));
    }
  }
  work.exact_blocked.assign(batch.rays.size, 0);
  accel_.occluded_by(o.ball.instance, batch.rays, work.rays, work.exact_blocked.data());
  for (const uint32_t i : work.rays) {
    const bool blocked = work.verdict[i] == scalar::k_verdict_blocked;
    const bool own = batch.instance[i] == o.ball.instance;
    const bool wrong = blocked != (work.exact_blocked[i] != 0);
    stats.check_answers += 1;
    stats.check_wrong += wrong;
    stats.check_by[blocked][own].answers += 1;
    stats.check_by[blocked][own].wrong += wrong;
  }
}

void SceneAnswerer::trace(ShadowBatch& batch, Workspace& work, Stats& stats) const {
  const size_t n = batch.rays.size;
  work.rays.clear();
  work.single_asks.clear();
  for (size_t i = 0; i < n; ++i) {
    if (work.asks[i] == 0 || batch.blocked[i]) continue;
    batch.exact[i] = 1;
    if (work.asks[i] == 1) {
      work.single_asks.emplace_back(work.asker[i], uint32_t(i));
    } else {
      work.rays.push_back(uint32_t(i));
    }
  }
  stats.rays_exact += work.rays.size() + work.single_asks.size();
  accel_.occluded(batch.rays, work.rays, batch.blocked.data());
  std::sort(work.single_asks.begin(), work.single_asks.end());
  for (size_t begin = 0; begin < work.single_asks.size();) {
    const uint32_t instance = work.single_asks[begin].first;
    work.rays.clear();
    size_t end = begin;
    for (; end < work.single_asks.size() && work.single_asks[end].first == instance; ++end) {
      work.rays.push_back(work.single_asks[end].second);
    }
    accel_.occluded_by(instance, batch.rays, work.rays, batch.blocked.data());
    begin = end;
  }
}

void SceneAnswerer::answer(const ShadowQuery& query, Stats& stats) const {
  ShadowBatch& batch = query.batch;
  Workspace& work = workspaces_.local();
  const size_t n = batch.rays.size;
  const size_t n_padded = padded(n);
  Bounds3 receivers;
  for (size_t r = 0; r < query.receivers.size; ++r) {
    const float e = query.receivers.error[r];
    const Vec3 p(query.receivers.px[r], query.receivers.py[r], query.receivers.pz[r]);
    receivers.extend(p - Vec3(e));
    receivers.extend(p + Vec3(e));
  }
  candidates_.select(receivers, light_extent(scene_, query.light, query.light_bounds), k_most_candidates,
                     work.candidates);
  if (work.candidates.empty()) return;
  work.asks.assign(n_padded, 0);
  work.asker.resize(n_padded);
  if (work.candidates.size() > k_most_candidates) {
    for (size_t i = 0; i < n; ++i) work.asks[i] = batch.rays.tmax[i] >= 0.0f ? 2 : 0;
    stats.rays_crossing += size_t(std::count(work.asks.begin(), work.asks.begin() + ptrdiff_t(n), 2));
    stats.sphere_crossings += size_t(std::count(work.asks.begin(), work.asks.begin() + ptrdiff_t(n), 2));
    trace(batch, work, stats);
    return;
  }
  work.verdict.resize(n_padded);
  work.slice.resize(n_padded);
  work.crosses.assign(n_padded, 0);
  for (const uint32_t candidate : work.candidates) {
    classify(occluders_[candidate], batch, work, stats);
    for (size_t i = 0; i < n; ++i) {
      const int32_t v = work.verdict[i];
      work.crosses[i] |= uint8_t(v != scalar::k_verdict_none);
      batch.blocked[i] |= uint8_t(v == scalar::k_verdict_blocked);
      const bool asks = v == scalar::k_verdict_ask;
      work.asks[i] = uint8_t(std::min(work.asks[i] + int(asks), 2));
      work.asker[i] = asks ? candidate : work.asker[i];
    }
  }
  for (size_t i = 0; i < n; ++i) stats.rays_crossing += work.crosses[i];
  trace(batch, work, stats);
}

}  // namespace fieldtrace
