#include "hybrid/render.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <mutex>
#include <thread>

#include "core/accel.h"
#include "core/camera.h"
#include "core/parallel.h"
#include "hybrid/aovs.h"
#include "hybrid/field_resolution.h"
#include "hybrid/field_set.h"
#include "hybrid/field_survey.h"
#include "hybrid/shadow_answerer.h"
#include "hybrid/tiles.h"
#include "hybrid/trace_pixels.h"
#include "hybrid/transport.h"

namespace fieldtrace {
namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point begin) { return std::chrono::duration<double>(Clock::now() - begin).count(); }

void check_range(const char* option, long long value, long long low, long long high) {
  if (value < low || value > high) {
    throw UsageError(std::string(option) + " is " + std::to_string(value) + "; it must lie between " +
                     std::to_string(low) + " and " + std::to_string(high));
  }
}

// Sequence indices are 32 bits wide: camera samples x samples at a hit stay below that.
constexpr long long k_most_samples = 1ll << 31;

void check_options(const RenderOptions& o, int spp) {
  check_range("the number of camera samples", spp, 1, 1 << 24);
  check_range("the number of light samples", o.light_samples, 1, 1 << 16);
  check_range("the number of lobe samples", o.lobe_samples, 1, 1 << 12);
  check_range("camera samples x light samples", (long long)(spp)*o.light_samples, 1, k_most_samples);
  check_range("camera samples x lobe samples", (long long)(spp)*o.lobe_samples, 1, k_most_samples);
  check_range("the number of threads", o.threads, 0, 4096);
  if (!(o.tolerance >= 0.0f && o.tolerance <= 1.0f))
    throw UsageError("the tolerance is " + std::to_string(o.tolerance) + "; it must lie between 0 and 1");
  if (!(o.ao_distance > 0.0f))
    throw UsageError("the distance of ambient occlusion is " + std::to_string(o.ao_distance) +
                     "; it must be greater than 0");
  if (o.max_depth) check_range("the maximum depth", *o.max_depth, -1, 1 << 30);
}

Rect crop_window(const Film& film, const std::optional<Rect>& requested) {
  const Rect film_window =
      film.crop.width > 0 && film.crop.height > 0 ? film.crop : Rect{0, 0, film.width, film.height};
  if (!requested) return film_window;
  const Rect& r = *requested;
  const bool inside = r.width >= 1 && r.height >= 1 && r.x >= film_window.x && r.y >= film_window.y &&
                      int64_t(r.x) + r.width <= int64_t(film_window.x) + film_window.width &&
                      int64_t(r.y) + r.height <= int64_t(film_window.y) + film_window.height;
  if (!inside) {
    throw UsageError("the crop window " + std::to_string(r.x) + "," + std::to_string(r.y) + "," +
                     std::to_string(r.width) + "," + std::to_string(r.height) + " must lie within the film's " +
                     std::to_string(film_window.x) + "," + std::to_string(film_window.y) + "," +
                     std::to_string(film_window.width) + "," + std::to_string(film_window.height));
  }
  return r;
}

// The pixels that are traced for a window. Which objects a ray is tested against one by one depends on its group where
// there are too many, and the groups on the tile: whole tiles of the film are traced then, so that a pixel is the same
// in every window.
Rect traced_window(const Scene& scene, const Rect& window) {
  if (scene.instances.size() <= k_most_candidates) return window;
  const auto floor_to_tile = [](int v) { return v / k_tile_size * k_tile_size; };
  const auto end = [&](int last, int film) { return std::min(floor_to_tile(last) + k_tile_size, film); };
  const int x = floor_to_tile(window.x), y = floor_to_tile(window.y);
  return {x, y, end(window.x + window.width - 1, scene.film.width) - x,
          end(window.y + window.height - 1, scene.film.height) - y};
}

bool contains(const Rect& r, const PixelPosition& p) {
  return p.x >= r.x && p.y >= r.y && p.x < r.x + r.width && p.y < r.y + r.height;
}

