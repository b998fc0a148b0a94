#include "hybrid/render/sky_stage.h"

#include <tbb/task_arena.h>

#include <algorithm>
#include <exception>
#include <limits>
#include <optional>

#include "core/platform/parallel.h"
#include "core/platform/stopwatch.h"
#include "field/file/keep.h"
#include "field/file/maps_file.h"
#include "field/store/field.h"
#include "field/store/risk_classes.h"
#include "hybrid/light/ambient_occlusion.h"
#include "hybrid/sky/sky_crowd.h"

namespace fieldtrace {
namespace {

// Rays that maps for the layer `ao` may cost for each that they replace.
constexpr uint64_t k_occlusion_maps_gain = 8;
// Sources that cover more of the sphere are never sampled as lights of their own.
constexpr double k_most_concentrated_share = 1.0 / 64.0;
constexpr int k_fewest_directions = 8, k_usual_directions = 32, k_fine_directions = 64;
constexpr double k_lines_a_ray = 2.0;    // that maps bake in its time
constexpr int k_texels_a_direction = 4;  // along each side of a map, at most
// In pictures of fewer light samples a pixel the errors of the least maps in crowds, and of coarse ones, hardly show
// beside the noise.
constexpr uint64_t k_few_samples = 4, k_coarse_samples = 8;
// From so many on the errors of coarse maps would show beside a small object's noise, whatever the picture's.
constexpr uint64_t k_many_samples = 128;
// Tolerances, in units of the default, from which maps are coarse and up to which they are fine.
constexpr float k_coarse_tolerance = 3.0f, k_fine_tolerance = 0.3f;
// Light samples a pixel below which the default tolerance rises in proportion, and how far: few rays err more than
// maps.
constexpr float k_slack_samples = 32.0f, k_most_slack = 3.0f;
// More tolerance than the default takes no line for hidden within fewer texels: some points would be black.
constexpr float k_least_hidden_from = 1.0f;

SkyTolerance sky_tolerance(float slack) {
  SkyTolerance t;
  t.margin /= slack;
  t.clear_within *= std::min(slack, 1.0f / t.clear_within);
  t.hidden_from = std::max(t.hidden_from / slack, std::max(t.clear_within, slack > 1.0f ? k_least_hidden_from : 0.0f));
  return t;
}

// In units of the default.
float slack_of(const RenderOptions& options, const SkyRequest& request, bool can_be_finer) {
  if (options.tolerance) return *options.tolerance / k_default_tolerance;
  if (can_be_finer) return k_most_slack;  // a survey tells whether they will do
  return std::clamp(k_slack_samples / float(request.samples), 1.0f, k_most_slack);
}

// Where finer ones cost too much. `given`: of --tolerance or the default, in units of that.
int least_directions(float given, uint64_t samples) {
  return given >= 1.0f && samples < k_coarse_samples ? k_fewest_directions : k_coarse_directions;
}

int wanted_directions(bool crowd, float given, uint64_t samples) {
  // A crowd's cells read several objects each.
  if (given >= 1.0f && samples < (crowd ? k_few_samples : 2)) return k_fewest_directions;
  if (crowd) return k_coarse_directions;
  if (given >= k_coarse_tolerance || (given >= 1.0f && samples < k_coarse_samples)) return k_coarse_directions;
  return given <= k_fine_tolerance ? k_fine_directions : k_usual_directions;
}

// The coarsest maps, of pictures with much noise, have coarser texels as well.
MapSize map_size(int directions) { return {directions, std::min(k_texels_a_direction * directions, MapSize().texels)}; }

// D = 0: none is affordable. `may_cost(size)`: lines that all maps of a size may have.
template <class MayCost>
MapSize choose_size(size_t shapes, int directions, int least, const MayCost& may_cost, uint64_t most_bytes) {
  MapSize size = map_size(directions);
  const auto fits = [&] {
    return double(size.lines() * shapes) <= may_cost(size) && DirectionMaps::bytes_of(size) * shapes <= most_bytes;
  };
  while (size.directions > least && !fits()) size = map_size(size.directions / 2);
  if (!fits()) size.directions = 0;
  return size;
}

// Reads or bakes maps of one size.
struct MapSource {
  const Scene& scene;
  const Accel& accel;
  FieldCache* cache;  // may be null
  const RenderCallbacks& callbacks;
  Stats& stats;
  MapSize size = {};
  IfUnkept if_unkept = IfUnkept::warn;
  BakeCounters counters = {};

