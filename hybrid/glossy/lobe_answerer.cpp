#include "hybrid/glossy/lobe_answerer.h"

#include <algorithm>
#include <utility>

#include "core/platform/parallel.h"
#include "hybrid/glossy/hit_answerer.h"
#include "hybrid/glossy/radiance_maps.h"
#include "hybrid/path/patch_vertex.h"
#include "hybrid/stats/secondary_timer.h"
#include "hybrid/visibility/device_answers.h"
#include "hybrid/visibility/direction_order.h"
#include "hybrid/visibility/query_and_bake.h"

namespace fieldtrace {
namespace {

// Sides of the squares of directions that tubes stand for, in roughnesses of the lobe.
constexpr float k_widest_tube = 1.4f;

// Rays whose remaining share is smaller are not followed.
constexpr float k_least_share = 0x1p-12f;
// Surfaces that a path visits beyond its patch, for estimating what shading the patch costs.
constexpr uint64_t k_further_surfaces = 2;

// What one object contributes to a ray.
struct Layer {
  float distance;
  const LobeAnswers* answers;
  uint32_t instance;
};

// Composites objects front to back, up to the hit at `end`.
void compose(std::vector<Layer>& layers, size_t i, float end, FilteredRay& ray) {
  std::sort(layers.begin(), layers.end(), [](const Layer& a, const Layer& b) { return a.distance < b.distance; });
  for (const Layer& layer : layers) {
    if (layer.distance >= end) break;
    const LobeAnswers& a = *layer.answers;
    const bool was_seen = ray.clear >= 0.5f;
    ray.radiance += Rgb(a.red[i], a.green[i], a.blue[i]) * ray.clear;
    ray.clear *= a.clear[i];
    if (ray.instance == k_none || (was_seen && ray.clear < 0.5f)) {
      ray.instance = layer.instance;
      ray.distance = layer.distance;
    }
  }
}

// Approximate number of rays that shading one patch takes.
uint64_t rays_per_patch(const TransportContext& shading) {
  const uint64_t lights = shading.scene.emitters.size();
  const bool goes_on = shading.settings.max_depth < 0 || shading.settings.max_depth > 2;
  return k_patch_samples * (lights + (goes_on ? k_further_surfaces * (lights + 1) : 0));
}

// The samples' density, by which a tube's width goes: not wider than k_widest_tube times the lobe's roughness, however
// few samples a lobe has, since no further camera samples take that blur away.
float tube_density(const PathState& path) {
  const float side = k_widest_tube * path.alpha;
  return std::max(path.bsdf_density, 1.0f / (side * side));
}

}  // namespace

std::vector<uint32_t> LobeAnswerer::suited_instances(const Scene& scene, std::span<const ShapeTraits> traits) {
  std::vector<uint32_t> suited;
  for (uint32_t i = 0; i < scene.instances.size(); ++i) {
    if (!traits[scene.instances[i].shape].wants_field || !SurfaceRadiance::suits(scene, i)) continue;
    suited.push_back(i);
    if (suited.size() > k_most_candidates) return {};
  }
  return suited;
}

LobeAnswerer::LobeAnswerer(const TransportContext& shading, std::span<const uint32_t> suited, const Settings& settings,
                           const HitAnswerer* hits)
    : shading_(shading),
      kernels_(segment_kernels(shading.settings.isa)),
      hits_(hits),
      blur_(k_blur_of_tolerance * settings.tolerance),
      check_(settings.check) {
  const Scene& scene = shading.scene;
  uint64_t most_bytes = settings.most_bytes;
  const uint64_t most_patches = std::min(settings.most_rays / std::max<uint64_t>(rays_per_patch(shading), 1),
                                         SurfaceRadiance::k_most_patches - 1);
  const uint64_t patches_in_memory = most_bytes / sizeof(Rgb);
  std::vector<uint8_t> has_maps(scene.instances.size(), 0);
  for (const uint32_t i : suited) {
    const uint64_t patches = RadianceMaps::count_patches(scene, i);
    if (patches > most_patches) continue;
    // Before address space is reserved for them.
    const bool may_fit = patches <= patches_in_memory && RadianceMaps::tile_bytes() <= most_bytes;
    auto maps = may_fit ? std::make_unique<RadianceMaps>(shading, i) : nullptr;
    const uint64_t bytes = maps ? maps->radiance().bytes() + maps->tiles().bytes_when_full() : 0;
    if (!maps || bytes > most_bytes) {
      ++left_out_for_memory_;
      continue;
    }
    most_bytes -= bytes;
    maps_.push_back(std::move(maps));
    has_maps[i] = 1;
  }
  if (maps_.empty()) return;
  std::vector<uint32_t> others;
  for (uint32_t i = 0; i < scene.instances.size(); ++i) {
    if (!has_maps[i]) others.push_back(i);
  }
  if (!others.empty()) others_ = shading_.accel.group(others);
}

LobeAnswerer::~LobeAnswerer() = default;

RadianceMaps* LobeAnswerer::maps_of(uint32_t instance) const {
  const auto found = std::find_if(maps_.begin(), maps_.end(), [&](const auto& m) { return m->instance() == instance; });
  return found == maps_.end() ? nullptr : found->get();
}

uint64_t LobeAnswerer::bytes() const {
  uint64_t sum = 0;
  for (const auto& p : maps_) sum += p->radiance().bytes() + p->tiles().bytes();
  return sum;
}

void LobeAnswerer::find_queried(const RayBatch& rays, std::span<const PathState> paths, LobeWorkspace& work) const {
  const size_t n = rays.size;
  work.exact.clear();
  work.queried.clear();
  work.density.assign(padded(n), 0.0f);
  work.met.assign(padded(n), 0);
  for (uint32_t i = 0; i < n; ++i) {
    const PathState& path = paths[i];
    if (path.alpha > 0.0f && !path.unweighted && path.bsdf_density > 0.0f) {
      work.density[i] = tube_density(path);
    } else {
      work.exact.push_back(i);
    }
  }
  if (work.exact.size() == n) return;
  for (const auto& p : maps_) kernels_.lobes_meet(p->task(), rays, work.density.data(), work.met.data());
  for (uint32_t i = 0; i < n; ++i) {
    if (work.met[i]) work.queried.push_back(i);
  }
}

// Traces all glossy rays, too: those that meet no object with maps end there.
void LobeAnswerer::trace_others(const RayBatch& rays, HitBatch& hits, LobeWorkspace& work) const {
  const size_t n = rays.size;
  if (!others_ || work.exact.size() == n) {
    std::fill_n(hits.instance.begin(), n, k_none);
    return;
  }
  if (work.exact.empty()) {
    shading_.accel.intersect(*others_, rays, hits, Coherence::incoherent);
    return;
  }
  work.some.rays = rays;
  for (const uint32_t i : work.exact) work.some.rays.tmax[i] = -1.0f;
  shading_.accel.intersect(*others_, work.some.rays, hits, Coherence::incoherent);
}

void LobeAnswerer::fill_batch(const RayBatch& rays, std::span<const PathState> paths, LobeWorkspace& work) const {
  order_by_direction(rays, work.queried, work.order);
  LobeBatch& batch = work.batch;
  batch.resize(work.queried.size());
  std::fill(batch.density.begin(), batch.density.end(), 0.0f);
  for (size_t j = 0; j < work.queried.size(); ++j) {
    const PathState& path = paths[work.queried[j]];
    batch.rays.copy(j, rays, work.queried[j]);
    batch.nx[j] = path.side.x, batch.ny[j] = path.side.y, batch.nz[j] = path.side.z;
    batch.density[j] = work.density[work.queried[j]];
    batch.blur[j] = blur_ * path.alpha;
    batch.instance[j] = path.instance;
  }
}

void LobeAnswerer::ask(LobeWorkspace& work) const {
  const size_t count = work.queried.size();
  work.questions.assign(count > 0 ? maps_.size() : 0, {});
  for (size_t p = 0; p < work.questions.size(); ++p) {
    LobeQuestion& question = work.questions[p];
    question.task = maps_[p]->task();
    question.tiles = &maps_[p]->tiles();
    question.batch = &work.batch;
    question.samples = count;
    for (uint32_t block = 0; block < count; block += k_batch_padding) {
      add_block(question, block, wanted_mask(block, [&](uint32_t j) { return j < count; }));
    }
  }
}

void LobeAnswerer::query(LobeWorkspace& work, Stats& stats) const {
  const LobeBatch& batch = work.batch;
  work.answers.resize(maps_.size());
  ConeUnknowns& unknowns = work.unknowns;
  for (size_t p = 0; p < maps_.size(); ++p) {
    LobeAnswers& answers = work.answers[p];
    answers.resize(batch.rays.size);
    const LobeQuestion* question = work.questions.empty() ? nullptr : &work.questions[p];
    query_and_bake(
        batch.rays.size, unknowns,
        [&](std::span<const uint32_t> blocks) {
          stats.lookups += filter_lobes(kernels_, std::exchange(question, nullptr), maps_[p]->task(), batch, blocks,
                                        answers, unknowns);
        },
        [&] {
          sort_unique(unknowns.tiles);
          maps_[p]->bake(unknowns.tiles, stats);
          return true;
        });
    for (const uint32_t block : unknowns.blocks) std::fill_n(answers.refused.begin() + block, k_batch_padding, 1);
  }
}

void LobeAnswerer::put_together(const HitBatch& hits, LobeWorkspace& work) const {
  std::vector<Layer> layers;
  for (size_t j = 0; j < work.queried.size(); ++j) {
    const uint32_t i = work.queried[j];
    layers.clear();
    bool refused = false;
    for (size_t p = 0; p < maps_.size(); ++p) {
      const LobeAnswers& a = work.answers[p];
      refused = refused || a.refused[j] != 0;
      if (a.clear[j] < 1.0f) layers.push_back({a.distance[j], &a, maps_[p]->instance()});
    }
    if (refused) {
      work.exact.push_back(i);
    } else if (!layers.empty()) {
      FilteredRay& ray = work.filtered.emplace_back();
      ray.ray = i;
      compose(layers, j, hits.instance[i] == k_none ? k_infinity : hits.t[i], ray);
    }
  }
}

// Traces the rays that the maps refused.
void LobeAnswerer::trace_exact(const Request& r) const {
  if (hits_) {
    hits_->intersect(r.rays, r.paths, r.work.exact, r.hits, r.work.hits, r.stats);
    return;
  }
  for (const uint32_t i : r.work.exact) r.stats.rays_glossy_exact += !r.paths[i].diffuse;
  intersect_subset(shading_.accel, r.rays, r.work.exact, r.hits, r.work.some);
}

void LobeAnswerer::begin(const Request& r) const {
  r.hits.resize(r.rays.size);
  r.work.filtered.clear();
  find_queried(r.rays, r.paths, r.work);
  trace_others(r.rays, r.hits, r.work);
  if (!r.work.queried.empty()) fill_batch(r.rays, r.paths, r.work);
  r.work.questions.clear();
}

void LobeAnswerer::finish(const Request& r) const {
  if (!r.work.queried.empty()) {
    query(r.work, r.stats);
    put_together(r.hits, r.work);
    if (check_) check_filtered(r);
    for (FilteredRay& ray : r.work.filtered) {
      if (ray.clear >= k_least_share) continue;
      ray.clear = 0.0f;
      r.hits.instance[ray.ray] = k_none;
    }
  }
  trace_exact(r);
}

void LobeAnswerer::answer(const Request& request) const {
  begin(request);
  finish(request);
}

void LobeAnswerer::answer(std::span<const Request> requests, VisibilityDevice& device) const {
  const auto for_all = [&](const auto& work) {
    parallel_for_isolated(requests.size(), [&](size_t i) {
      const SecondaryTimer timer(requests[i].stats);
      work(requests[i]);
    });
  };
  for_all([&](const Request& r) {
    begin(r);
    ask(r.work);
  });
  DeviceWave wave;
  for (const Request& r : requests) {
    for (LobeQuestion& question : r.work.questions) wave.lobes.push_back(&question);
  }
  for (int round = 0; !wave.empty(); ++round) {
    device.answer(wave);
    if (round == k_most_bake_rounds) break;
    for_all([&](const Request& r) {
      for (size_t p = 0; p < r.work.questions.size(); ++p) {
        std::vector<uint32_t>& tiles = r.work.questions[p].unbaked.tiles;
        sort_unique(tiles);
        if (!tiles.empty()) maps_[p]->bake(tiles, r.stats);
        if (maps_[p]->tiles().full()) r.work.questions[p].unbaked = {};
      }
    });
    wave = {};
    for (const Request& r : requests) {
      for (LobeQuestion& question : r.work.questions) {
        if (!question.unbaked.empty()) wave.lobes.push_back(&question);
      }
    }
  }
  for_all([&](const Request& r) { finish(r); });
}

}  // namespace fieldtrace