TransportSettings make_settings(const Scene& scene, const RenderOptions& options, const std::vector<Aov>& aovs) {
  TransportSettings s;
  s.light_samples = options.light_samples;
  s.lobe_samples = options.lobe_samples;
  s.max_depth = options.max_depth.value_or(scene.integrator.max_depth);
  s.rr_depth = scene.integrator.rr_depth;
  s.hide_emitters = scene.integrator.hide_emitters;
  s.seed = options.seed.value_or(scene.seed);
  s.isa = resolve_isa(options.isa);
  s.count_first_hits =
      std::any_of(aovs.begin(), aovs.end(), [](Aov aov) { return aov == Aov::visibility || aov == Aov::exact; });
  s.occlusion = std::find(aovs.begin(), aovs.end(), Aov::ao) != aovs.end();
  s.occlusion_distance = options.ao_distance;
  return s;
}

FieldPlan first_plan(const Scene& scene, std::span<const ShapeTraits> traits, const RenderOptions& options,
                     uint64_t rays_per_light) {
  FieldPlan plan;
  plan.parameters = choose_resolution(scene, traits, rays_per_light);
  if (options.directions) plan.parameters.directions = options.directions;
  if (options.plane) plan.parameters.plane = options.plane;
  // Where fields alone answer, or are asked by request, none is left out.
  if (options.leave_to_rays && !options.force_ask && options.tolerance < 1.0f)
    plan.light_samples = double(rays_per_light) * double(scene.emitters.size());
  return plan;
}

// The cache of `options`, null where there is none or nothing is kept in it.
std::unique_ptr<FieldCache> open_cache(const RenderOptions& options, const FieldSet& fields,
                                       const WarningSink& warning) {
  if (options.field_cache.empty() || fields.empty()) return nullptr;
  return std::make_unique<FieldCache>(options.field_cache, options.field_cache_limit, warning);
}

// Reports at most ten times a second, from whichever thread has just finished a tile.
class Progress {
 public:
  Progress(const RenderCallbacks& callbacks, size_t total) : callbacks_(callbacks), total_(total) {}

  void tile_done() {
    const size_t done = ++done_;
    if (!callbacks_.progress) return;
    const std::unique_lock lock(mutex_, std::try_to_lock);
    if (!lock || (done < total_ && seconds_since(last_) < 0.1)) return;
    last_ = Clock::now();
    // A thread that waited may come with an older count.
    reported_ = std::max(reported_, float(double(done) / double(total_)));
    callbacks_.progress(reported_, "render");
  }

 private:
  const RenderCallbacks& callbacks_;
  size_t total_;
  std::atomic<size_t> done_ = 0;
  std::mutex mutex_;
  Clock::time_point last_ = Clock::now();
  float reported_ = 0.0f;
};

bool is_finite(const Rgb& c) { return std::isfinite(c.x) && std::isfinite(c.y) && std::isfinite(c.z); }

// Everything that tiles share.
struct Job {
  const TransportContext& context;
  const std::vector<Aov>& aovs;
  Rect window;
  int spp = 1;
  Image& image;
  const std::atomic<bool>* stop = nullptr;
  const FieldBudget* budget = nullptr;
  std::atomic<uint64_t> not_finite = 0;

  bool stopped() const { return stop && stop->load(std::memory_order_relaxed); }
};

struct PixelSums {
  DVec3 radiance = DVec3(0.0);
  AovSums aovs;
};

void write_pixel(const Job& job, const PixelPosition& p, const PixelSums& sums) {
  float* out = job.image.pixel(p.x - job.window.x, p.y - job.window.y);
  for (int c = 0; c < 3; ++c) *out++ = float(sums.radiance[c] / job.spp);
  sums.aovs.write(job.aovs, out);
}

