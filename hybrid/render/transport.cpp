#include "hybrid/render/transport.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <numeric>

#include "core/material/conductor_samples.h"
#include "core/math/finite.h"
#include "core/sampling/sobol.hd.h"
#include "core/surface/surfaces.h"
#include "hybrid/glossy/hit_answerer.h"
#include "hybrid/glossy/lobe_answerer.h"
#include "hybrid/light/ambient_occlusion.h"
#include "hybrid/light/direct_light.h"
#include "hybrid/stats/stopwatch.h"

namespace fieldtrace {
namespace {

// A sample stream separate from that of the lights, which use the vertex seeds unchanged.
constexpr uint32_t k_material_stream = 0x42534446u;
// With fewer samples at a surface, most lanes would be empty.
constexpr uint32_t k_fewest_lane_samples = 4;

Vec2 sample_pair(uint32_t index, uint32_t seed, uint32_t dimension) {
  const auto p = scalar::sample_2d(index, seed, dimension);
  return {p.x, p.y};
}

float largest(const Rgb& c) { return std::max({c.x, c.y, c.z}); }

}  // namespace

struct TransportWorker::Impl {
  const TransportContext& context;
  const Scene& scene;
  const TransportSettings& settings;
  Surfaces surfaces;
  DirectLight direct;
  AmbientOcclusion occlusion;
  Stats stats;

  RayBatch rays, next_rays;
  HitBatch hits;
  std::vector<PathState> paths, next_paths;
  // Between calls: what generate() made. Nothing changes these paths, so most members are still those of new ones.
  std::vector<PathState> camera_paths;
  // By camera ray. The three members of a camera path that differ from a new one's are set where a path is needed.
  AlignedVector<uint32_t> pixel_seeds, vertex_seeds;
  std::span<const uint32_t> sample_indices;
  std::vector<PathVertex> vertex_storage;  // never shrinks, because new vertices cost time
  std::span<PathVertex> vertices;
  std::vector<SurfacePoint> vertex_surfaces;
  std::vector<Material> resolved;  // of vertices on textured surfaces
  LobeSamples lobe_samples;
  LightReceivers receivers;
  std::vector<FirstHit> firsts;
  AlignedVector<float> near_distance;  // per camera ray
  LobeWorkspace lobe_work;
  std::vector<uint32_t> all_rays;
  std::vector<HitRun> runs, exact_runs;        // hits; those whose surface is looked up
  std::vector<const CertifiedHit*> certified;  // by ray; null: exact. Empty if all are
  std::span<Rgb> radiance;                     // by slot
  std::vector<Rgb> follow_radiance;

  explicit Impl(const TransportContext& c)
      : context(c),
        scene(c.scene),
        settings(c.settings),
        surfaces(c.scene, c.materials, c.settings.isa),
        direct(c),
        occlusion(c) {}

