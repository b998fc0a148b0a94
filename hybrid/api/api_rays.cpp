// Rays of the C interface: occlusion and nearest hits.
#include <tbb/enumerable_thread_specific.h>

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "core/platform/parallel.h"
#include "core/surface/surface.h"
#include "hybrid/api/api_buffers.h"
#include "hybrid/api/flat_origins.h"
#include "hybrid/api/ray_kernels.h"
#include "hybrid/api/scene_object.h"

using namespace fieldtrace;
using namespace fieldtrace::api;

namespace {

constexpr size_t k_rays_of_chunk = 4096;

struct RayBuffers {
  Buffer<const float, 3> origins, directions;
  Buffer<const float> t_max;
  Buffer<const uint32_t> from;

  size_t count() const { return origins.count(); }
  float t_of(size_t i) const { return t_max ? *t_max.at(i) : k_infinity; }
  uint32_t instance_of(size_t i) const { return from ? *from.at(i) : k_none; }
};

// Calls body(begin, end) for chunks of [0, count) on the threads of the device.
template <class Body>
void for_chunks(Device& device, size_t count, const Body& body) {
  const size_t chunks = (count + k_rays_of_chunk - 1) / k_rays_of_chunk;
  execute_in(device.arena, [&] {
    parallel_for_isolated(chunks,
                          [&](size_t c) { body(c * k_rays_of_chunk, std::min(count, (c + 1) * k_rays_of_chunk)); });
  });
}

void require_rays(const SceneObject& s, const RayBuffers& rays, size_t begin, size_t end) {
  const size_t instances = s.scene.instances.size();
  for (size_t i = begin; i < end; ++i) {
    const Vec3 o = vector_at(rays.origins, i), d = vector_at(rays.directions, i);
    const uint32_t from = rays.instance_of(i);
    const bool is_near = is_within(o, s.largest_coordinate) || !(rays.t_of(i) >= 0.0f);
    if (is_finite(o) && is_finite(d) && d != Vec3(0.0f) && !std::isnan(rays.t_of(i)) && is_near &&
        (from == k_none || from < instances))
      continue;
    require(is_near || !is_finite(o), "ray " + std::to_string(i) + " starts beyond the coordinate " +
                                          fmt::format("{:.2g}", s.largest_coordinate) + ", too far from the scene");
    require(from == k_none || from < instances, "ray " + std::to_string(i) + " leaves an instance that is not there");
    require(false, "ray " + std::to_string(i) + " has numbers that are not finite, or no direction");
  }
}

struct OcclusionScratch {
  ShadowBatch batch;
  ShadowGroup group;
  // Rays that may have met the flat mesh that they leave.
  std::vector<uint32_t> suspects, from;
  RayBatch rays;
  HitBatch hits;
};
// Of this thread. Not inlined: the address of a thread's variable is a call in shared libraries, made again and again
// where the compiler sees the variable.
[[gnu::noinline]] OcclusionScratch& scratch() {
  thread_local OcclusionScratch s;
  return s;
}

// Copies rays [begin, end), checks them, and sets what bounds them. Throws Failure for rays that are errors.
void fill(const SceneObject& s, const RayBuffers& from, size_t begin, size_t end, ShadowBatch& batch, Bounds3& origins,
          LightExtent& ends) {
  static const GatherKernel gather = gather_kernel_for(resolve_isa(Isa::automatic));
  batch.resize(end - begin);
  const RaySource source = {from.origins.at(begin),
                            from.origins.stride(),
                            from.directions.at(begin),
                            from.directions.stride(),
                            from.t_max ? from.t_max.at(begin) : nullptr,
                            from.t_max.stride(),
                            s.usual};
  const RayExtent extent = gather(source, batch.rays);
  bool faulty = extent.faulty;
  for (size_t i = begin; i < end; ++i) {
    const uint32_t instance = from.instance_of(i);
    faulty |= instance != k_none && instance >= s.scene.instances.size();
    batch.instance[i - begin] = instance;
  }
  origins = extent.origins;
  const auto most = [](const Bounds3& b) { return glm::max(glm::abs(b.lower), glm::abs(b.upper)); };
  const Vec3 farthest = origins.empty() ? Vec3(0.0f) : most(origins);
  faulty |= !is_within(farthest, s.largest_coordinate);
  if (faulty) require_rays(s, from, begin, end);
  ends = {};
  if (origins.empty()) return;
  if (extent.unbounded || extent.uneven) make_unit(batch.rays, s.usual);
  if (!extent.unbounded) {
    // Of o + t d: |t d| is at most |o| + |o + t d|, and rounded too.
    const Vec3 slack = gamma_bound(6) * (2.0f * farthest + most(extent.ends));
    ends.bounds = {extent.ends.lower - slack, extent.ends.upper + slack};
    ends.ball = {ends.bounds.centre(), 0.5f * glm::length(ends.bounds.diagonal())};
    if (ends.ball.radius < k_infinity && is_finite(ends.ball.centre)) return;
  }
  ends.kind = LightExtent::Kind::everywhere;
}

// Rays that were traced may have met the flat mesh that they leave.
void unblock_flat_origins(const SceneObject& s, OcclusionScratch& o) {
  ShadowBatch& batch = o.batch;
  o.suspects.clear(), o.from.clear();
  for (uint32_t i = 0; i < batch.rays.size; ++i) {
    if (!batch.exact[i] || !batch.blocked[i] || !is_flat(s, batch.instance[i])) continue;
    o.suspects.push_back(i);
    o.from.push_back(batch.instance[i]);
  }
  if (o.suspects.empty()) return;
  o.rays.resize(o.suspects.size()), o.hits.resize(o.suspects.size());
  for (size_t k = 0; k < o.suspects.size(); ++k) o.rays.copy(k, batch.rays, o.suspects[k]);
  s.accel->intersect(o.rays, o.hits, Coherence::incoherent);
  pass_flat_origins(s, o.rays, o.from, o.hits);
  for (size_t k = 0; k < o.suspects.size(); ++k) batch.blocked[o.suspects[k]] = o.hits.instance[k] != k_none;
}

// Nothing is written to `results` if any ray is an error.
void occluded(const SceneObject& s, const RayBuffers& rays, bool traces, const Buffer<uint8_t>& results,
              AnswerCounts& counts) {
  const size_t count = rays.count();
  const std::unique_ptr<uint8_t[]> answers(new uint8_t[count]);
  std::atomic<uint64_t> all_exact = 0;
  for_chunks(*s.device, count, [&](size_t begin, size_t end) {
    OcclusionScratch& own = scratch();
    ShadowBatch& batch = own.batch;
    ShadowGroup& group = own.group;
    Bounds3 origins;
    fill(s, rays, begin, end, batch, origins, group.light);
    Stats stats;
    if (!origins.empty()) {
      s.shadows->find_ray_candidates(origins, group);
      if (traces) {
        s.shadows->answer({group, batch, stats});
        if (rays.from) unblock_flat_origins(s, own);
      } else {
        s.shadows->look_up(group, batch, stats);
      }
    }
    const uint8_t *const exact = batch.exact.data(), *const blocked = batch.blocked.data();
    uint8_t* const out = answers.get() + begin;
    uint32_t undecided = 0;
    for (size_t i = 0; i < end - begin; ++i) {
      undecided += exact[i];
      out[i] = uint8_t(!traces && exact[i] ? FT_UNDECIDED_OCCLUSION : blocked[i] ? FT_BLOCKED : FT_CLEAR);
    }
    all_exact.fetch_add(undecided, std::memory_order_relaxed);
  });
  if (results.stride() == 1) {
    std::copy_n(answers.get(), count, results.at(0));
  } else {
    for (size_t i = 0; i < count; ++i) *results.at(i) = answers[i];
  }
  counts.add(count, count - all_exact);
}

FTError occlusion(FTScene scene, const char* name, bool traces, const float* origins, size_t origin_stride,
                  const float* directions, size_t direction_stride, const float* t_max, size_t t_max_stride,
                  const uint32_t* from, size_t from_stride, size_t count, uint8_t* results, size_t result_stride) {
  return guarded(scene, [&](SceneObject& s) {
    const RayBuffers rays = {{"origins", origins, origin_stride, count},
                             {"directions", directions, direction_stride, count},
                             {"t_max", t_max, t_max_stride, count},
                             {"from", from, from_stride, count}};
    const Buffer<uint8_t> answers("results", results, result_stride, count);
    rays.origins.needed(), rays.directions.needed(), answers.needed();
    require_apart(answers, rays.origins, rays.directions, rays.t_max, rays.from);
    const std::shared_lock lock(s.mutex);
    s.require_commit(name);
    if (count > 0) occluded(s, rays, traces, answers, s.occlusion_counts);
  });
}

struct HitBuffers {
  Buffer<uint8_t> status;
  Buffer<float> t;
  Buffer<float, 3> normals;
  Buffer<uint32_t> primitives, instances;
};

struct HitScratch {
  RayBatch rays;
  HitBatch hits;
  std::vector<PathState> paths;
  std::vector<uint32_t> which;
  std::vector<uint32_t> from;  // empty: no ray leaves an instance
  std::vector<Vec3> normals;
  std::vector<float> errors;
  std::vector<uint8_t> undecided, traced;  // traced: by an exact ray alone
  std::vector<double> lengths;
  HitWorkspace work;
};
// Of this thread; not inlined, as scratch().
[[gnu::noinline]] HitScratch& hit_scratch() {
  thread_local HitScratch s;
  return s;
}

// The hits of the rays of a chunk, with errors in t.
void find_hits(const SceneObject& s, HitScratch& h) {
  const size_t n = h.rays.size;
  h.hits.resize(n);
  std::fill(h.hits.instance.begin(), h.hits.instance.end(), k_none);
  h.undecided.assign(n, 0);
  h.traced.assign(n, 0);
  h.errors.assign(n, 0.0f);
  h.normals.assign(n, Vec3(0.0f));
  Stats stats;
  if (s.hits) {
    h.work.exact.clear();
    s.hits->look_up(h.rays, h.paths, h.which, h.hits, h.work, stats);
    for (const uint32_t i : h.work.exact) h.undecided[i] = 1;
    for (const uint32_t i : h.which)
      h.traced[i] = h.hits.instance[i] != k_none && !s.has_certified_hits[h.hits.instance[i]];
    for (const CertifiedHit& hit : h.work.certified) {
      const float cosine = std::abs(glm::dot(hit.normal, h.rays.direction(hit.ray)));
      h.normals[hit.ray] = hit.normal;
      h.errors[hit.ray] = hit.error / std::max(cosine, std::numeric_limits<float>::min());
    }
  } else {
    for (const uint32_t i : h.which) h.traced[i] = 1;
    s.accel->intersect(h.rays, h.hits, Coherence::incoherent);
  }
  if (!h.from.empty()) pass_flat_origins(s, h.rays, h.from, h.hits);
  for (const uint32_t i : h.which) {
    if (h.undecided[i] || h.hits.instance[i] == k_none || h.normals[i] != Vec3(0.0f)) continue;
    const Vec3 normal = surface_at(s.scene, h.rays, h.hits, i).geometric_normal;
    h.normals[i] = glm::dot(normal, h.rays.direction(i)) > 0.0f ? -normal : normal;
  }
}

// Status of ray i with its largest t, in unit steps.
FTHit status_of(const HitScratch& h, size_t i, double t_max) {
  if (!(t_max >= 0.0)) return FT_MISS;
  if (h.undecided[i]) return FT_UNDECIDED_HIT;
  if (h.hits.instance[i] == k_none) return FT_MISS;
  const double t = double(h.hits.t[i]), error = double(h.errors[i]);
  if (t - error > t_max) return FT_MISS;
  return t + error <= t_max || error == 0.0 ? FT_HIT : FT_UNDECIDED_HIT;
}

void nearest(const SceneObject& s, float alpha, const RayBuffers& rays, const HitBuffers& out, AnswerCounts& counts) {
  for_chunks(*s.device, rays.count(), [&](size_t begin, size_t end) {
    HitScratch& h = hit_scratch();
    h.rays.resize(end - begin);
    h.paths.assign(end - begin, {});
    h.from.clear();
    h.lengths.assign(end - begin, 1.0);
    h.which.clear();
    for (size_t i = begin; i < end; ++i) {
      const size_t j = i - begin;
      const Vec3 d = unit(vector_at(rays.directions, i), h.lengths[j]);
      const bool active = rays.t_of(i) >= 0.0f;
      h.rays.set(j, vector_at(rays.origins, i), d, active ? k_infinity : -1.0f);
      h.paths[j].alpha = alpha;
      h.paths[j].unweighted = false;
      h.paths[j].instance = rays.instance_of(i);
      if (rays.from) h.from.push_back(h.paths[j].instance);
      if (active) h.which.push_back(uint32_t(j));
    }
    find_hits(s, h);
    uint64_t certified = 0;
    for (size_t i = begin; i < end; ++i) {
      const size_t j = i - begin;
      const FTHit status = status_of(h, j, double(rays.t_of(i)) * h.lengths[j]);
      certified += status != FT_UNDECIDED_HIT && !h.traced[j];
      *out.status.at(i) = uint8_t(status);
      if (status != FT_HIT) continue;
      if (out.t) *out.t.at(i) = float(double(h.hits.t[j]) / h.lengths[j]);
      if (out.normals) std::copy_n(&h.normals[j].x, 3, out.normals.at(i));
      if (out.primitives) *out.primitives.at(i) = h.hits.primitive[j];
      if (out.instances) *out.instances.at(i) = h.hits.instance[j];
    }
    counts.add(end - begin, certified);
  });
}

}  // namespace

