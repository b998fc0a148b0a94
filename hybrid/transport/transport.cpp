#include "hybrid/transport/transport.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/math/finite.h"
#include "core/platform/parallel.h"
#include "core/platform/stopwatch.h"
#include "hybrid/glossy/hit_answerer.h"
#include "hybrid/sky/indirect_light.h"
#include "hybrid/stats/secondary_timer.h"
#include "hybrid/transport/transport_impl.h"

namespace fieldtrace {
namespace {

// With fewer samples at a surface, most lanes would be empty.
constexpr uint32_t k_fewest_lane_samples = 4;

// The part of what a plastic reflects that its interface does.
Rgb interface_share(const Material& material, const Vec3& wi, const Vec3& wo) {
  const Rgb all = evaluate_bsdf(material, wi, wo), of_interface = evaluate_bsdf(without_body(material), wi, wo);
  const auto share = [&](int c) { return all[c] > 0.0f ? std::min(of_interface[c] / all[c], 1.0f) : 0.0f; };
  return {share(0), share(1), share(2)};
}

// Whether the sample `index` of a vertex is the one whose path stands for the camera sample: another one of the lobe
// for each, so that they are as well distributed together as all samples are.
bool shows_sample(const PathVertex& vertex, const PathState& leaving, uint32_t index) {
  const auto lobes = uint32_t(vertex.lobe_samples);
  return index - leaving.index * lobes == leaving.index % lobes;
}

}  // namespace

void TransportWorker::Impl::generate(const CameraSamples& samples) {
  const ScopedTimer timer(stats.time_primary);
  context.camera.sample(samples, settings.seed, settings.isa, rays, near_distance, seeds);
  number_pixels(samples);
  paths.swap(camera_paths);
  paths.resize(samples.size);
  firsts.assign(settings.first_hits ? samples.size : 0, FirstHit{});
  sample_indices = {samples.index.data(), samples.size};
  pixels.clear();
  if (samples.whole_blocks && context.fits_blocks()) {
    for (size_t i = 0; i < samples.size; ++i) pixels.push_back({int(samples.x[i]), int(samples.y[i])});
  }
}

void TransportWorker::Impl::number_pixels(const CameraSamples& samples) {
  for (auto* v : {&pixel_numbers, &block_numbers}) v->resize(padded(samples.size));
  joins_pixels = samples.whole_blocks && context.clusters_blocks();
  const auto pixel_at = [&](size_t i) { return PixelPosition{int(samples.x[i]), int(samples.y[i])}; };
  uint32_t number = 0, block = 0;
  for (size_t i = 0; i < samples.size; ++i) {
    const bool is_same = i > 0 && samples.x[i - 1] == samples.x[i] && samples.y[i - 1] == samples.y[i];
    number += !is_same;
    pixel_numbers[i] = number;
    if (!joins_pixels) continue;
    block += i == 0 || (!is_same && !in_one_block(pixel_at(i - 1), pixel_at(i), k_cluster_side));
    block_numbers[i] = block;
  }
}

void TransportWorker::Impl::begin_rays() {
  stats.rays_primary += rays.size;
  lobe_work.hits.certified.clear();
}

void TransportWorker::Impl::intersect(int vertex_number) {
  begin_rays();
  if (answers_lobes(vertex_number)) {
    intersect_lobes();
    take_lobes(vertex_number);
  } else if (context.hits && vertex_number > 0) {
    intersect_by_hits();
  } else {
    intersect_all(vertex_number);
  }
  end_rays(vertex_number);
}

void TransportWorker::Impl::end_rays(int vertex_number) {
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
  const SecondaryTimer timer(stats);
  hits.resize(rays.size);
  all_rays.resize(rays.size);
  std::iota(all_rays.begin(), all_rays.end(), 0u);
  context.hits->intersect(rays, paths, all_rays, hits, lobe_work.hits, stats);
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
  const SecondaryTimer timer(stats);
  context.lobes->answer(lobe_request());
}

// Adds what maps answered, once hits are known.
void TransportWorker::Impl::take_lobes(int vertex_number) {
  for (const FilteredRay& filtered : lobe_work.filtered) {
    PathState& path = paths[filtered.ray];
    if (filtered.instance == k_none) continue;
    const bool is_counted = knows_indirect(vertex_number - 1) && context.indirect->sends(filtered.instance);
    radiance[path.slot] +=
        path.throughput * (is_counted ? path.interface_share * filtered.radiance : filtered.radiance);
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

DirectLight::Request TransportWorker::Impl::light_request(int vertex_number) {
  const bool first = vertex_number == 0;
  return {.direct = direct,
          .receivers = receivers,
          .vertices = vertices,
          .light_samples = first ? settings.light_samples : 1,
          .first = first,
          .joins_pixels = first && joins_pixels,
          .pixels = first ? pixels : std::span<const PixelPosition>(),
          .firsts = first && settings.count_first_hits ? std::span(firsts) : std::span<FirstHit>(),
          .stats = stats};
}

void TransportWorker::Impl::gather_light(int vertex_number) {
  DirectLight::gather(light_request(vertex_number));
  add_light(vertex_number);
}

void TransportWorker::Impl::add_light(int vertex_number) {
  const bool first = vertex_number == 0;
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
  if (is_diffuse && knows_indirect(vertex_number) && !context.indirect->has_others()) return false;
  if (settings.max_depth < 0 || vertex_number + 2 < settings.max_depth) return true;
  if (!is_diffuse) return context.emission_can_be_hit;
  return context.has_sky_maps(vertex_number) ? context.open_area_can_be_hit : context.open_form_can_be_hit;
}

// The state that all paths leaving a vertex share.
PathState TransportWorker::Impl::leave(const PathVertex& vertex, int vertex_number) const {
  PathState next = paths[vertex.path];
  next.light_samples = vertex_number == 0 ? settings.light_samples : 1;
  next.diffuse = vertex.material->plain_diffuse();
  next.interface_share = Rgb(1.0f);
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
  if (seeks_others && leaving.diffuse && !context.indirect->may_meet_others(vertex.surface->position, d)) return;

  Rgb share(1.0f);
  if (bodies_are_lit && !s.delta && vertex.material->coated_diffuse()) {
    share = interface_share(*vertex.material, vertex.wi, s.wo);
    if (bodies_end && largest(share) == 0.0f) return;
  }
  PathState& next = send(vertex, leaving, d);
  next.throughput *= s.weight / vertex.lobe_samples;
  next.interface_share = share;
  next.eta *= s.eta;
  next.index = index;
  // Mirrors and masks send only one direction on, so nothing has been split there.
  next.may_split = next.may_split && s.delta && !vertex.material->glossy();
  next.unweighted = s.delta;
  next.bsdf_density = s.pdf * vertex.lobe_samples;
  next.direct = leaving.direct && s.straight;
  next.shows =
      leaving.shows && settings.pass_smooth && vertex.material->shows_others() && shows_sample(vertex, leaving, index);
  if (!next.shows) return;
  ++showing;
  firsts[leaving.slot].let_through *= s.weight * (s.eta * s.eta);  // as light, not as radiance
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
    next.may_split = next.unweighted = next.shows = next.direct = false;
    next.throughput *= weight / vertex.lobe_samples;
    next.index = first + uint32_t(l);
    next.bsdf_density = lobe_samples.pdf[size_t(l)] * vertex.lobe_samples;
  }
}

void TransportWorker::Impl::scatter(int vertex_number) {
  seeks_others = knows_indirect(vertex_number);
  bodies_are_lit = context.has_sky_maps(vertex_number);
  const bool is_last = settings.max_depth >= 0 && vertex_number + 2 >= settings.max_depth;
  bodies_end = bodies_are_lit && is_last && !context.area_can_be_hit && !settings.count_reflections;
  const bool diffuse_goes_on = goes_on(true, vertex_number), others_go_on = goes_on(false, vertex_number);
  const auto leaves = [&](const PathVertex& v) { return v.material->plain_diffuse() ? diffuse_goes_on : others_go_on; };
  size_t most = 0;
  if (diffuse_goes_on || others_go_on) {
    for (const PathVertex& v : vertices) most += leaves(v) ? size_t(v.lobe_samples) : 0;
  }
  next_paths.clear();
  showing = 0;
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
  std::swap(paths, next_paths);
  if (paths.empty()) return;
  next_rays.resize(paths.size());
  std::swap(rays, next_rays);
}

TransportWorker::TransportWorker(const TransportContext& context) : impl_(std::make_unique<Impl>(context)) {}
TransportWorker::~TransportWorker() = default;
TransportWorker::TransportWorker(TransportWorker&&) noexcept = default;

const Stats& TransportWorker::stats() const { return impl_->stats; }

// Follows all paths that have left the first vertices to their ends.
void TransportWorker::Impl::go_on() {
  for (int n = 1; !paths.empty(); ++n) {
    intersect(n);
    arrive(n);
    gather_light(n);
    scatter(n);
  }
}

void TransportWorker::Impl::begin(const CameraSamples& samples, std::span<Rgb> to) {
  radiance = to;
  std::fill(radiance.begin(), radiance.end(), Rgb(0.0f));
  occlusion.clear(samples.size);
  sample_cost = {};
  generate(samples);
}

bool TransportWorker::Impl::meet_first() {
  if (paths.empty() || (settings.max_depth == 0 && !settings.first_hits)) return false;
  intersect(0);
  if (settings.hide_emitters) pass_hidden_emitters();
  arrive(0);
  return true;
}

void TransportWorker::Impl::leave_first() {
  scatter(0);
  camera_paths.swap(next_paths);
}

// `rays_before`: rays_traced() before the batch; `seconds`: all that it took.
void TransportWorker::Impl::end(uint64_t rays_before, double seconds) {
  if (radiance.empty()) return;
  const auto count = double(radiance.size());
  sample_cost.seconds = seconds / count;
  sample_cost.work = 1.0 + double(rays_traced() - rays_before) / count;
}

void TransportWorker::trace(const CameraSamples& samples, std::span<Rgb> radiance) {
  Impl& w = *impl_;
  const uint64_t rays_before = w.rays_traced();
  double seconds = 0.0;
  {
    const ScopedTimer timer(seconds);
    w.begin(samples, radiance);
    if (w.meet_first()) {
      if (w.settings.occlusion) AmbientOcclusion::gather(w.occlusion_request());
      w.gather_light(0);
      w.leave_first();
      w.go_on();
    }
  }
  w.end(rays_before, seconds);
}

void TransportWorker::trace(std::span<const Batch> band) {
  if (band.empty()) return;
  const Impl& first = *band[0].worker.impl_;
  std::vector<uint64_t> rays_before(band.size());
  std::vector<uint8_t> goes_on(band.size(), 1);
  const auto for_band = [&](const auto& work) {
    parallel_for_isolated(band.size(), [&](size_t i) {
      if (goes_on[i]) work(i, *band[i].worker.impl_);
    });
  };
  const auto gather_occlusion = [&] {
    std::vector<AmbientOcclusion::Request> requests;
    for (size_t i = 0; i < band.size(); ++i) {
      Impl& w = *band[i].worker.impl_;
      if (goes_on[i] && w.settings.occlusion) requests.push_back(w.occlusion_request());
    }
    AmbientOcclusion::gather_waves(requests);
  };
  const auto gather_light = [&](int vertex_number) {
    std::vector<DirectLight::Request> requests;
    for (size_t i = 0; i < band.size(); ++i) {
      if (goes_on[i]) requests.push_back(band[i].worker.impl_->light_request(vertex_number));
    }
    DirectLight::gather_waves(requests);
  };
  double seconds = 0.0;
  {
    const ScopedTimer timer(seconds);
    for_band([&](size_t i, Impl& w) {
      rays_before[i] = w.rays_traced();
      w.begin(band[i].samples, band[i].radiance);
      goes_on[i] = w.meet_first();
    });
    gather_occlusion();
    gather_light(0);
    for_band([&](size_t i, Impl& w) {
      w.add_light(0);
      w.leave_first();
      goes_on[i] = !w.paths.empty();
    });
    for (int n = 1; std::find(goes_on.begin(), goes_on.end(), uint8_t(1)) != goes_on.end(); ++n) {
      if (const LobeAnswerer* const lobes = first.answers_lobes(n) ? first.context.lobes : nullptr) {
        std::vector<LobeAnswerer::Request> requests;
        for_band([&](size_t, Impl& w) { w.begin_rays(); });
        for (size_t i = 0; i < band.size(); ++i) {
          if (goes_on[i]) requests.push_back(band[i].worker.impl_->lobe_request());
        }
        lobes->answer(requests, *first.context.answerer.device());
        for_band([&](size_t, Impl& w) {
          w.take_lobes(n);
          w.end_rays(n);
          w.arrive(n);
        });
      } else {
        for_band([&](size_t, Impl& w) {
          w.intersect(n);
          w.arrive(n);
        });
      }
      gather_light(n);
      for_band([&](size_t i, Impl& w) {
        w.add_light(n);
        w.scatter(n);
        goes_on[i] = !w.paths.empty();
      });
    }
  }
  for (size_t i = 0; i < band.size(); ++i) {
    band[i].worker.impl_->end(rays_before[i], seconds / double(band.size()));
  }
}

const TransportWorker::Cost& TransportWorker::sample_cost() const { return impl_->sample_cost; }

std::unique_ptr<PathFollower> make_path_follower(const TransportContext& context) {
  return std::make_unique<TransportWorker>(context);
}

bool TransportWorker::traces_blocks() const { return impl_->context.traces_blocks(); }

std::span<const FirstHit> TransportWorker::first_hits() const { return impl_->firsts; }

uint64_t TransportWorker::follow(std::vector<PathVertex>& vertices, std::vector<PathState>& paths,
                                 std::span<Rgb> radiance) {
  Impl& w = *impl_;
  const uint64_t before = w.rays_traced();
  w.follow_radiance.assign(vertices.size(), Rgb(0.0f));
  w.radiance = w.follow_radiance;
  for (uint32_t i = 0; i < vertices.size(); ++i) {
    vertices[i].path = paths[i].slot = i;
    paths[i].may_split = paths[i].shows = paths[i].direct = false;
  }
  w.vertex_storage.swap(vertices);
  w.vertices = w.vertex_storage;
  w.paths.swap(paths);
  w.receivers.clear(w.vertices.size());
  w.joins_pixels = false;
  w.pixel_numbers.resize(w.paths.size());
  for (uint32_t i = 0; i < w.vertices.size(); ++i) {
    w.pixel_numbers[i] = w.paths[i].pixel_seed;
    w.receivers.add(w.vertices[i], i, w.paths[i], w.pixel_numbers[i]);
  }
  if (w.settings.max_depth != 0) {
    w.gather_light(0);
    w.scatter(0);
    w.go_on();
  }
  for (size_t i = 0; i < radiance.size(); ++i) {
    const Rgb& sum = w.follow_radiance[i];
    radiance[i] = is_finite(sum) ? sum : Rgb(0.0f);
  }
  return w.rays_traced() - before;
}

}  // namespace fieldtrace