// False if it was stopped: the tile is then left black.
bool render_tile(Job& job, const Rect& tile, TransportWorker& worker) {
  const std::vector<PixelPosition> pixels = tile_pixels(tile);
  std::vector<PixelSums> sums(pixels.size());
  const auto goes_on = [&] { return !job.stopped() && !job.budget->exceeded(); };
  const auto add = [&](size_t pixel, const SampleResult& r) {
    if (is_finite(r.radiance)) {
      sums[pixel].radiance += DVec3(r.radiance);
    } else {
      ++job.not_finite;
    }
    sums[pixel].aovs.add(r.first);
  };
  if (!trace_pixels(pixels, job.spp, job.context.settings.lobe_samples, worker, goes_on, add)) return false;
  for (size_t i = 0; i < pixels.size(); ++i) {
    if (contains(job.window, pixels[i])) write_pixel(job, pixels[i], sums[i]);
  }
  return true;
}

struct SurveyJob {
  const Scene& scene;
  const Accel& accel;
  std::span<const ShapeTraits> traits;
  const CameraSampler& camera;
  const RenderOptions& options;
  const TransportSettings& settings;
  int spp;
  const std::atomic<bool>* stop;
};

// Finds out which fields are not worth asking. False if it was stopped.
bool leave_to_rays(const SurveyJob& job, FieldSet& fields, Stats& stats) {
  const RenderOptions& options = job.options;
  // Where every cell answers, or none by request, there is nothing to find out.
  if (fields.empty() || !options.leave_to_rays || options.force_ask || options.tolerance >= 1.0f) return true;
  AnswererSettings counting{job.settings.isa, options.tolerance, false, false, options.whole_lights};
  counting.count_uses = true;
  const ShadowAnswerer answerer(job.scene, job.accel, job.traits, fields.pointers(), counting);
  const TransportContext context(job.scene, job.accel, job.camera, answerer, job.settings);
  const FieldSurvey survey = survey_fields(context, crop_window(job.scene.film, {}), job.spp, job.stop);
  stats.survey_rays += survey.stats.rays_exact;
  stats.bake_rays += survey.stats.bake_rays;
  stats.time_bake += survey.stats.time_bake;
  if (survey.interrupted) return false;
  fields.leave_to_rays(survey, options.fewest_answers);
  return true;
}

Image make_image(const Rect& window, const std::vector<Aov>& aovs) {
  Image image;
  image.width = window.width;
  image.height = window.height;
  image.channels = {"R", "G", "B"};
  for (const Aov aov : aovs) {
    for (std::string& name : aov_channels(aov)) image.channels.push_back(std::move(name));
  }
  image.data.assign(size_t(window.width) * window.height * image.channel_count(), 0.0f);
  return image;
}

}  // namespace