FTError ftOccluded(FTScene scene, const float* origins, size_t origin_stride, const float* directions,
                   size_t direction_stride, const float* t_max, size_t t_max_stride, const uint32_t* from,
                   size_t from_stride, size_t count, uint8_t* results, size_t result_stride) {
  return occlusion(scene, "ftOccluded", true, origins, origin_stride, directions, direction_stride, t_max, t_max_stride,
                   from, from_stride, count, results, result_stride);
}

FTError ftOccludedCertified(FTScene scene, const float* origins, size_t origin_stride, const float* directions,
                            size_t direction_stride, const float* t_max, size_t t_max_stride, const uint32_t* from,
                            size_t from_stride, size_t count, uint8_t* results, size_t result_stride) {
  return occlusion(scene, "ftOccludedCertified", false, origins, origin_stride, directions, direction_stride, t_max,
                   t_max_stride, from, from_stride, count, results, result_stride);
}

FTError ftNearest(FTScene scene, float max_error, const float* origins, size_t origin_stride, const float* directions,
                  size_t direction_stride, const float* t_max, size_t t_max_stride, const uint32_t* from,
                  size_t from_stride, size_t count, uint8_t* status, size_t status_stride, float* t, size_t t_stride,
                  float* normals, size_t normal_stride, uint32_t* primitives, size_t primitive_stride,
                  uint32_t* instances, size_t instance_stride) {
  return guarded(scene, [&](SceneObject& s) {
    const RayBuffers rays = {{"origins", origins, origin_stride, count},
                             {"directions", directions, direction_stride, count},
                             {"t_max", t_max, t_max_stride, count},
                             {"from", from, from_stride, count}};
    const HitBuffers out = {{"status", status, status_stride, count},
                            {"t", t, t_stride, count},
                            {"normals", normals, normal_stride, count},
                            {"primitives", primitives, primitive_stride, count},
                            {"instances", instances, instance_stride, count}};
    rays.origins.needed(), rays.directions.needed(), out.status.needed();
    const auto apart_from_rays = [&](const auto& result) {
      require_apart(result, rays.origins, rays.directions, rays.t_max, rays.from);
    };
    apart_from_rays(out.status), apart_from_rays(out.t), apart_from_rays(out.normals);
    apart_from_rays(out.primitives), apart_from_rays(out.instances);
    require_apart(out.status, out.t, out.normals, out.primitives, out.instances);
    require_apart(out.t, out.normals, out.primitives, out.instances);
    require_apart(out.normals, out.primitives, out.instances);
    require_apart(out.primitives, out.instances);
    require(max_error > 0.0f && max_error <= 1.0f, "ftNearest: max_error must lie within (0, 1]");
    const std::shared_lock lock(s.mutex);
    s.require_commit("ftNearest");
    for_chunks(*s.device, count, [&](size_t begin, size_t end) { require_rays(s, rays, begin, end); });
    const float tolerance = s.base_tolerance();
    const float alpha = tolerance > 0.0f ? max_error / (k_blur_of_tolerance * tolerance) : max_error;
    nearest(s, alpha, rays, out, s.hit_counts);
  });
}