  // Of all shapes, those in the cache first. Fewer if `callbacks.stop` was set meanwhile.
  std::vector<std::shared_ptr<DirectionMaps>> make(const std::vector<MappedShape>& shapes) {
    std::vector<std::shared_ptr<DirectionMaps>> maps(shapes.size());
    if (cache) load(shapes, maps);
    for (size_t i = 0; i < shapes.size(); ++i) {
      if (callbacks.progress) callbacks.progress(float(i) / float(shapes.size()), "bake");
      if (maps[i]) continue;
      maps[i] = bake(shapes[i]);
      if (!maps[i]) {
        maps.resize(i);
        break;
      }
      if (cache) store(shapes[i], maps[i]);
    }
    return maps;
  }

  FieldIdentity identity_of(const MappedShape& of) const {
    return maps_identity(scene.shapes[of.shape], of.stretch, size);
  }

 private:
  std::shared_ptr<DirectionMaps> bake(const MappedShape& of) {
    auto maps = std::make_shared<DirectionMaps>(of.ball, size);
    const DMat3 to_object = of.is_deformed() ? glm::inverse(of.stretch) : DMat3(1.0);
    return bake_maps(*maps, accel, of.shape, to_object, callbacks.stop, counters) ? std::move(maps) : nullptr;
  }

  void load(const std::vector<MappedShape>& shapes, std::vector<std::shared_ptr<DirectionMaps>>& maps) {
    const ScopedTimer timer(stats.time_cache);
    parallel_for(shapes.size(), [&](size_t i) {
      std::optional<DirectionMaps> held = cache->load_maps(identity_of(shapes[i]), shapes[i].ball);
      if (held) maps[i] = std::make_shared<DirectionMaps>(std::move(*held));
    });
  }

