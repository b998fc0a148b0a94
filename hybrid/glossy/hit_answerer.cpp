#include "hybrid/glossy/hit_answerer.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "field/bake/bake.h"
#include "field/bake/bake_full.h"
#include "field/query/query.hd.h"
#include "hybrid/visibility/query_and_bake.h"
#include "hybrid/visibility/shadow_answerer.h"
#include "hybrid/visibility/shadow_instance.h"

namespace fieldtrace {
namespace {

// An answer counts as wrong beyond this many error bounds, or beyond the lobe's spread of directions.
constexpr float k_wrong_errors = 4.0f;
constexpr float k_lobe_spread = 2.0f;

// How far, per unit of tolerance, a plane fit's normal may deviate from the surface's, in tangents of the lobe's
// spread: at the default 0.2 % of hits are off by more than that spread (docs/decisions/016-certified-hits.md).
constexpr float k_bend_of_tolerance = 8.0f;

// Largest distance from a cell's centre to its corner, in mean edges of a textured mesh.
constexpr double k_texture_edges = 4.0;

// Where a line meets the plane of a triangle.
struct PlaneHit {
  double t = 0.0, u = 0.0, v = 0.0;  // t: along the line; u, v: barycentric, of the second and third corners
  bool inside = false;
  double altitude = 0.0;  // shortest of the triangle
};

PlaneHit meet_plane(const TriangleMesh& mesh, uint32_t primitive, const DVec3& origin, const DVec3& direction) {
  const UVec3 index = mesh.triangles[primitive];
  const DVec3 p0 = mesh.positions[index.x];
  const DVec3 e1 = DVec3(mesh.positions[index.y]) - p0, e2 = DVec3(mesh.positions[index.z]) - p0, e3 = e2 - e1;
  const DVec3 normal = glm::cross(e1, e2);
  const double squared = glm::dot(normal, normal), slope = glm::dot(normal, direction);
  PlaneHit hit;
  if (!(squared > 0.0)) return hit;
  hit.altitude = std::sqrt(squared / std::max({glm::dot(e1, e1), glm::dot(e2, e2), glm::dot(e3, e3)}));
  if (slope == 0.0) return hit;
  hit.t = glm::dot(normal, p0 - origin) / slope;
  const DVec3 beside = origin + hit.t * direction - p0;
  hit.u = glm::dot(glm::cross(beside, e2), normal) / squared;
  hit.v = glm::dot(glm::cross(e1, beside), normal) / squared;
  hit.inside = hit.u >= 0.0 && hit.v >= 0.0 && hit.u + hit.v <= 1.0;
  return hit;
}

// World space, unit; on either side of the triangle.
Vec3 triangle_normal(const Scene& scene, uint32_t instance_index, uint32_t primitive) {
  const Instance& instance = scene.instances[instance_index];
  const TriangleMesh& mesh = scene.shapes[instance.shape].mesh;
  const UVec3 index = mesh.triangles[primitive];
  const auto edge = [&](uint32_t corner) {
    return DVec3(transform_vector(instance.to_world, mesh.positions[corner] - mesh.positions[index.x]));
  };
  return Vec3(glm::normalize(glm::cross(edge(index.y), edge(index.z))));
}

// Half of the angle over which a lobe reflects.
float spread_of(float alpha) { return std::min(k_lobe_spread * std::atan(alpha), 0.5f * k_pi * (1.0f - 0x1p-10f)); }

// Whether either side does.
bool lets_light_through(const Scene& scene, uint32_t bsdf) {
  for (uint32_t b = bsdf; b != k_none; b = scene.bsdfs[b].back) {
    if (scene.bsdfs[b].opacity != k_none || transmits(scene.bsdfs[b].kind)) return true;
  }
  return false;
}

double mean_edge(const TriangleMesh& mesh) {
  double area = 0.0;
  for (const UVec3& t : mesh.triangles) {
    const Vec3 a = mesh.positions[t.x];
    area += 0.5 * double(glm::length(glm::cross(mesh.positions[t.y] - a, mesh.positions[t.z] - a)));
  }
  return std::sqrt(2.0 * area / double(std::max<size_t>(mesh.triangles.size(), 1)));
}

// Whether texture coordinates found at the centre of a cell can be extrapolated to its corners.
bool cells_resolve_textures(const Shape& shape, const FieldParameters& parameters) {
  const double corner = double(field_ball(shape.bounds).radius) * std::sqrt(2.0) / parameters.plane;
  return corner <= k_texture_edges * mean_edge(shape.mesh);
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
  double half_cell = 0.0;    // half the width of a cell, object space
};

struct HitAnswerer::Nearest {
  Verdict verdict = Verdict::miss;
  int object = -1;       // of a certified hit; -1: the nearest hit was traced, or the ray misses
  bool crossed = false;  // whether the ray meets some object's ball
  // Where a certified hit lies on the very triangle that its cell stores: its exact place, as good as a traced hit.
  bool on_triangle = false;
  float t = 0.0f, u = 0.0f, v = 0.0f;
};

std::vector<uint32_t> HitAnswerer::suited_instances(const Scene& scene, std::span<const ShapeTraits> traits,
                                                    const FieldParameters& parameters, size_t fewest_triangles) {
  std::vector<uint32_t> suited;
  for (uint32_t i = 0; i < scene.instances.size(); ++i) {
    const Instance& instance = scene.instances[i];
    const Shape& shape = scene.shapes[instance.shape];
    if (!traits[instance.shape].wants_field || shape.triangle_count() < fewest_triangles) continue;
    if (instance.emitter != k_none || lets_light_through(scene, instance.bsdf)) continue;
    if (is_textured(scene, instance.bsdf) && !cells_resolve_textures(shape, parameters)) continue;
    suited.push_back(i);
    if (suited.size() > k_most_candidates) return {};
  }
  return suited;
}

double HitAnswerer::estimated_bake_rays(const FieldParameters& p) {
  return double(reachable_cells(p, FieldLayer::visibility)) * p.lines +
         double(reachable_cells(p, FieldLayer::depth)) * (p.lines + 2);
}

HitAnswerer::HitAnswerer(const Scene& scene, const Accel& accel, std::span<const ShapeTraits> traits,
                         const std::vector<Field*>& fields, std::span<const uint32_t> instances,
                         const AnswererSettings& settings)
    : scene_(scene),
      accel_(accel),
      kernels_(segment_kernels(settings.isa)),
      tolerance_(settings.tolerance),
      check_(settings.check),
      demands_(settings.demands),
      is_object_(scene.instances.size(), 0) {
  for (const uint32_t i : instances) {
    const uint32_t shape = scene.instances[i].shape;
    Field* field = fields[shape];
    objects_.push_back({make_shadow_instance(scene, i, traits[shape], field, nullptr, settings).cone.segment, field,
                        transform_point(scene.instances[i].to_world, field->ball().centre),
                        double(field->ball().radius) / field->parameters().plane});
    is_object_[i] = 1;
  }
  std::vector<uint32_t> others;
  for (uint32_t i = 0; i < scene.instances.size(); ++i) {
    if (!is_object_[i]) others.push_back(i);
  }
  if (!others.empty()) others_ = accel.group(others);
}

HitAnswerer::~HitAnswerer() = default;

bool HitAnswerer::bake(const Object& object, HitUnknowns& unknowns, Stats& stats) const {
  BakeCounters counters;
  const uint32_t shape = scene_.instances[object.task.instance].shape;
  bool goes_on = false;
  const auto bake_layer = [&](FieldLayer layer, std::vector<uint32_t>& slices) {
    keep_due(demands_, shape, layer, slices);
    goes_on = goes_on || !slices.empty();
    if (!slices.empty()) bake_slices(*object.field, layer, slices, accel_, shape, counters);
  };
  bake_layer(FieldLayer::visibility, unknowns.visibility);
  bake_layer(FieldLayer::depth, unknowns.depth);
  bake_layer(FieldLayer::primitive, unknowns.primitive);
  stats.add_bake(counters);
  return goes_on && !object.field->pool_full();
}

void HitAnswerer::trace_others(HitWorkspace& work) const {
  HitQueries& queries = work.queries;
  const size_t n = queries.rays.size;
  std::fill(queries.limit.begin(), queries.limit.end(), k_infinity);
  work.others.resize(n);
  std::fill_n(work.others.instance.begin(), n, k_none);
  if (!others_) return;
  accel_.intersect(*others_, queries.rays, work.others, Coherence::incoherent);
  for (size_t j = 0; j < n; ++j) {
    if (work.others.instance[j] != k_none) queries.limit[j] = work.others.t[j];
  }
}

// By the distance of their balls from the first ray's origin. The order changes only how many look-ups are wasted, not
// the answers.
void HitAnswerer::order_objects(HitWorkspace& work) const {
  const Vec3 origin = work.queries.rays.origin(0);
  work.front_to_back.resize(objects_.size());
  std::iota(work.front_to_back.begin(), work.front_to_back.end(), 0u);
  const auto distance = [&](uint32_t k) { return glm::length(objects_[k].centre - origin); };
  std::sort(work.front_to_back.begin(), work.front_to_back.end(),
            [&](uint32_t a, uint32_t b) { return distance(a) < distance(b); });
}

void HitAnswerer::query_object(const Object& object, HitAnswers& answers, HitWorkspace& work, Stats& stats) const {
  HitQueries& queries = work.queries;
  const size_t n = queries.rays.size;
  answers.resize(n);
  query_and_bake(
      n, work.unknowns,
      [&](std::span<const uint32_t> blocks) {
        stats.lookups += kernels_.nearest_hits(object.task, queries, blocks, answers, work.unknowns);
      },
      [&] { return bake(object, work.unknowns, stats); });
  // Without room to bake, or while bakes wait.
  for (const uint32_t block : work.unknowns.blocks) {
    for (uint32_t j = block; j < block + k_batch_padding; ++j) {
      int32_t& verdict = answers.verdict[j];
      if (verdict == scalar::k_verdict_unknown_visibility || verdict == scalar::k_verdict_unknown_depth)
        verdict = scalar::k_verdict_undecided;
    }
  }
  for (size_t j = 0; j < n; ++j) {
    if (answers.verdict[j] != scalar::k_verdict_blocked) continue;
    queries.limit[j] = std::min(queries.limit[j], std::max(answers.t[j] + answers.error[j], answers.from[j]));
  }
}

void HitAnswerer::query(HitWorkspace& work, Stats& stats) const {
  trace_others(work);
  order_objects(work);
  work.answers.resize(objects_.size());
  for (const uint32_t k : work.front_to_back) query_object(objects_[k], work.answers[k], work, stats);
}

HitAnswerer::Nearest HitAnswerer::put_together(const HitWorkspace& work, size_t j) const {
  const float limit = work.queries.limit[j];  // the nearest surface lies no farther
  Nearest nearest;
  int candidates = work.others.instance[j] != k_none && work.others.t[j] <= limit ? 1 : 0;
  for (size_t k = 0; k < objects_.size(); ++k) {
    const HitAnswers& a = work.answers[k];
    if (a.verdict[j] == scalar::k_verdict_none) continue;
    nearest.crossed = true;
    if (a.verdict[j] == scalar::k_verdict_clear || a.from[j] > limit) continue;
    if (a.verdict[j] == scalar::k_verdict_undecided) nearest.verdict = Verdict::undecided;
    nearest.object = int(k);
    ++candidates;
  }
  if (candidates > 1) nearest.verdict = Verdict::undecided;  // their order is unknown
  if (nearest.verdict != Verdict::undecided && nearest.object >= 0) find_triangle(work, j, nearest);
  return nearest;
}

// A triangle wider than half a cell must be the very one that the ray meets: a plane fit over a few such triangles
// smooths their edges away. Among smaller ones normals vary so much within a cell that its error bound reflects it.
void HitAnswerer::find_triangle(const HitWorkspace& work, size_t j, Nearest& nearest) const {
  const Object& object = objects_[size_t(nearest.object)];
  const HitAnswers& a = work.answers[size_t(nearest.object)];
  const Instance& instance = scene_.instances[object.task.instance];
  const RayBatch& rays = work.queries.rays;
  const PlaneHit hit = meet_plane(scene_.shapes[instance.shape].mesh, uint32_t(a.primitive[j]),
                                  DVec3(transform_point(instance.to_object, rays.origin(j))),
                                  DVec3(transform_vector(instance.to_object, rays.direction(j))));
  // Near a silhouette a ray could meet the triangle from behind.
  const Vec3 fit_normal(a.nx[j], a.ny[j], a.nz[j]);
  const Vec3 normal = triangle_normal(scene_, object.task.instance, uint32_t(a.primitive[j]));
  const bool faces = (glm::dot(normal, fit_normal) > 0.0f) == (glm::dot(normal, rays.direction(j)) < 0.0f);
  nearest.on_triangle = hit.inside && faces && hit.t > 0.0 && std::abs(hit.t - double(a.t[j])) <= double(a.error[j]);
  nearest.t = float(hit.t), nearest.u = float(hit.u), nearest.v = float(hit.v);
  nearest.verdict = nearest.on_triangle || hit.altitude <= object.half_cell ? Verdict::hit : Verdict::undecided;
}

bool HitAnswerer::is_wrong(const HitWorkspace& work, size_t j, const Nearest& nearest, float alpha) const {
  const uint32_t found = work.found.instance[j];
  if (nearest.verdict == Verdict::miss) return found != k_none && is_object_[found];
  const HitAnswers& a = work.answers[size_t(nearest.object)];
  if (found != objects_[size_t(nearest.object)].task.instance) return true;
  const float t = nearest.on_triangle ? nearest.t : a.t[j];
  if (std::abs(work.found.t[j] - t) > k_wrong_errors * a.error[j]) return true;
  const Vec3 normal = surface_at(scene_, work.queries.rays, work.found, j).geometric_normal;
  Vec3 answered(a.nx[j], a.ny[j], a.nz[j]);
  if (nearest.on_triangle) answered = triangle_normal(scene_, found, uint32_t(a.primitive[j]));
  const float cosine = std::abs(glm::dot(normal, answered));
  return cosine < std::cos(spread_of(alpha));
}

void HitAnswerer::check_answers(std::span<const PathState> paths, HitWorkspace& work, Stats& stats) const {
  const size_t n = work.queried.size();
  work.found.resize(n);
  accel_.intersect(work.queries.rays, work.found, Coherence::incoherent);
  for (size_t j = 0; j < n; ++j) {
    const PathState& path = paths[work.queried[j]];
    const Nearest nearest = put_together(work, j);
    if (nearest.verdict == Verdict::undecided || !nearest.crossed) continue;
    const bool is_hit = nearest.verdict == Verdict::hit;
    const bool self = is_hit ? objects_[size_t(nearest.object)].task.instance == path.instance
                             : path.instance != k_none && is_object_[path.instance];
    stats.add_check(is_hit ? CheckedVerdict::hit : CheckedVerdict::miss, CheckedBundle::cell, self,
                    is_wrong(work, j, nearest, path.alpha));
  }
}

// Sorts `which` into glossy rays to be looked up, in an order that suits look-ups, and others, which are exact.
void HitAnswerer::choose_queried(const RayBatch& rays, std::span<const PathState> paths,
                                 std::span<const uint32_t> which, HitWorkspace& work) const {
  work.queried.clear();
  work.exact.clear();
  for (const uint32_t i : which)
    (paths[i].alpha > 0.0f && !paths[i].unweighted ? work.queried : work.exact).push_back(i);
  order_by_direction(rays, work.queried, work.order);
  HitQueries& queries = work.queries;
  queries.resize(work.queried.size());
  for (size_t j = 0; j < work.queried.size(); ++j) {
    const PathState& path = paths[work.queried[j]];
    queries.rays.copy(j, rays, work.queried[j]);
    queries.instance[j] = path.instance;
    queries.most_error[j] = k_blur_of_tolerance * tolerance_ * path.alpha;
    queries.most_bend[j] = k_bend_of_tolerance * tolerance_ * std::tan(spread_of(path.alpha));
  }
}

// Writes the certified answers; the undecided rays become exact.
void HitAnswerer::settle(HitBatch& hits, HitWorkspace& work, Stats& stats) const {
  for (size_t j = 0; j < work.queried.size(); ++j) {
    const uint32_t i = work.queried[j];
    const Nearest nearest = put_together(work, j);
    if (nearest.verdict == Verdict::undecided) {
      work.exact.push_back(i);
      continue;
    }
    stats.rays_glossy_hits += nearest.crossed;
    if (nearest.verdict == Verdict::miss) {
      hits.copy(i, work.others, j);
      continue;
    }
    const HitAnswers& a = work.answers[size_t(nearest.object)];
    const Vec3 normal(a.nx[j], a.ny[j], a.nz[j]);
    hits.instance[i] = objects_[size_t(nearest.object)].task.instance;
    hits.primitive[i] = uint32_t(a.primitive[j]);
    if (nearest.on_triangle) {
      hits.t[i] = nearest.t, hits.u[i] = nearest.u, hits.v[i] = nearest.v;
      continue;
    }
    hits.t[i] = a.t[j];
    work.certified.push_back({i, normal, a.error[j] * std::abs(glm::dot(normal, work.queries.rays.direction(j)))});
  }
}

void HitAnswerer::look_up(const RayBatch& rays, std::span<const PathState> paths, std::span<const uint32_t> which,
                          HitBatch& hits, HitWorkspace& work, Stats& stats) const {
  work.certified.clear();
  choose_queried(rays, paths, which, work);
  if (work.queried.empty()) return;
  query(work, stats);
  if (check_) check_answers(paths, work, stats);
  settle(hits, work, stats);
}

void HitAnswerer::intersect(const RayBatch& rays, std::span<const PathState> paths, std::span<const uint32_t> which,
                            HitBatch& hits, HitWorkspace& work, Stats& stats) const {
  look_up(rays, paths, which, hits, work, stats);
  for (const uint32_t i : work.exact) stats.rays_glossy_exact += !paths[i].diffuse;
  intersect_subset(accel_, rays, work.exact, hits, work.some);
}

}  // namespace fieldtrace
