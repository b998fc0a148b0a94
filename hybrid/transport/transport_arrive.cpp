// What happens where a wave of rays ends: emission is added, surfaces are looked up and handed to direct light.

#include "core/sampling/power_heuristic.h"
#include "hybrid/glossy/hit_answerer.h"
#include "hybrid/sky/indirect_light.h"
#include "hybrid/transport/transport_impl.h"

namespace fieldtrace {

// Adds emission of `light` that a path's ray has found.
void TransportWorker::Impl::add_emission(const PathState& path, const Rgb& throughput, const Vec3& origin,
                                         const Vec3& direction, uint32_t light, const LightHit& hit) {
  float weight = 1.0f;
  if (!path.unweighted) {
    if (path.diffuse && context.closed_form[light]) return;
    const float density = float(path.light_samples) *
                          light_pdf(context.lights, light, origin, path.normal, path.transmits, direction, hit);
    weight = power_heuristic(path.bsdf_density, density);
  }
  radiance[path.slot] += throughput * emitted_radiance(context.lights, light, direction) * weight;
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
  if (settings.occlusion) occlusion.add(vertex, paths[path].slot, pixel_numbers[paths[path].slot], paths[path].index);
}

// Albedo and normal for denoisers; of a smooth surface, unless the path goes on from there.
void TransportWorker::Impl::show(uint32_t path, const PathVertex& vertex) {
  FirstHit& first = firsts[paths[path].slot];
  const Material& m = *vertex.material;
  first.shown_albedo = first.let_through * (m.shows_others() ? Rgb(1.0f) : material_albedo(m));
  first.shown_normal = vertex.frame.n;
}

// Where paths that went on met no surface.
void TransportWorker::Impl::show_nothing() {
  for (uint32_t i = 0; i < paths.size(); ++i) {
    if (!paths[i].shows || hits.instance[i] != k_none) continue;
    firsts[paths[i].slot].shown_albedo = Rgb(0.0f);
    firsts[paths[i].slot].shown_normal = Vec3(0.0f);
  }
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
  if (arrival.is_first) path.slot = i, path.pixel_seed = seeds.pixel[i], path.index = sample_indices[i];
  return path;
}

// Adds emission where the rays ended, and collects the surfaces that take light samples and the vertices from which
// paths continue.
void TransportWorker::Impl::arrive(int vertex_number) {
  Arrival arrival{.vertex_number = vertex_number, .is_first = vertex_number == 0};
  arrival.seed = scalar::vertex_seed(arrival.pixel_seed, uint32_t(vertex_number));
  arrival.emission_counts = settings.max_depth != 0;
  arrival.shows_hits = vertex_number == 0 ? settings.first_hits : showing > 0;
  if (!arrival.is_first && arrival.shows_hits) show_nothing();
  // The last surface matters only if it emits, or is shown.
  arrival.last = settings.max_depth >= 0 && vertex_number + 1 >= settings.max_depth;
  arrival.diffuse_goes_on = goes_on(true, vertex_number);
  const bool only_emission = arrival.last && !arrival.shows_hits;
  find_surfaces(only_emission);
  uint32_t reached = 0;
  for (const HitRun& run : runs) {
    meet_backgrounds(arrival, reached, run.begin);
    reached = run.end;
    const MetInstance instance = met_instance(hits.instance[run.begin]);
    if (arrival.emission_counts && instance.emitter != k_none && !(settings.hide_emitters && arrival.is_first))
      meet_emitter(arrival, run, instance.emitter);
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
    if (path.direct && settings.hide_emitters) continue;
    if (path.diffuse && context.has_sky_maps(arrival.vertex_number - 1)) continue;  // counted already
    const Rgb throughput = path.throughput * path.interface_share;
    for (const uint32_t light : context.backgrounds) {
      add_emission(path, throughput, rays.origin(i), rays.direction(i), light, {});
    }
  }
}

void TransportWorker::Impl::meet_emitter(const Arrival& arrival, const HitRun& run, uint32_t emitter) {
  for (uint32_t i = run.begin; i < run.end; ++i) {
    const SurfacePoint surface = surfaces.batch().at(hits, i);
    const Vec3 d = rays.direction(i);
    if (!(-glm::dot(surface.geometric_normal, d) > 0.0f)) continue;
    const PathState& path = arriving_path(arrival, i);
    add_emission(path, path.throughput, rays.origin(i), d, emitter,
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
  if (arrival.vertex_number > 0 && knows_indirect(arrival.vertex_number - 1) &&
      context.indirect->sends(instance.index)) {
    for (uint32_t i = run.begin; i < run.end; ++i) {
      PathState& path = paths[i];
      path.throughput *= path.interface_share;
      if (!path.diffuse && largest(path.throughput) > 0.0f) add_vertex(arrival, i, instance);  // else it is counted
    }
    return;
  }
  const bool is_simple = instance.diffuse_sides && !arrival.diffuse_goes_on && !arrival.shows_hits &&
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
    std::copy_n(&seeds.vertex[run.begin], count, &points.seed[first]);
    std::copy_n(&sample_indices[run.begin], count, &points.sample[first]);
    std::copy_n(&cluster_numbers()[run.begin], count, &receivers.cluster[first]);
    return;
  }
  for (uint32_t i = run.begin; i < run.end; ++i) {
    const size_t to = first + (i - run.begin);
    points.seed[to] = arrival.seed_of(paths[i]), points.sample[to] = paths[i].index;
    receivers.cluster[to] = cluster_numbers()[paths[i].slot];
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
  if (arrival.shows_hits && arrival.is_first) record_first_hit(i, v);
  if (arrival.shows_hits && settings.pass_smooth && path.shows) show(i, v);
  if (arrival.last || v.material->absorbs()) return;
  if (!arrival.is_first && !survives_roulette(path, v.seed, arrival.vertex_number)) return;
  v.lobe_samples = path.may_split && v.material->glossy() ? float(settings.lobe_samples) : 1.0f;
  const bool is_kept = arrival.diffuse_goes_on || !v.material->plain_diffuse();
  receivers.add(v, is_kept ? uint32_t(arrival.vertices) : k_none, path, cluster_numbers()[path.slot]);
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

}  // namespace fieldtrace