RenderResult render(const Scene& scene, const RenderOptions& options, const RenderCallbacks& callbacks) {
  const Clock::time_point begin = Clock::now();
  const int spp = options.spp > 0 ? options.spp : options.spp == 0 ? scene.sample_count : -1;
  check_options(options, spp);
  const std::vector<Aov> aovs = parse_aovs(options.aovs);
  const Rect window = crop_window(scene.film, options.crop);
  const TransportSettings settings = make_settings(scene, options, aovs);
  const int threads = options.threads > 0 ? options.threads : std::max(int(std::thread::hardware_concurrency()), 1);

  RenderResult result;
  // TBB starts no more workers than there are hardware threads unless told so.
  std::optional<tbb::global_control> more_threads;
  if (threads > int(std::thread::hardware_concurrency()))
    more_threads.emplace(tbb::global_control::max_allowed_parallelism, size_t(threads));
  tbb::task_arena arena(threads);
  arena.execute([&] {
    const Clock::time_point build_begin = Clock::now();
    const Accel accel(scene);
    result.stats.time_build = seconds_since(build_begin);
    const std::vector<ShapeTraits> traits = shape_traits(scene);
    const CameraSampler camera(scene.camera, scene.film);
    const uint64_t rays_per_light =
        uint64_t(window.width) * uint64_t(window.height) * uint64_t(spp) * uint64_t(options.light_samples);
    const bool wants_fields = options.method == Method::hybrid && (options.tolerance > 0.0f || options.force_ask);
    const uint64_t budget = options.field_memory ? options.field_memory : default_field_memory();
    const AnswererSettings usual_settings{settings.isa, options.tolerance, options.check, options.force_ask,
                                          options.whole_lights};
    const SurveyJob survey_job{scene, accel, traits, camera, options, settings, spp, callbacks.stop};
    const std::vector<Rect> tiles = make_tiles(traced_window(scene, window), k_tile_size);
    FieldPlan plan = first_plan(scene, traits, options, rays_per_light);
    for (bool is_done = false; !is_done;) {
      FieldSet fields(scene, traits, plan, budget, wants_fields);
      const std::unique_ptr<FieldCache> cache = open_cache(options, fields, callbacks.warning);
      const Clock::time_point cache_begin = Clock::now();
      if (cache) fields.load(*cache);
      result.stats.time_cache += seconds_since(cache_begin);
      const bool surveyed = leave_to_rays(survey_job, fields, result.stats);
      AnswererSettings answerer_settings = usual_settings;
      answerer_settings.own_to_rays = fields.own_to_rays();
      const ShadowAnswerer answerer(scene, accel, traits, fields.pointers(), answerer_settings);
      const TransportContext context(scene, accel, camera, answerer, settings);

      result.image = make_image(window, aovs);
      Job job{context, aovs, window, spp, result.image, callbacks.stop, &fields.budget()};
      Progress progress(callbacks, tiles.size());
      std::atomic<bool> interrupted = !surveyed;
      tbb::enumerable_thread_specific<TransportWorker> workers([&] { return TransportWorker(context); });
      parallel_for(tiles.size(), [&](size_t i) {
        if (interrupted) return;
        bool done = false;
        // Isolated: a thread that waits for a bake inside a tile must not start another tile with the same worker.
        tbb::this_task_arena::isolate([&] { done = render_tile(job, tiles[i], workers.local()); });
        if (done) {
          progress.tile_done();
        } else {
          interrupted = true;
        }
      });
      // The last tiles may reach the budget and be done all the same: that must not be a matter of luck.
      is_done = !fields.budget().exceeded() || job.stopped();
      result.stats.field_bytes_peak = std::max(result.stats.field_bytes_peak, fields.budget().used());
      if (!is_done) {
        for (const TransportWorker& worker : workers) result.stats.add_bake(worker.stats());
        result.stats.field_restarts += 1;
        std::string change;
        plan = fields.next_plan(change);
        warn(callbacks.warning, {},
             "the fields outgrew their " + std::to_string(budget / 1000000) + " MB; the render " + change +
                 " (raise --field-memory to avoid it)");
        continue;
      }
      result.interrupted = interrupted;
      for (const TransportWorker& worker : workers) result.stats.merge_counters(worker.stats());
      fields.count(result.stats);
      const Clock::time_point store_begin = Clock::now();
      if (cache) fields.store(*cache, callbacks.warning, result.stats);
      result.stats.time_cache += seconds_since(store_begin);
      if (job.not_finite > 0) {
        warn(callbacks.warning, {},
             std::to_string(job.not_finite) +
                 " camera samples were not finite and count as black; please report the scene");
      }
    }
    result.stats.field_bytes_budget = wants_fields ? budget : 0;
  });

  Stats& stats = result.stats;
  stats.time_primary /= threads;
  stats.time_secondary /= threads;
  stats.time_bake /= threads;
  stats.method = options.method == Method::hybrid ? "hybrid" : "montecarlo";
  stats.spp = spp;
  stats.light_samples = options.light_samples;
  stats.tolerance = options.tolerance;
  stats.width = window.width;
  stats.height = window.height;
  stats.threads = threads;
  stats.isa = isa_name(settings.isa);
  stats.seed = settings.seed;
  stats.triangles = scene.triangle_count();
  stats.instances = scene.instances.size();
  stats.lights = scene.emitters.size();
  stats.time_total = seconds_since(begin);
  return result;
}

}  // namespace fieldtrace
