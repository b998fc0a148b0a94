#include "hybrid/render/sky_stage.h"

#include <tbb/task_arena.h>

#include <algorithm>

#include "field/store/field.h"
#include "field/store/risk_classes.h"
#include "hybrid/light/ambient_occlusion.h"

namespace fieldtrace {
namespace {

// Monte Carlo sends two rays for each light sample: one to the sky, one from the material. Coarse maps, whose errors
// suit the noise of few samples, may cost 16 times as many rays, as they leave less than a quarter of its noise; maps of
// the usual resolution twice as many.
constexpr uint64_t k_rays_per_sample = 2, k_coarse_maps_gain = 16, k_usual_maps_gain = 2;
constexpr int k_coarse_directions = 16, k_usual_directions = 32, k_fine_directions = 64;
// Tolerances, in units of the default, from which maps are coarse and up to which they are fine.
constexpr float k_coarse_tolerance = 3.0f, k_fine_tolerance = 0.3f;

// With more instances than this maps are coarse: each cell reads several of them for every point.
constexpr size_t k_crowd = 64;

// Shapes that need maps: those seen that are no parallelograms.
std::vector<uint32_t> mapped_shapes(const Scene& scene, std::span<const ShapeTraits> traits) {
  std::vector<uint8_t> is_used(scene.shapes.size(), 0);
  for (const Instance& i : scene.instances) is_used[i.shape] = 1;
  std::vector<uint32_t> shapes;
  for (uint32_t s = 0; s < scene.shapes.size(); ++s) {
    if (is_used[s] && !(traits[s].is_flat && is_parallelogram(scene.shapes[s]))) shapes.push_back(s);
  }
  return shapes;
}

SkyTolerance sky_tolerance(float slack) {
  SkyTolerance t;
  t.margin /= slack;
  t.clear_within *= std::min(slack, 1.0f / t.clear_within);
  t.hidden_from = std::max(t.hidden_from / slack, t.clear_within);
  return t;
}

// D = 0: none is affordable.
MapSize choose_size(size_t shapes, size_t instances, float slack, const SkyRequest& request) {
  const uint64_t rays = k_rays_per_sample * request.light_samples;
  MapSize size;
  size.directions = slack >= k_coarse_tolerance || instances > k_crowd ? k_coarse_directions
                    : slack <= k_fine_tolerance                        ? k_fine_directions
                                                                       : k_usual_directions;
  const auto fits = [&](uint64_t most_rays) {
    return size.lines() * shapes <= most_rays && DirectionMaps::bytes_of(size) * shapes <= request.most_bytes;
  };
  while (size.directions > k_coarse_directions && !fits(k_usual_maps_gain * rays)) size.directions /= 2;
  if (size.directions == k_coarse_directions && !fits(k_coarse_maps_gain * rays)) size.directions = 0;
  return size;
}

}  // namespace

bool has_sky(const Scene& scene) {
  return std::any_of(scene.emitters.begin(), scene.emitters.end(), [](const Emitter& e) { return is_sky(e.kind); });
}

SkyStage make_sky(const Scene& scene, const Accel& accel, std::span<const ShapeTraits> traits,
                  const RenderOptions& options, const SkyRequest& request, const RenderCallbacks& callbacks,
                  Stats& stats) {
  SkyStage stage;
  if (!(request.light || request.occlusion) || !(options.tolerance > 0.0f) || options.force_undecided) return stage;
  const float slack = options.tolerance / k_default_tolerance;
  const std::vector<uint32_t> shapes = mapped_shapes(scene, traits);
  const MapSize size = choose_size(shapes.size(), scene.instances.size(), slack, request);
  if (size.directions == 0) return stage;
  std::vector<std::unique_ptr<DirectionMaps>> maps(scene.shapes.size());
  BakeCounters counters;
  for (size_t i = 0; i < shapes.size(); ++i) {
    if (callbacks.progress) callbacks.progress(float(i) / float(shapes.size()), "bake");
    const uint32_t s = shapes[i];
    maps[s] = std::make_unique<DirectionMaps>(field_ball(scene.shapes[s].bounds), size);
    if (!bake_maps(*maps[s], accel, s, callbacks.stop, counters)) break;
  }
  // Stages count the seconds of all threads.
  counters.seconds *= double(tbb::this_task_arena::max_concurrency());
  stats.add_bake(counters);
  stage.maps = std::make_unique<SkyMaps>(scene, traits, std::move(maps), size.directions, sky_tolerance(slack));
  stats.field_bytes_memory += stage.maps->bytes();
  stats.field_bytes_peak = std::max(stats.field_bytes_peak, stage.maps->bytes());
  if (request.light) stage.light = std::make_unique<Sky>(*stage.maps, scene);
  if (request.occlusion) stage.occlusion = std::make_unique<Sky>(*stage.maps, white_sky());
  return stage;
}

}  // namespace fieldtrace