  // Where a failure is but a warning, nobody waits for it before the picture is done.
  void store(const MappedShape& of, const std::shared_ptr<const DirectionMaps>& maps) {
    const auto store = [maps, object = "the direction maps of " + scene.shapes[of.shape].name, to = cache,
                        how = if_unkept, warning = callbacks.warning, identity = identity_of(of)] {
      keep(object, how, warning, [&] { to->store(*maps, identity); });
    };
    if (if_unkept == IfUnkept::fail)
      store();
    else
      cache->store_later(store);
  }
};

}  // namespace

bool has_sky(const Scene& scene) {
  return std::any_of(scene.emitters.begin(), scene.emitters.end(), [](const Emitter& e) { return is_sky(e.kind); });
}

bool admits_maps(const RenderOptions& options) { return options.base_tolerance() > 0.0f && !options.force_undecided; }

double largest_source(uint64_t samples, int directions) {
  const double finer = double(directions) / double(k_fewest_directions);
  return std::clamp(k_concentrated_share * double(samples) / (finer * finer), k_concentrated_share,
                    k_most_concentrated_share);
}

SkyStage make_sky(const Scene& scene, const Accel& accel, std::span<const ShapeTraits> traits,
                  const RenderOptions& options, const SkyRequest& request, const CacheOpener& cache,
                  const RenderCallbacks& callbacks, Stats& stats) {
  SkyStage stage;
  if (!admits_maps(options)) return stage;
  const float given = options.base_tolerance() / k_default_tolerance;
  MappedShapes mapped = mapped_shapes(scene, traits);
  const std::vector<MappedShape>& shapes = mapped.shapes;
  const bool by_request = options.at_any_cost();
  const bool crowd = scene.instances.size() > k_crowd;
  const uint64_t instances = crowd ? instances_in_view(scene) : 0;
  // Each sample sends one to the sky and one from the material.
  const uint64_t most_crowd_rays = 2 * k_most_crowd_samples * uint64_t(scene.film.width) * uint64_t(scene.film.height);
  const bool is_foretold = request.frame && !crowd && request.samples < k_many_samples;
  const FrameByMaps* const frame = is_foretold ? &*request.frame : nullptr;
  const auto choose = [&](uint64_t rays, bool coarse, uint64_t cost, const FrameByMaps* foretold) {
    if (rays == 0) return MapSize{0, 0};
    if (by_request) cost = rays = std::numeric_limits<uint64_t>::max() / k_usual_maps_gain;
    if (!by_request && std::min(rays, most_crowd_rays) < k_crowd_rays * instances) return MapSize{0, 0};
    // Where something is foretold, the number of samples tells nothing more.
    const uint64_t samples = foretold ? std::numeric_limits<uint64_t>::max() : request.samples;
    int directions = wanted_directions(crowd, given, samples);
    if (coarse) directions = std::min(directions, k_coarse_directions);
    // Surfels ask for all cells, and planes have four times as many of them beside usual maps.
    const auto shading_rays = [&](int d) {
      const double finer = double(d) / double(k_coarse_directions), of_planes = std::clamp(finer, 1.0, 2.0);
      return request.bounces ? double(request.bounce_rays) * finer * finer * of_planes * of_planes : 0.0;
    };
    // Else shading may take half of the time, and maps of usual directions twice as many lines as rays are spared.
    while (!foretold && directions > k_coarse_directions && shading_rays(directions) > 0.5 * double(rays)) {
      directions /= 2;
    }
    const int least = foretold && given >= 1.0f ? k_fewest_directions : least_directions(given, request.samples);
    const auto may_cost = [&](const MapSize& size) {
      if (foretold && size.directions > least) {
        const int half = size.directions / 2;
        const double shading = shading_rays(size.directions) - shading_rays(half);
        const double more = k_lines_a_ray * (foretold->worth_of_finer(size.directions, given) - shading);
        return std::min(double(cost), more + double(map_size(half).lines() * shapes.size()));
      }
      return double(size.directions <= k_coarse_directions ? cost : std::min(cost, k_usual_maps_gain * rays));
    };
    return choose_size(shapes.size(), directions, least, may_cost, request.most_bytes);
  };
  // The layer must not change the picture, and uses its maps where there are any.
  MapSize size = choose(request.light_rays, request.coarse, request.light_cost, frame);
  const bool for_light = size.directions > 0;
  // Within less than an object's radius rays are cheap and their noise is low.
  const bool is_far = by_request || request.occlusion_distance >= median_radius(scene, mapped);
  const uint64_t occlusion_rays = is_far ? request.occlusion_rays : 0;
  if (!for_light) size = choose(occlusion_rays, /*coarse=*/false, k_occlusion_maps_gain * occlusion_rays, nullptr);
  if (size.directions == 0) return stage;
  const bool can_be_finer =
      for_light && size.directions < choose(request.light_rays, /*coarse=*/false, request.light_cost, frame).directions;
  if (crowd && !by_request && !suits_maps(scene, accel, traits, mapped, callbacks.stop)) return stage;
  MapSource source{scene, accel, shapes.empty() ? nullptr : cache(), callbacks, stats, size, options.if_unkept};
  std::optional<SkyRadiance> light;
  std::vector<std::shared_ptr<DirectionMaps>> maps;
  std::exception_ptr failed;
  // Reading a few maps leaves threads idle. What fails beside it must not cut maps short that are to be kept.
  parallel_for(2, [&](size_t part) {
    if (part == 1) {
      maps = source.make(shapes);
    } else if (for_light) {
      // How many samples a picture by rounds takes in the end nobody knows.
      const uint64_t samples = options.by_rounds() ? 1 : request.samples;
      try {
        light.emplace(scene, largest_source(samples, size.directions));
      } catch (...) {
        failed = std::current_exception();
      }
    }
  });
  if (failed) std::rethrow_exception(failed);
  if (maps.size() < shapes.size()) return stage;  // stopped
  // Stages count the seconds of all threads.
  source.counters.seconds *= double(tbb::this_task_arena::max_concurrency());
  stats.add_bake(source.counters);
  stats.sky_objects = shapes.size();
  for (const MappedShape& of : shapes) stage.identities.push_back(source.identity_of(of));
  stage.maps = std::make_unique<SkyMaps>(scene, traits, std::move(mapped), std::move(maps), size.directions,
                                         sky_tolerance(slack_of(options, request, can_be_finer)));
  stage.can_be_finer = can_be_finer;
  stats.sky_directions = size.directions, stats.sky_texels = size.texels;
  if (light) {
    stage.light = std::make_unique<Sky>(*stage.maps, std::move(*light));
    stage.noise_left = request.noise_left;
  }
  if (occlusion_rays > 0) {
    stage.occlusion = std::make_unique<Sky>(*stage.maps, SkyRadiance(white_sky()), request.occlusion_distance);
  }
  return stage;
}

}  // namespace fieldtrace