  void generate(const CameraSamples& samples);
  void pass_hidden_emitters();
  void intersect(int vertex_number);
  bool answers_lobes(int vertex_number) const;
  void record_reflections();
  void intersect_all(int vertex_number);
  void intersect_lobes();
  void intersect_by_hits();
  void mark_certified();
  void find_surfaces(bool only_emission);
  void arrive(int vertex_number);
  // What the rays that hit one instance share.
  struct MetInstance {
    uint32_t index = k_none, emitter = k_none, bsdf = 0;
    const Material *sides = nullptr, *diffuse_sides = nullptr;  // see MaterialTable
  };
  MetInstance met_instance(uint32_t index) const {
    const Instance& instance = scene.instances[index];
    return {index, instance.emitter, instance.bsdf, context.materials.sides(instance.bsdf),
            context.materials.diffuse_sides(instance.bsdf)};
  }
  // What arrive() knows about all paths of a wave.
  struct Arrival {
    int vertex_number = 0;
    bool is_first = false, emission_counts = false, shows_first_hit = false, last = false, diffuse_goes_on = false;
    uint32_t pixel_seed = 0, seed = scalar::vertex_seed(0, 0);  // of the path that was met last
    size_t vertices = 0;
    uint32_t seed_of(const PathState& path) {
      if (path.pixel_seed != pixel_seed) {
        pixel_seed = path.pixel_seed;
        seed = scalar::vertex_seed(pixel_seed, uint32_t(vertex_number));
      }
      return seed;
    }
  };
  PathState& arriving_path(const Arrival& arrival, uint32_t i);
  void meet_backgrounds(const Arrival& arrival, uint32_t begin, uint32_t end);
  void meet_emitter(const Arrival& arrival, const HitRun& run, uint32_t emitter);
  void meet_surface(Arrival& arrival, const HitRun& run, const MetInstance& instance);
  int side_of_all(const HitRun& run) const;
  void add_run(Arrival& arrival, const HitRun& run, const MetInstance& instance, int side);
  void add_vertex(Arrival& arrival, uint32_t i, const MetInstance& instance);
  void shade_vertex(const MetInstance& instance, const Vec3& d, float cos_geometric, bool diffuse_goes_on,
                    PathVertex& v);
  void record_first_hit(uint32_t path, const PathVertex& vertex);
  bool survives_roulette(PathState& path, uint32_t seed, int vertex_number) const;
  void add_emission(const PathState& path, const Vec3& origin, const Vec3& direction, uint32_t light,
                    const LightHit& hit);
  void gather_light(int vertex_number);
  void scatter(int vertex_number);
  void go_on(int vertex_number);
  bool goes_on(bool is_diffuse, int vertex_number) const;
  PathState leave(const PathVertex& vertex, int vertex_number) const;
  PathState& send(const PathVertex& vertex, const PathState& leaving, const Vec3& direction);
  void scatter_once(const PathVertex& vertex, const PathState& leaving, uint32_t index);
  void scatter_lobe(const PathVertex& vertex, const PathState& leaving, uint32_t first);
};

void TransportWorker::Impl::generate(const CameraSamples& samples) {
  const ScopedTimer timer(stats.time_primary);
  context.camera.sample(samples, settings.seed, settings.isa, rays, near_distance);
  paths.swap(camera_paths);
  paths.resize(samples.size);
  firsts.assign(settings.first_hits ? samples.size : 0, FirstHit{});
  sample_indices = {samples.index.data(), samples.size};
  pixel_seeds.resize(samples.size);
  vertex_seeds.resize(samples.size);
  for (size_t begin = 0, end = 0; begin < samples.size; begin = end) {
    const uint32_t x = samples.x[begin], y = samples.y[begin];
    for (end = begin + 1; end < samples.size && samples.x[end] == x && samples.y[end] == y;) ++end;
    const uint32_t seed = scalar::pixel_seed(settings.seed, x, y);
    std::fill_n(&pixel_seeds[begin], end - begin, seed);
    std::fill_n(&vertex_seeds[begin], end - begin, scalar::vertex_seed(seed, 0));
  }
}

void TransportWorker::Impl::intersect(int vertex_number) {
  stats.rays_primary += rays.size;
  lobe_work.hits.certified.clear();
  if (answers_lobes(vertex_number)) {
    intersect_lobes();
  } else if (context.hits && vertex_number > 0) {
    intersect_by_hits();
  } else {
    intersect_all(vertex_number);
  }
  mark_certified();
  if (settings.count_reflections && vertex_number == 1) record_reflections();
}

void TransportWorker::Impl::intersect_all(int vertex_number) {
  const ScopedTimer timer(vertex_number == 0 ? stats.time_primary : stats.time_secondary);
  hits.resize(rays.size);
  context.accel.intersect(rays, hits, vertex_number == 0 ? Coherence::coherent : Coherence::incoherent);
  if (vertex_number == 0) return;
  for (const PathState& path : paths) stats.rays_glossy_exact += !path.diffuse;
}

void TransportWorker::Impl::intersect_by_hits() {
  const double bake_before = stats.time_bake;
  {
    const ScopedTimer timer(stats.time_secondary);
    hits.resize(rays.size);
    all_rays.resize(rays.size);
    std::iota(all_rays.begin(), all_rays.end(), 0u);
    context.hits->intersect(rays, paths, all_rays, hits, lobe_work.hits, stats);
  }
  stats.time_secondary -= stats.time_bake - bake_before;
}

void TransportWorker::Impl::mark_certified() {
  certified.assign(context.hits ? rays.size : 0, nullptr);
  for (const CertifiedHit& hit : lobe_work.hits.certified) certified[hit.ray] = &hit;
}

// Maps hold the radiance that leaves the second surface of a path; only where path length is unlimited is it the same
// at every later surface.
bool TransportWorker::Impl::answers_lobes(int vertex_number) const {
  return context.lobes && (vertex_number == 1 || (vertex_number > 1 && settings.max_depth < 0));
}

void TransportWorker::Impl::intersect_lobes() {
  const double bake_before = stats.time_bake;
  {
    const ScopedTimer timer(stats.time_secondary);
    context.lobes->answer(rays, paths, hits, lobe_work, stats);
  }
  stats.time_secondary -= stats.time_bake - bake_before;
  for (const FilteredRay& filtered : lobe_work.filtered) {
    PathState& path = paths[filtered.ray];
    radiance[path.slot] += path.throughput * filtered.radiance;
    path.throughput *= filtered.clear;
  }
}

// For AOVs: what rays from first hits met; the map's object where it hides more than half of the ray.
void TransportWorker::Impl::record_reflections() {
  const bool by_maps = answers_lobes(1);
  std::vector<const FilteredRay*> filtered(paths.size(), nullptr);
  if (by_maps) {
    for (const FilteredRay& f : lobe_work.filtered) filtered[f.ray] = &f;
  }
  std::vector<uint8_t> is_exact(paths.size(), by_maps || context.hits ? 0 : 1);
  const std::vector<uint32_t>& exact = context.hits ? lobe_work.hits.exact : lobe_work.exact;
  if (by_maps || context.hits) {
    for (const uint32_t i : exact) is_exact[i] = 1;
  }
  for (size_t i = 0; i < paths.size(); ++i) {
    if (paths[i].diffuse) continue;
    FirstHit& first = firsts[paths[i].slot];
    if (filtered[i] && filtered[i]->clear < 0.5f) {
      first.add_reflection(true, filtered[i]->instance, filtered[i]->distance, false);
    } else {
      first.add_reflection(hits.instance[i] != k_none, hits.instance[i], hits.t[i], is_exact[i] != 0);
    }
  }
}

// Lets camera rays pass through area lights as if these were not there; only what the camera sees directly is affected.
void TransportWorker::Impl::pass_hidden_emitters() {
  for (int layer = 0; layer < k_longest_path; ++layer) {
    std::vector<uint32_t> hidden;
    for (uint32_t i = 0; i < rays.size; ++i) {
      if (hits.instance[i] != k_none && scene.instances[hits.instance[i]].emitter != k_none) hidden.push_back(i);
    }
    if (hidden.empty()) return;
    RayBatch beyond;
    beyond.resize(hidden.size());
    for (uint32_t j = 0; j < hidden.size(); ++j) {
      const uint32_t i = hidden[j];
      const SurfacePoint surface = surface_at(scene, rays, hits, i);
      const Vec3 d = rays.direction(i);
      beyond.set(j, offset_origin(surface.position, surface.geometric_normal, surface.error, d), d,
                 rays.tmax[i] - hits.t[i]);
      near_distance[i] += hits.t[i];
    }
    HitBatch beyond_hits;
    beyond_hits.resize(hidden.size());
    {
      const ScopedTimer timer(stats.time_primary);
      context.accel.intersect(beyond, beyond_hits, Coherence::coherent);
    }
    stats.rays_primary += hidden.size();
    for (uint32_t j = 0; j < hidden.size(); ++j) {
      const uint32_t i = hidden[j];
      rays.set(i, beyond.origin(j), beyond.direction(j), beyond.tmax[j]);
      hits.t[i] = beyond_hits.t[j], hits.u[i] = beyond_hits.u[j], hits.v[i] = beyond_hits.v[j];
      hits.instance[i] = beyond_hits.instance[j], hits.primitive[i] = beyond_hits.primitive[j];
    }
  }
}

// Adds emission of `light` that a path's ray has found.
void TransportWorker::Impl::add_emission(const PathState& path, const Vec3& origin, const Vec3& direction,
                                         uint32_t light, const LightHit& hit) {
  float weight = 1.0f;
  if (!path.unweighted) {
    if (path.diffuse && context.closed_form[light]) return;
    const float density = float(path.light_samples) *
                          light_pdf(context.lights, light, origin, path.normal, path.transmits, direction, hit);
    // As a quotient, because squares of large densities overflow.
    const float ratio = density / path.bsdf_density;
    weight = 1.0f / (1.0f + ratio * ratio);
  }
  radiance[path.slot] += path.throughput * emitted_radiance(context.lights, light, direction) * weight;
}

bool TransportWorker::Impl::survives_roulette(PathState& path, uint32_t seed, int vertex_number) const {
  if (vertex_number < settings.rr_depth) return true;
  // eta undoes the radiance scaling of refraction, which must not shorten paths; the cap ends every path eventually.
  constexpr float k_highest_survival = 0.95f;
  const float q = std::min(largest(path.throughput) * path.eta * path.eta, k_highest_survival);
  if (!(sample_pair(path.index, scalar::hash_combine(seed, k_material_stream), 1).y < q)) return false;
  path.throughput /= q;
  return true;
}

void TransportWorker::Impl::record_first_hit(uint32_t path, const PathVertex& vertex) {
  FirstHit& first = firsts[paths[path].slot];
  first.hit = true;
  first.albedo = material_albedo(*vertex.material);
  first.normal = vertex.frame.n;
  first.depth = near_distance[path] + hits.t[path];
  first.position = DVec3(vertex.surface->position) + scene.origin;
  first.object = vertex.surface->instance + 1;
  if (settings.occlusion) occlusion.add(vertex, paths[path].slot, paths[path].index);
}

// Evaluates `surfaces` where rays ended (with only_emission: on emitters only), and makes room for that many vertices.
void TransportWorker::Impl::find_surfaces(bool only_emission) {
  find_runs(hits, paths.size(), runs);
  if (only_emission) {
    std::erase_if(runs, [&](const HitRun& r) { return scene.instances[hits.instance[r.begin]].emitter == k_none; });
  }
  size_t count = 0;
  exact_runs.clear();
  for (const HitRun& run : runs) {
    count += run.end - run.begin;
    if (certified.empty()) continue;
    for (uint32_t i = run.begin; i < run.end; ++i) {
      if (!certified[i]) exact_runs.push_back({i, i + 1});
    }
  }
  surfaces.evaluate(rays, hits, certified.empty() ? runs : exact_runs);
  for (uint32_t i = 0; i < certified.size(); ++i) {
    if (certified[i]) surfaces.put(i, surface_of(scene, rays, hits, *certified[i]));
  }
  if (vertex_storage.size() < count) vertex_storage.resize(count);
  if (vertex_surfaces.size() < count) vertex_surfaces.resize(count);
  receivers.clear(count);
  resolved.clear();
  resolved.reserve(count);  // vertices point into it
}

inline PathState& TransportWorker::Impl::arriving_path(const Arrival& arrival, uint32_t i) {
  PathState& path = paths[i];
  if (arrival.is_first) path.slot = i, path.pixel_seed = pixel_seeds[i], path.index = sample_indices[i];
  return path;
}

// Adds emission where the rays ended, and collects the surfaces that take light samples and the vertices from which
// paths continue.
void TransportWorker::Impl::arrive(int vertex_number) {
  Arrival arrival{.vertex_number = vertex_number, .is_first = vertex_number == 0};
  arrival.seed = scalar::vertex_seed(arrival.pixel_seed, uint32_t(vertex_number));
  arrival.emission_counts = !(settings.hide_emitters && vertex_number == 0);
  arrival.shows_first_hit = vertex_number == 0 && settings.first_hits;
  // The last surface matters only if it emits, or is shown.
  arrival.last = settings.max_depth >= 0 && vertex_number + 1 >= settings.max_depth;
  arrival.diffuse_goes_on = goes_on(true, vertex_number);
  const bool only_emission = arrival.last && !arrival.shows_first_hit;
  find_surfaces(only_emission);
  uint32_t reached = 0;
  for (const HitRun& run : runs) {
    meet_backgrounds(arrival, reached, run.begin);
    reached = run.end;
    const MetInstance instance = met_instance(hits.instance[run.begin]);
    if (arrival.emission_counts && instance.emitter != k_none) meet_emitter(arrival, run, instance.emitter);
    if (!only_emission) meet_surface(arrival, run, instance);
  }
  meet_backgrounds(arrival, reached, uint32_t(paths.size()));
  vertices = std::span(vertex_storage).first(arrival.vertices);
}

void TransportWorker::Impl::meet_backgrounds(const Arrival& arrival, uint32_t begin, uint32_t end) {
  if (!arrival.emission_counts || context.backgrounds.empty()) return;
  for (uint32_t i = begin; i < end; ++i) {
    if (hits.instance[i] != k_none) continue;
    const PathState& path = arriving_path(arrival, i);
    for (const uint32_t light : context.backgrounds) add_emission(path, rays.origin(i), rays.direction(i), light, {});
  }
}

void TransportWorker::Impl::meet_emitter(const Arrival& arrival, const HitRun& run, uint32_t emitter) {
  for (uint32_t i = run.begin; i < run.end; ++i) {
    const SurfacePoint surface = surfaces.batch().at(hits, i);
    const Vec3 d = rays.direction(i);
    if (!(-glm::dot(surface.geometric_normal, d) > 0.0f)) continue;
    add_emission(arriving_path(arrival, i), rays.origin(i), d, emitter,
                 {hits.t[i], surface.geometric_normal, surface.primitive});
  }
}

// The side from which all rays of a run see their shading normals: 0 in front, 1 behind, -1 neither.
int TransportWorker::Impl::side_of_all(const HitRun& run) const {
  const SurfaceBatch& s = surfaces.batch();
  const float *dx = rays.dx.data(), *dy = rays.dy.data(), *dz = rays.dz.data();
  const float *sx = s.sx.data(), *sy = s.sy.data(), *sz = s.sz.data();
  uint32_t in_front = 0, behind = 0;
  for (size_t i = run.begin; i < run.end; ++i) {
    const float along = sx[i] * dx[i] + sy[i] * dy[i] + sz[i] * dz[i];
    in_front += along < 0.0f;
    behind += along > 0.0f;
  }
  const uint32_t size = run.end - run.begin;
  return in_front == size ? 0 : behind == size ? 1 : -1;
}

void TransportWorker::Impl::meet_surface(Arrival& arrival, const HitRun& run, const MetInstance& instance) {
  const bool is_simple = instance.diffuse_sides && !arrival.diffuse_goes_on && !arrival.shows_first_hit &&
                         (arrival.is_first || arrival.vertex_number < settings.rr_depth);
  if (!is_simple) {
    for (uint32_t i = run.begin; i < run.end; ++i) add_vertex(arrival, i, instance);
    return;
  }
  int side = side_of_all(run);
  for (uint32_t begin = run.begin, end = run.end; begin < run.end; begin = end, end = run.end) {
    if (side < 0 || begin > run.begin) {
      side = side_of_all({begin, begin + 1});
      for (end = begin + 1; end < run.end && side_of_all({end, end + 1}) == side;) ++end;
    }
    if (side >= 0 && !instance.diffuse_sides[side].dark) {
      add_run(arrival, {begin, end}, instance, side);
    } else {
      for (uint32_t i = begin; i < end; ++i) add_vertex(arrival, i, instance);
    }
  }
}

// Adds one side of a plainly diffuse surface, where paths end.
void TransportWorker::Impl::add_run(Arrival& arrival, const HitRun& run, const MetInstance& instance, int side) {
  const size_t first = receivers.add_run(rays, surfaces.batch(), run, instance.index, instance.diffuse_sides[side]);
  if (!instance.sides) {
    for (uint32_t i = run.begin; i < run.end; ++i) {
      const float cosine = side == 0 ? 1.0f : -1.0f;
      receivers.reflect(first + (i - run.begin),
                        resolve_material(scene, instance.bsdf, surfaces.batch().uv[i], cosine).reflectance);
    }
  }
  ShadingPointBatch& points = receivers.points;
  if (arrival.is_first) {
    const size_t count = run.end - run.begin;
    std::copy_n(&vertex_seeds[run.begin], count, &points.seed[first]);
    std::copy_n(&sample_indices[run.begin], count, &points.sample[first]);
    return;
  }
  for (uint32_t i = run.begin; i < run.end; ++i) {
    const size_t to = first + (i - run.begin);
    points.seed[to] = arrival.seed_of(paths[i]), points.sample[to] = paths[i].index;
  }
}

void TransportWorker::Impl::add_vertex(Arrival& arrival, uint32_t i, const MetInstance& instance) {
  PathState& path = arriving_path(arrival, i);
  const Vec3 d = rays.direction(i);
  PathVertex& v = vertex_storage[arrival.vertices];  // may hold leftovers of an earlier wave: all is overwritten
  SurfacePoint& surface = vertex_surfaces[arrival.vertices];
  surface = surfaces.batch().at(hits, i);
  v.path = i;
  v.surface = &surface;
  shade_vertex(instance, d, -glm::dot(surface.geometric_normal, d), arrival.diffuse_goes_on, v);
  v.seed = arrival.seed_of(path);
  if (arrival.shows_first_hit) record_first_hit(i, v);
  if (arrival.last || v.material->absorbs()) return;
  if (!arrival.is_first && !survives_roulette(path, v.seed, arrival.vertex_number)) return;
  v.lobe_samples = path.may_split && v.material->glossy() ? float(settings.lobe_samples) : 1.0f;
  const bool is_kept = arrival.diffuse_goes_on || !v.material->plain_diffuse();
  receivers.add(v, is_kept ? uint32_t(arrival.vertices) : k_none, path);
  arrival.vertices += is_kept;
}

// Resolves the material and the shading frame of a vertex from its surface and the arriving ray's direction.
inline void TransportWorker::Impl::shade_vertex(const MetInstance& instance, const Vec3& d, float cos_geometric,
                                                bool diffuse_goes_on, PathVertex& v) {
  const Vec3 back = -d;
  const float cosine = glm::dot(v.surface->shading_normal, back);
  if (instance.sides && (cosine < 0.0f || cosine > 0.0f)) {
    v.material = instance.sides + (cosine < 0.0f);
  } else {
    resolved.push_back(resolve_material(scene, instance.bsdf, v.surface->uv, cosine));
    v.material = &resolved.back();
  }
  v.frame.n = v.material->turned ? -v.surface->shading_normal : v.surface->shading_normal;
  v.facing = cos_geometric < 0.0f ? -v.surface->geometric_normal : v.surface->geometric_normal;
  if (v.material->plain_diffuse() && !diffuse_goes_on) return;  // light samples need no more
  const bool anisotropic = v.material->microfacet.alpha_u != v.material->microfacet.alpha_v;
  const Vec3 n = v.frame.n;
  v.frame = anisotropic ? frame_along(n, surface_tangent(scene, *v.surface)) : frame_about(n);
  v.wi = v.frame.to_local(back);
}

void TransportWorker::Impl::gather_light(int vertex_number) {
  const bool first = vertex_number == 0;
  direct.gather(receivers, vertices, first ? settings.light_samples : 1, first,
                first && settings.count_first_hits ? std::span(firsts) : std::span<FirstHit>(), stats);
  const auto arriving = [&r = receivers](size_t i) {
    return Rgb(r.arriving_red[i], r.arriving_green[i], r.arriving_blue[i]);
  };
  if (first) {  // slots are indices, throughputs are 1
    for (size_t i = 0; i < receivers.size(); ++i) radiance[receivers.path[i]] += arriving(i);
    return;
  }
  for (size_t i = 0; i < receivers.size(); ++i) {
    const PathState& path = paths[receivers.path[i]];
    radiance[path.slot] += path.throughput * arriving(i);
  }
}

// Whether a ray sampled from a material, plainly diffuse or not, can still find light that is not counted already.
bool TransportWorker::Impl::goes_on(bool is_diffuse, int vertex_number) const {
  if (vertex_number + 1 >= k_longest_path) return false;
  if (settings.max_depth < 0 || vertex_number + 2 < settings.max_depth) return true;
  return is_diffuse ? context.open_form_can_be_hit : context.emission_can_be_hit;
}

// The state that all paths leaving a vertex share.
PathState TransportWorker::Impl::leave(const PathVertex& vertex, int vertex_number) const {
  PathState next = paths[vertex.path];
  next.light_samples = vertex_number == 0 ? settings.light_samples : 1;
  next.diffuse = vertex.material->plain_diffuse();
  next.transmits = vertex.material->transmits();
  next.normal = vertex.frame.n;
  next.alpha = vertex.material->glossy() ? lobe_alpha(*vertex.material) : 0.0f;
  next.instance = vertex.surface->instance;
  return next;
}

// Sends a path in the world direction `d`; what is its own in the result is left to the caller.
PathState& TransportWorker::Impl::send(const PathVertex& vertex, const PathState& leaving, const Vec3& d) {
  next_rays.set(next_paths.size(), offset_origin(vertex.surface->position, vertex.facing, vertex.surface->error, d), d,
                k_infinity);
  PathState& next = next_paths.emplace_back(leaving);
  next.side = glm::dot(vertex.facing, d) < 0.0f ? -vertex.facing : vertex.facing;
  stats.rays_glossy += !next.diffuse;
  return next;
}

void TransportWorker::Impl::scatter_once(const PathVertex& vertex, const PathState& leaving, uint32_t index) {
  const uint32_t seed = scalar::hash_combine(vertex.seed, k_material_stream);
  const Vec2 u = sample_pair(index, seed, 0);
  const float u_lobe = vertex.material->several_lobes() ? sample_pair(index, seed, 1).x : 0.0f;
  const BsdfSample s = sample_bsdf(*vertex.material, vertex.wi, u, u_lobe);
  if (!(largest(s.weight) > 0.0f)) return;
  // What passes straight through keeps its direction bit for bit.
  const Vec3 d = s.straight ? rays.direction(vertex.path) : vertex.frame.to_world(s.wo);
  if (!s.straight && !vertex.material->transmits() && !(glm::dot(vertex.facing, d) > 0.0f)) return;

  PathState& next = send(vertex, leaving, d);
  next.throughput *= s.weight / vertex.lobe_samples;
  next.eta *= s.eta;
  next.index = index;
  // Mirrors and masks send only one direction on, so nothing has been split there.
  next.may_split = next.may_split && s.delta && !vertex.material->glossy();
  next.unweighted = s.delta;
  next.bsdf_density = s.pdf * vertex.lobe_samples;
}

// Samples the whole lobe at once, in lanes.
void TransportWorker::Impl::scatter_lobe(const PathVertex& vertex, const PathState& leaving, uint32_t first) {
  const int count = int(vertex.lobe_samples);
  const uint32_t seed = scalar::hash_combine(vertex.seed, k_material_stream);
  sample_conductor(*vertex.material, vertex.frame, vertex.wi, seed, first, count, settings.isa, lobe_samples);
  for (int l = 0; l < count; ++l) {
    const Vec3 d = lobe_samples.direction(size_t(l));
    const Rgb weight = lobe_samples.weight(size_t(l));
    if (!(lobe_samples.pdf[size_t(l)] > 0.0f && largest(weight) > 0.0f && glm::dot(vertex.facing, d) > 0.0f)) continue;
    PathState& next = send(vertex, leaving, d);
    next.may_split = next.unweighted = false;
    next.throughput *= weight / vertex.lobe_samples;
    next.index = first + uint32_t(l);
    next.bsdf_density = lobe_samples.pdf[size_t(l)] * vertex.lobe_samples;
  }
}

void TransportWorker::Impl::scatter(int vertex_number) {
  const bool diffuse_goes_on = goes_on(true, vertex_number), others_go_on = goes_on(false, vertex_number);
  const auto leaves = [&](const PathVertex& v) { return v.material->plain_diffuse() ? diffuse_goes_on : others_go_on; };
  size_t most = 0;
  if (diffuse_goes_on || others_go_on) {
    for (const PathVertex& v : vertices) most += leaves(v) ? size_t(v.lobe_samples) : 0;
  }
  next_paths.clear();
  next_paths.reserve(most);
  next_rays.resize(most);
  for (const PathVertex& v : vertices) {
    if (most == 0) break;
    if (!leaves(v)) continue;
    const PathState leaving = leave(v, vertex_number);
    const auto lobes = uint32_t(v.lobe_samples);
    const uint32_t first = leaving.index * lobes;
    if (lobes >= k_fewest_lane_samples && samples_in_lanes(*v.material)) {
      if (v.wi.z > 0.0f) scatter_lobe(v, leaving, first);
      continue;
    }
    for (uint32_t l = 0; l < lobes; ++l) scatter_once(v, leaving, first + l);
  }
  next_rays.resize(next_paths.size());
  std::swap(paths, next_paths);
  std::swap(rays, next_rays);
}

TransportWorker::TransportWorker(const TransportContext& context) : impl_(std::make_unique<Impl>(context)) {}
TransportWorker::~TransportWorker() = default;
TransportWorker::TransportWorker(TransportWorker&&) noexcept = default;

const Stats& TransportWorker::stats() const { return impl_->stats; }

// Follows all paths that have left the vertices of number `vertex_number` to their ends.
void TransportWorker::Impl::go_on(int vertex_number) {
  while (!paths.empty()) {
    ++vertex_number;
    intersect(vertex_number);
    arrive(vertex_number);
    gather_light(vertex_number);
    scatter(vertex_number);
  }
}

void TransportWorker::trace(const CameraSamples& samples, std::span<Rgb> radiance) {
  Impl& w = *impl_;
  w.radiance = radiance;
  std::fill(radiance.begin(), radiance.end(), Rgb(0.0f));
  w.occlusion.clear();
  w.generate(samples);
  if (w.settings.max_depth == 0 || samples.size == 0) return;
  w.intersect(0);
  if (w.settings.hide_emitters) w.pass_hidden_emitters();
  w.arrive(0);
  if (w.settings.occlusion) w.occlusion.gather(w.firsts, w.stats);
  w.gather_light(0);
  w.scatter(0);
  w.camera_paths.swap(w.next_paths);
  w.go_on(0);
}

std::unique_ptr<PathFollower> make_path_follower(const TransportContext& context) {
  return std::make_unique<TransportWorker>(context);
}

std::span<const FirstHit> TransportWorker::first_hits() const { return impl_->firsts; }

uint64_t TransportWorker::follow(std::vector<PathVertex>& vertices, std::vector<PathState>& paths,
                                 std::span<Rgb> radiance) {
  Impl& w = *impl_;
  const uint64_t before = w.stats.rays_primary + w.stats.rays_exact;
  w.follow_radiance.assign(vertices.size(), Rgb(0.0f));
  w.radiance = w.follow_radiance;
  for (uint32_t i = 0; i < vertices.size(); ++i) {
    vertices[i].path = paths[i].slot = i;
    paths[i].may_split = false;
  }
  w.vertex_storage.swap(vertices);
  w.vertices = w.vertex_storage;
  w.paths.swap(paths);
  w.receivers.clear(w.vertices.size());
  for (uint32_t i = 0; i < w.vertices.size(); ++i) w.receivers.add(w.vertices[i], i, w.paths[i]);
  if (w.settings.max_depth != 0) {
    w.gather_light(0);
    w.scatter(0);
    w.go_on(0);
  }
  for (size_t i = 0; i < radiance.size(); ++i) {
    const Rgb& sum = w.follow_radiance[i];
    radiance[i] = is_finite(sum) ? sum : Rgb(0.0f);
  }
  return w.stats.rays_primary + w.stats.rays_exact - before;
}

}  // namespace fieldtrace
