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
#include "field/field_cache.h"
#include "hybrid/aovs.h"
#include "hybrid/field_resolution.h"
#include "hybrid/field_survey.h"
#include "hybrid/shadow_answerer.h"
#include "hybrid/tiles.h"
#include "hybrid/transport.h"

namespace fieldtrace {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int k_tile_size = 32;
// Camera samples in one batch: enough for full packets and queues, few enough for the second-level cache.
constexpr int k_batch_samples = 4096;

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

// The fields of a hybrid render, one per shape that wants one; all null for Monte Carlo and at tolerance 0.
struct FieldSet {
  std::vector<std::unique_ptr<Field>> fields;
  std::vector<uint8_t> left_to_rays;  // per shape: has a field, which is not asked
  std::vector<uint8_t> own_to_rays;   // per shape: is not asked about its own receivers
  FieldParameters parameters;

  std::vector<Field*> pointers() const {
    std::vector<Field*> p;
    for (size_t s = 0; s < fields.size(); ++s) p.push_back(left_to_rays[s] ? nullptr : fields[s].get());
    return p;
  }
};

FieldSet make_fields(const Scene& scene, const RenderOptions& options, uint64_t rays_per_light) {
  FieldSet set;
  set.parameters = choose_resolution(scene, rays_per_light);
  if (options.directions) set.parameters.directions = options.directions;
  if (options.plane) set.parameters.plane = options.plane;
  const bool wanted = options.method == Method::hybrid && (options.tolerance > 0.0f || options.force_ask);
  for (const Shape& shape : scene.shapes) {
    set.fields.push_back(
        wanted && wants_field(shape) ? std::make_unique<Field>(field_ball(shape.bounds), set.parameters) : nullptr);
  }
  set.left_to_rays.assign(set.fields.size(), 0);
  set.own_to_rays.assign(set.fields.size(), 0);
  return set;
}

// The cache of `options`, null where there is none or nothing is kept in it.
std::unique_ptr<FieldCache> open_cache(const RenderOptions& options, const FieldSet& set, const WarningSink& warning) {
  const bool any = std::any_of(set.fields.begin(), set.fields.end(), [](const auto& f) { return f != nullptr; });
  if (options.field_cache.empty() || !any) return nullptr;
  return std::make_unique<FieldCache>(options.field_cache, warning);
}

// Calls use(field, identity) for every field.
template <class Use>
void for_each_field(const Scene& scene, const FieldSet& set, const Use& use) {
  for (size_t s = 0; s < set.fields.size(); ++s) {
    if (set.fields[s]) use(*set.fields[s], field_identity(scene.shapes[s], set.parameters));
  }
}

// A finished picture is worth more than its fields: what cannot be kept is told, not thrown.
void store_fields(const Scene& scene, const FieldSet& set, FieldCache& cache, const WarningSink& warning,
                  Stats& stats) {
  for_each_field(scene, set, [&](const Field& field, const FieldIdentity& identity) {
    try {
      cache.store(field, identity);
    } catch (const Error& e) {
      warn(warning, {}, std::string(e.what()) + "; the field is not kept");
    }
    stats.field_bytes_disk += cache.bytes_on_disk(identity);
  });
}

void count_fields(const FieldSet& set, Stats& stats) {
  for (const auto& field : set.fields) {
    if (!field) continue;
    const bool is_left = set.left_to_rays[size_t(&field - set.fields.data())] != 0;
    (is_left ? stats.field_left_to_rays : stats.field_objects) += 1;
    stats.field_own_to_rays += !is_left && set.own_to_rays[size_t(&field - set.fields.data())];
    stats.field_cells_baked += field->cells_baked();
    stats.field_cells_full += field->cells_full();
    stats.field_bytes_memory += field->bytes();
    stats.field_directions = set.parameters.directions;
    stats.field_plane = set.parameters.plane;
  }
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

// A pixel's samples are added in the order of their indices, whatever the batches.
// False if it was stopped: the tile is then left black.
bool render_tile(Job& job, const Rect& tile, TransportWorker& worker) {
  const std::vector<PixelPosition> pixels = tile_pixels(tile);
  std::vector<PixelSums> sums(pixels.size());
  const size_t total = pixels.size() * size_t(job.spp);
  const size_t batch = std::max(k_batch_samples / job.context.settings.lobe_samples, 16);
  std::vector<CameraSample> samples;
  std::vector<SampleResult> results(std::min(batch, total));
  for (size_t begin = 0; begin < total; begin += batch) {
    if (job.stopped()) return false;
    const size_t end = std::min(begin + batch, total);
    samples.clear();
    for (size_t i = begin; i < end; ++i) {
      const PixelPosition& p = pixels[i / size_t(job.spp)];
      samples.push_back({uint32_t(p.x), uint32_t(p.y), uint32_t(i % size_t(job.spp))});
    }
    worker.trace(samples, {results.data(), samples.size()});
    for (size_t i = begin; i < end; ++i) {
      const SampleResult& r = results[i - begin];
      PixelSums& pixel = sums[i / size_t(job.spp)];
      if (is_finite(r.radiance)) {
        pixel.radiance += DVec3(r.radiance);
      } else {
        ++job.not_finite;
      }
      pixel.aovs.add(r.first);
    }
  }
  for (size_t i = 0; i < pixels.size(); ++i) {
    if (contains(job.window, pixels[i])) write_pixel(job, pixels[i], sums[i]);
  }
  return true;
}

// Finds out which fields are not worth asking. False if it was stopped.
bool leave_to_rays(const Scene& scene, const Accel& accel, const CameraSampler& camera, const RenderOptions& options,
                   const TransportSettings& settings, int spp, const std::atomic<bool>* stop, FieldSet& set,
                   Stats& stats) {
  const bool any = std::any_of(set.fields.begin(), set.fields.end(), [](const auto& f) { return f != nullptr; });
  // Where every cell answers, or none by request, there is nothing to find out.
  if (!any || !options.leave_to_rays || options.force_ask || options.tolerance >= 1.0f) return true;
  AnswererSettings counting{settings.isa, options.tolerance, false, false, options.whole_lights};
  counting.count_uses = true;
  const ShadowAnswerer answerer(scene, accel, set.pointers(), counting);
  const TransportContext context(scene, accel, camera, answerer, settings);
  const FieldSurvey survey = survey_fields(context, crop_window(scene.film, {}), spp, stop);
  stats.survey_rays = survey.stats.rays_exact;
  stats.bake_rays += survey.stats.bake_rays;
  stats.time_bake += survey.stats.time_bake;
  if (survey.interrupted) return false;
  for (size_t s = 0; s < set.fields.size(); ++s) {
    set.left_to_rays[s] = set.fields[s] && leaves_to_rays(survey.uses[s], survey.scale, options.fewest_answers);
    set.own_to_rays[s] = set.fields[s] && leaves_own_to_rays(survey.uses[s]);
  }
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
    const CameraSampler camera(scene.camera, scene.film);
    const uint64_t rays_per_light =
        uint64_t(window.width) * uint64_t(window.height) * uint64_t(spp) * uint64_t(options.light_samples);
    FieldSet fields = make_fields(scene, options, rays_per_light);
    const Clock::time_point cache_begin = Clock::now();
    const std::unique_ptr<FieldCache> cache = open_cache(options, fields, callbacks.warning);
    if (cache) for_each_field(scene, fields, [&](Field& f, const FieldIdentity& id) { cache->load(f, id); });
    result.stats.time_cache = seconds_since(cache_begin);
    const bool surveyed =
        leave_to_rays(scene, accel, camera, options, settings, spp, callbacks.stop, fields, result.stats);
    AnswererSettings answerer_settings{settings.isa, options.tolerance, options.check, options.force_ask,
                                       options.whole_lights};
    answerer_settings.own_to_rays = fields.own_to_rays;
    const ShadowAnswerer answerer(scene, accel, fields.pointers(), answerer_settings);
    const TransportContext context(scene, accel, camera, answerer, settings);

    result.image = make_image(window, aovs);
    Job job{context, aovs, window, spp, result.image, callbacks.stop};
    const std::vector<Rect> tiles = make_tiles(traced_window(scene, window), k_tile_size);
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
    result.interrupted = interrupted;
    for (const TransportWorker& worker : workers) result.stats.merge_counters(worker.stats());
    count_fields(fields, result.stats);
    const Clock::time_point store_begin = Clock::now();
    if (cache) store_fields(scene, fields, *cache, callbacks.warning, result.stats);
    result.stats.time_cache += seconds_since(store_begin);
    if (job.not_finite > 0) {
      warn(callbacks.warning, {},
           std::to_string(job.not_finite) +
               " camera samples were not finite and count as black; please report the scene");
    }
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
