#include "hybrid/render/render.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <mutex>
#include <thread>

#include "core/camera/camera.h"
#include "core/math/finite.h"
#include "core/platform/parallel.h"
#include "core/trace/accel.h"
#include "hybrid/fields/field_resolution.h"
#include "hybrid/fields/field_set.h"
#include "hybrid/fields/thesis_fields.h"
#include "hybrid/glossy/lobe_answerer.h"
#include "hybrid/light/direct_light.h"
#include "hybrid/path/aovs.h"
#include "hybrid/path/tiles.h"
#include "hybrid/render/field_survey.h"
#include "hybrid/render/glossy_stage.h"
#include "hybrid/render/indirect_stage.h"
#include "hybrid/render/open_light_samples.h"
#include "hybrid/render/sky_stage.h"
#include "hybrid/render/trace_pixels.h"
#include "hybrid/render/transport.h"
#include "hybrid/stats/stopwatch.h"
#include "hybrid/visibility/shadow_answerer.h"

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

// Indices into sample sequences have 32 bits: camera samples x lobe samples must stay below this.
constexpr long long k_most_samples = 1ll << 31;

void check_options(const RenderOptions& o, int spp) {
  check_range("the number of camera samples", spp, 1, 1 << 24);
  check_range("the number of light samples", o.light_samples, 1, k_most_light_samples);
  check_range("the number of lobe samples", o.lobe_samples, 1, k_most_lobe_samples);
  check_range("camera samples x light samples", int64_t(spp) * o.light_samples, 1, k_most_samples);
  check_range("camera samples x lobe samples", int64_t(spp) * o.lobe_samples, 1, k_most_samples);
  check_range("the number of threads", o.threads, 0, 4096);
  if (!(o.tolerance >= 0.0f && o.tolerance <= 1.0f))
    throw UsageError("the tolerance is " + std::to_string(o.tolerance) + "; it must lie between 0 and 1");
  if (!(o.ao_distance > 0.0f))
    throw UsageError("the distance of ambient occlusion is " + std::to_string(o.ao_distance) +
                     "; it must be greater than 0");
  if (o.chart == Chart::thesis) thesis_directions(o.directions, o.plane);
  if (o.max_depth) check_range("the maximum depth", *o.max_depth, -1, 1 << 30);
}

Rect crop_window(const Film& film, const std::optional<Rect>& requested) {
  const Rect film_window =
      film.crop.width > 0 && film.crop.height > 0 ? film.crop : Rect{0, 0, film.width, film.height};
  if (!requested) return film_window;
  const Rect& r = *requested;
  if (!is_inside(r, film_window)) {
    throw UsageError("the crop window " + std::to_string(r.x) + "," + std::to_string(r.y) + "," +
                     std::to_string(r.width) + "," + std::to_string(r.height) + " must lie within the film's " +
                     std::to_string(film_window.x) + "," + std::to_string(film_window.y) + "," +
                     std::to_string(film_window.width) + "," + std::to_string(film_window.height));
  }
  return r;
}

// The pixels to trace for a window. Where candidates may overflow, a ray's test depends on its group, and the groups on
// the tile; whole tiles of the film are traced then, so that a pixel is the same in every window.
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

TransportSettings make_settings(const Scene& scene, const RenderOptions& options, int spp,
                                const std::vector<Aov>& aovs) {
  TransportSettings s;
  s.light_samples = options.light_samples;
  s.lobe_samples = options.lobe_samples;
  s.pixel_samples = std::min(spp, batch_samples(options.lobe_samples));
  s.max_depth = options.max_depth.value_or(scene.integrator.max_depth);
  s.rr_depth = scene.integrator.rr_depth;
  s.hide_emitters = scene.integrator.hide_emitters;
  s.seed = options.seed.value_or(scene.seed);
  s.isa = resolve_isa(options.isa);
  s.first_hits = !aovs.empty();
  s.count_first_hits =
      std::any_of(aovs.begin(), aovs.end(), [](Aov aov) { return aov == Aov::visibility || aov == Aov::exact; });
  s.count_reflections = std::any_of(aovs.begin(), aovs.end(), [](Aov aov) {
    return aov == Aov::reflected_depth || aov == Aov::reflected_object || aov == Aov::glossy_exact;
  });
  s.occlusion = std::find(aovs.begin(), aovs.end(), Aov::ao) != aovs.end();
  s.occlusion_distance = options.ao_distance;
  return s;
}

// The cache of `options`; null if there is none, or no fields to keep in it.
std::unique_ptr<FieldCache> open_cache(const RenderOptions& options, bool no_fields, const WarningSink& warning) {
  if (options.field_cache.empty() || no_fields) return nullptr;
  return std::make_unique<FieldCache>(options.field_cache, options.field_cache_limit, warning);
}

// Reports progress at most ten times a second, from whichever thread has just finished a tile.
class Progress {
 public:
  Progress(const RenderCallbacks& callbacks, size_t total) : callbacks_(callbacks), total_(total) {}

  void tile_done() {
    const size_t done = ++done_;
    if (!callbacks_.progress) return;
    const std::unique_lock lock(mutex_, std::try_to_lock);
    if (!lock || (done < total_ && seconds_since(last_) < 0.1)) return;
    last_ = Clock::now();
    // A thread that waited for the lock may hold an older count.
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

// A picture to be made: what all attempts at it share.
struct Picture {
  const Scene& scene;
  const RenderOptions& options;
  const RenderCallbacks& callbacks;
  int spp = 1;
  std::vector<Aov> aovs;
  Rect window;
  TransportSettings settings;
  bool wants_fields = false;
  uint64_t field_memory = 0;  // the budget

  Picture(const Scene& s, const RenderOptions& o, const RenderCallbacks& c);

  bool is_adaptive() const {
    if (options.light_estimator != LightEstimator::automatic)
      return options.light_estimator == LightEstimator::adaptive;
    return wants_fields && !options.force_undecided;
  }
  // Light samples of each camera sample where lights may be hidden; `open_rays` as FieldSurvey::open_rays.
  int open_samples(double open_rays) const {
    const int least = options.light_samples;
    const bool has_room = int64_t(spp) * std::max(least, k_most_open_samples) <= k_most_samples;
    return is_adaptive() && has_room ? open_light_samples(least, open_rays) : least;
  }
  bool stopped() const { return callbacks.stop && callbacks.stop->load(std::memory_order_relaxed); }
  // Of the whole film, so that fields, and with them pixels, are the same in every window.
  uint64_t film_samples() const {
    const Rect film = crop_window(scene.film, {});
    return uint64_t(film.width) * uint64_t(film.height) * uint64_t(spp);
  }
  uint64_t rays_per_light() const { return film_samples() * uint64_t(options.light_samples); }
};

Picture::Picture(const Scene& s, const RenderOptions& o, const RenderCallbacks& c)
    : scene(s), options(o), callbacks(c), spp(o.spp == 0 ? s.sample_count : o.spp) {
  check_options(options, spp);
  aovs = parse_aovs(options.aovs);
  window = crop_window(scene.film, options.crop);
  wants_fields = options.method == Method::hybrid && (options.tolerance > 0.0f || options.force_undecided);
  settings = make_settings(scene, options, spp, aovs);
  field_memory = options.field_memory ? options.field_memory : default_field_memory();
}

// What is made from a picture's scene, once for all attempts.
struct Stage {
  const Accel& accel;
  CameraSampler camera;
  std::vector<ShapeTraits> traits;
  std::shared_ptr<const LightTable> lights;
  uint64_t address_space = k_no_address_limit;  // that fields may reserve
  std::unique_ptr<FieldCache> cache = nullptr;  // opened when it is first needed
  SkyStage sky = {};
  VisibilityDevice* device = nullptr;  // null: the CPU
};

// Direction maps may take 1 / k_sky_share of the fields' budget, in addition to it.
constexpr uint64_t k_sky_share = 4;

SkyRequest sky_request(const Picture& picture, const Stage& stage) {
  SkyRequest request;
  const int depth = picture.settings.max_depth;
  const bool is_lit = has_sky(picture.scene) && depth != 0 && depth != 1;
  // A light sample sends one ray to the sky and one from the material.
  const uint64_t light_rays = 2 * picture.rays_per_light();
  if (is_lit || plans_indirect(picture.scene, stage.traits, depth, light_rays)) {
    request.light_rays = uint64_t(diffuse_share(picture.scene, stage.accel, stage.camera) * double(light_rays));
  }
  const bool is_open = picture.settings.occlusion_distance == k_infinity;
  if (picture.settings.occlusion && is_open) request.occlusion_rays = picture.rays_per_light();
  request.most_bytes = std::min(picture.field_memory, stage.address_space) / k_sky_share;
  return request;
}

FieldPlan first_plan(const Picture& picture, const Stage& stage) {
  const Scene& scene = picture.scene;
  const RenderOptions& options = picture.options;
  FieldPlan plan;
  plan.parameters = choose_resolution(scene, stage.traits, picture.rays_per_light());
  if (options.directions) plan.parameters.directions = options.directions;
  if (options.plane) plan.parameters.plane = options.plane;
  // No shape is left out for its cost where every cell answers, or where undecided cells or a resolution are requested.
  const bool by_request = options.force_undecided || options.directions || options.plane;
  if (options.leave_to_rays && !by_request && options.tolerance < 1.0f) {
    plan.light_samples = double(picture.rays_per_light()) * double(scene.emitters.size());
  }
  if (picture.wants_fields)
    plan.hit_instances =
        choose_hit_instances(scene, stage.traits, picture.settings, options, plan.parameters, picture.film_samples());
  return plan;
}

// Where maps answer for all lights, fields do only for glossy rays.
bool wants_fields(const Picture& picture, const Stage& stage, const FieldPlan& plan) {
  const std::vector<Emitter>& emitters = picture.scene.emitters;
  const bool maps_answer =
      stage.sky.light && std::all_of(emitters.begin(), emitters.end(), [](const Emitter& e) { return is_sky(e.kind); });
  return picture.wants_fields && !(maps_answer && plan.hit_instances.empty());
}

void warn_of_no_hits(const Picture& picture) {
  if (picture.options.field_hits != FieldHits::always) return;
  warn(picture.callbacks.warning, {},
       "--field-hits always: fields answer no glossy ray of this picture (docs/command_line.md says which they can)");
}

// What the tiles of one attempt share.
struct Job {
  const Picture& picture;
  const TransportContext& context;
  const FieldBudget& budget;
  Image& image;
  std::atomic<bool> interrupted = false;
  std::atomic<uint64_t> not_finite = 0;
};

struct PixelSums {
  DVec3 radiance = DVec3(0.0);
  AovSums aovs;
};

void write_pixel(const Job& job, const PixelPosition& p, const PixelSums& sums) {
  float* out = job.image.pixel(p.x - job.picture.window.x, p.y - job.picture.window.y);
  for (int c = 0; c < 3; ++c) *out++ = float(sums.radiance[c] / job.picture.spp);
  sums.aovs.write(job.picture.aovs, out);
}

// Returns false if it was stopped; the tile then stays black.
bool render_tile(Job& job, const Rect& tile, TransportWorker& worker) {
  const std::vector<PixelPosition> pixels = tile_pixels(tile);
  std::vector<PixelSums> sums(pixels.size());
  const auto goes_on = [&] { return !job.picture.stopped() && !job.budget.exceeded(); };
  const auto add = [&](size_t pixel, std::span<const Rgb> radiance, std::span<const FirstHit> firsts) {
    DVec3 sum = sums[pixel].radiance;
    for (const Rgb& r : radiance) sum += DVec3(r);
    if (!std::isfinite(sum.x + sum.y + sum.z)) {  // never by overflow: the samples are floats
      sum = sums[pixel].radiance;
      for (const Rgb& r : radiance) {
        if (is_finite(r)) {
          sum += DVec3(r);
        } else {
          ++job.not_finite;
        }
      }
    }
    sums[pixel].radiance = sum;
    for (const FirstHit& first : firsts) sums[pixel].aovs.add(first);
  };
  if (!trace_pixels(pixels, job.picture.spp, job.picture.settings.lobe_samples, worker, goes_on, add)) return false;
  for (size_t i = 0; i < pixels.size(); ++i) {
    if (contains(job.picture.window, pixels[i])) write_pixel(job, pixels[i], sums[i]);
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

// Renders all tiles, unless the budget or an interrupt stops it. Returns the workers' merged counters.
Stats render_tiles(Job& job) {
  const std::vector<Rect> tiles = make_tiles(traced_window(job.picture.scene, job.picture.window), k_tile_size);
  Progress progress(job.picture.callbacks, tiles.size());
  tbb::enumerable_thread_specific<TransportWorker> workers([&] { return TransportWorker(job.context); });
  parallel_for(tiles.size(), [&](size_t i) {
    if (job.interrupted) return;
    bool done = false;
    // Isolated: a thread that waits for a bake inside a tile must not start another tile with the same worker.
    tbb::this_task_arena::isolate([&] { done = render_tile(job, tiles[i], workers.local()); });
    if (done) {
      progress.tile_done();
    } else {
      job.interrupted = true;
    }
  });
  Stats stats;
  for (const TransportWorker& worker : workers) stats.merge_counters(worker.stats());
  return stats;
}

// The settings where `fields` answer shadow rays of bundles; without any, those of Monte Carlo.
TransportSettings settings_for(const Picture& picture, const FieldSet& fields) {
  TransportSettings s = picture.settings;
  const RenderOptions& options = picture.options;
  const std::vector<Field*> answering = fields.pointers();
  s.estimates = options.whole_lights && !options.force_undecided &&
                std::any_of(answering.begin(), answering.end(), [](const Field* f) { return f != nullptr; });
  if (!s.estimates) return s;
  s.most_undecided = int(k_most_undecided_strata * options.tolerance / k_default_tolerance);
  return s;
}

// Light samples of each pixel that a survey takes at most.
constexpr int64_t k_most_survey_samples = 64;

// Where every cell answers, or all are undecided by request, there is nothing to survey.
bool wants_survey(const Picture& picture, const FieldSet& fields) {
  const RenderOptions& options = picture.options;
  return fields.answers_shadows() && options.leave_to_rays && !options.force_undecided && options.tolerance < 1.0f;
}

// Surveys the picture with `light_samples` from one point of each pixel, as clusters will ask for them together.
FieldSurvey survey_picture(const Picture& picture, const Stage& stage, const std::vector<Field*>& fields,
                           std::vector<uint8_t> self_to_rays, TransportSettings settings, int light_samples,
                           Stats& stats) {
  const RenderOptions& options = picture.options;
  AnswererSettings counting{picture.settings.isa, options.tolerance, false, false, options.whole_lights};
  counting.count_uses = true;
  counting.self_to_rays = std::move(self_to_rays);
  const ShadowAnswerer answerer(picture.scene, stage.accel, stage.traits, fields, counting);
  settings.light_samples = light_samples;
  settings.sky_by_maps = stage.sky.light != nullptr;
  settings.first_hits = settings.count_first_hits = settings.count_reflections = settings.occlusion = false;
  const TransportContext context(picture.scene, stage.accel, stage.camera, answerer, settings, stage.lights);
  const double repeats = double(picture.spp) * double(options.light_samples) / double(light_samples);
  FieldSurvey survey = survey_fields(context, crop_window(picture.scene.film, {}), repeats, picture.callbacks.stop);
  stats.survey_rays += survey.stats.rays_exact;
  stats.add_bake(survey.stats);
  return survey;
}

// Leaves to exact rays the objects that too few light samples pass for what their fields cost, before anything is baked
// or read. Returns false if it was stopped.
// `open_samples` becomes the number of light samples that exact rays alone would get where lights may be hidden.
bool leave_unpaid(const Picture& picture, const Stage& stage, FieldSet& fields, int& open_samples, Stats& stats) {
  const bool leaves = wants_survey(picture, fields) && picture.options.whole_lights;
  if (!leaves && !picture.is_adaptive()) return true;
  TransportSettings settings = picture.settings;
  settings.pixel_samples = k_fewest_cone_samples;  // points are tested one by one
  const std::vector<Field*> none(picture.scene.shapes.size(), nullptr);
  FieldSurvey survey = survey_picture(picture, stage, none, {}, settings, 1, stats);
  if (survey.interrupted) return false;
  open_samples = picture.open_samples(survey.open_rays);
  survey.scale *= double(open_samples) / double(picture.options.light_samples);
  if (leaves) fields.leave_unpaid(survey);
  return true;
}

// Leaves to exact rays what fields answer too little of. Returns false if it was stopped.
bool leave_to_rays(const Picture& picture, const Stage& stage, FieldSet& fields, int& open_samples, Stats& stats) {
  if (!wants_survey(picture, fields)) return true;
  const int64_t of_pixel = int64_t(picture.spp) * picture.options.light_samples;
  TransportSettings settings = settings_for(picture, fields);
  settings.pixel_samples = 1;
  FieldSurvey survey = survey_picture(picture, stage, fields.pointers(), fields.self_to_rays(), settings,
                                      int(std::min<int64_t>(of_pixel, k_most_survey_samples)), stats);
  if (survey.interrupted) return false;
  // What fields answer spares as many light samples as exact rays alone would get.
  survey.scale *= double(open_samples) / double(picture.options.light_samples);
  open_samples = picture.open_samples(survey.open_rays);
  fields.leave_to_rays(survey, picture.options.fewest_answers);
  return true;
}

// Prefiltered radiance maps may take 1 / k_map_share of the fields' budget, in addition to it.
constexpr uint64_t k_map_share = 4;

void warn_of_no_maps(const Picture& picture, const Stage& stage, size_t objects) {
  if (objects == 0) return;
  const bool by_addresses = stage.address_space < picture.field_memory;
  warn(picture.callbacks.warning, {},
       "radiance maps of " + std::to_string(objects) + (objects == 1 ? " object" : " objects") +
           " do not fit into their memory, and rays answer for them; raise " +
           (by_addresses ? "the limit of address space (ulimit -v)" : "--field-memory") + " to have them");
}

void warn_of_not_finite(const Job& job) {
  if (job.not_finite == 0) return;
  warn(job.picture.callbacks.warning, {},
       std::to_string(job.not_finite) + " camera samples were not finite and count as black; please report the scene");
}

std::string outgrown(const Picture& picture, bool out_of_addresses, const std::string& change) {
  if (out_of_addresses) {
    return "the fields outgrew the address space that they may reserve; the render " + change +
           " (raise the limit, ulimit -v, to avoid it)";
  }
  return "the fields outgrew their " + std::to_string(picture.field_memory / 1000000) + " MB; the render " + change +
         " (raise --field-memory to avoid it)";
}

// One attempt with the fields of `plan`. Returns false if they exceeded their memory; `plan` is then the next
// attempt's.
bool attempt(const Picture& picture, Stage& stage, FieldPlan& plan, RenderResult& result) {
  const RenderOptions& options = picture.options;
  const WarningSink& warning = picture.callbacks.warning;
  Stats& stats = result.stats;
  FieldSet fields(picture.scene, stage.traits, plan, picture.field_memory, wants_fields(picture, stage, plan),
                  stage.address_space);
  int open_samples = options.light_samples;
  bool surveyed = leave_unpaid(picture, stage, fields, open_samples, stats);
  if (!stage.cache) stage.cache = open_cache(options, fields.empty(), warning);
  FieldCache* const cache = stage.cache.get();
  if (cache) {
    const ScopedTimer timer(stats.time_cache);
    fields.load(*cache);
  }
  surveyed = surveyed && leave_to_rays(picture, stage, fields, open_samples, stats);
  AnswererSettings settings{picture.settings.isa, options.tolerance, options.check, options.force_undecided,
                            options.whole_lights};
  settings.self_to_rays = fields.self_to_rays();
  settings.device = stage.device;
  const ShadowAnswerer answerer(picture.scene, stage.accel, stage.traits, fields.pointers(), settings);
  TransportSettings tracing = settings_for(picture, fields);
  tracing.sky_by_maps = stage.sky.light != nullptr;
  tracing.open_light_samples = stats.open_light_samples = open_samples;
  if (picture.is_adaptive()) tracing.open_sun_samples = std::max(options.light_samples, k_open_sun_samples);
  TransportContext context(picture.scene, stage.accel, stage.camera, answerer, tracing, stage.lights);
  context.sky = stage.sky.light.get();
  context.indirect = context.sky ? context.sky->indirect() : nullptr;
  context.occlusion_sky = stage.sky.occlusion.get();
  // Single rays of the layer `ao` gain nothing from fields.
  std::optional<ShadowAnswerer> for_occlusion;
  if (picture.settings.occlusion && !context.occlusion_sky && !fields.empty()) {
    const std::vector<Field*> no_fields(picture.scene.shapes.size(), nullptr);
    for_occlusion.emplace(picture.scene, stage.accel, stage.traits, no_fields, settings);
    context.occlusion_answerer = &*for_occlusion;
  }
  const std::vector<Field*> all_fields = fields.all_pointers();
  std::optional<GlossyStage> glossy;
  if (picture.wants_fields) {
    glossy.emplace(GlossyInput{picture.scene, stage.accel, stage.camera, stage.traits, stage.lights, picture.settings,
                               options, all_fields, plan.hit_instances, picture.film_samples(),
                               std::min(picture.field_memory, stage.address_space) / k_map_share});
    context.lobes = glossy->lobes();
    context.hits = glossy->hits();
    warn_of_no_maps(picture, stage, glossy->maps_left_out());
  }
  result.image = make_image(picture.window, picture.aovs);
  Job job{picture, context, fields.budget(), result.image};
  job.interrupted = !surveyed;
  const Stats done = render_tiles(job);
  stats.field_bytes_peak = std::max(stats.field_bytes_peak, fields.budget().used());
  // Even if all tiles were finished before the budget ran out: whether they are depends on the threads.
  if (fields.budget().exceeded() && !picture.stopped()) {
    stats.add_bake(done);
    stats.field_restarts += 1;
    std::string change;
    plan = fields.next_plan(change);
    warn(warning, {}, outgrown(picture, fields.budget().out_of_addresses(), change));
    return false;
  }
  result.interrupted = job.interrupted;
  stats.merge_counters(done);
  fields.count(stats);
  stats.field_bytes_maps = context.lobes ? context.lobes->bytes() : 0;
  if (stage.sky.maps) stats.field_bytes_maps += stage.sky.maps->bytes();
  if (context.indirect) stats.field_bytes_maps += context.indirect->bytes();
  if (cache) {
    const ScopedTimer timer(stats.time_cache);
    fields.store(*cache, options.must_keep_fields ? IfUnkept::fail : IfUnkept::warn, warning, stats);
  }
  warn_of_not_finite(job);
  return true;
}

// Renders the picture with fields of the thesis' chart.
void render_by_thesis(const Picture& picture, const Stage& stage, RenderResult& result) {
  const RenderOptions& options = picture.options;
  const RenderCallbacks& callbacks = picture.callbacks;
  const int m = thesis_directions(options.directions, options.plane);
  ThesisFieldSet fields(picture.scene, stage.traits, m, picture.field_memory);
  const std::unique_ptr<FieldCache> cache = open_cache(options, fields.empty(), callbacks.warning);
  ThesisBakeCallbacks bake;
  bake.stop = callbacks.stop;
  if (callbacks.progress) bake.progress = [&](float share) { callbacks.progress(share, "bake"); };
  const bool complete = fields.make(stage.accel, cache.get(), bake, callbacks.warning, result.stats);
  AnswererSettings settings{picture.settings.isa, options.tolerance, options.check};
  const std::vector<Field*> none(picture.scene.shapes.size(), nullptr);
  const ShadowAnswerer answerer(picture.scene, stage.accel, stage.traits, none, settings, fields.pointers());
  const TransportContext context(picture.scene, stage.accel, stage.camera, answerer, picture.settings, stage.lights);
  const FieldBudget no_limit;
  result.image = make_image(picture.window, picture.aovs);
  Job job{picture, context, no_limit, result.image};
  job.interrupted = !complete;
  result.stats.merge_counters(render_tiles(job));
  result.interrupted = job.interrupted;
  fields.count(result.stats);
  warn_of_not_finite(job);
}

}  // namespace

RenderResult render(const Scene& scene, const RenderOptions& options, const RenderCallbacks& callbacks) {
  const Clock::time_point begin = Clock::now();
  // Each attempt would repeat its warnings.
  RenderCallbacks told_once = callbacks;
  told_once.warning = without_repeats(callbacks.warning);
  const Picture picture(scene, options, told_once);
  const int threads = options.threads > 0 ? options.threads : std::max(int(std::thread::hardware_concurrency()), 1);

  std::unique_ptr<VisibilityDevice> device;
  if (picture.wants_fields && options.chart == Chart::orthographic) {
    device =
        open_device(options.device, {segment_kernels(picture.settings.isa), options.device_memory, told_once.warning});
  }
  RenderResult result;
  // By default TBB starts no more workers than there are hardware threads.
  std::optional<tbb::global_control> more_threads;
  if (threads > int(std::thread::hardware_concurrency()))
    more_threads.emplace(tbb::global_control::max_allowed_parallelism, size_t(threads));
  tbb::task_arena arena(threads);
  arena.execute([&] {
    const Clock::time_point build_begin = Clock::now();
    const Accel accel(scene);
    result.stats.time_build = seconds_since(build_begin);
    Stage stage{accel, CameraSampler(scene.camera, scene.film), shape_traits(scene),
                std::make_shared<const LightTable>(make_lights(scene)), reservable_bytes()};
    if (options.chart == Chart::thesis && picture.wants_fields) {
      warn_of_no_hits(picture);
      render_by_thesis(picture, stage, result);
      return;
    }
    if (picture.wants_fields) {
      const auto cache = [&] {
        stage.cache = open_cache(options, /*no_fields=*/false, told_once.warning);
        return stage.cache.get();
      };
      const SkyRequest request = sky_request(picture, stage);
      stage.sky = make_sky(scene, accel, stage.traits, options, request, cache, told_once, result.stats);
      make_indirect(
          {scene, accel, stage.camera, stage.traits, stage.lights, picture.settings, told_once, request, options.check},
          stage.sky, result.stats);
      if (stage.sky.light && !has_sky(scene) && !stage.sky.light->indirect()) stage.sky.light.reset();
    }
    stage.device = device.get();
    FieldPlan plan = first_plan(picture, stage);
    if (plan.hit_instances.empty()) warn_of_no_hits(picture);
    for (bool is_done = false; !is_done;) {
      is_done = attempt(picture, stage, plan, result);
      if (device) device->forget_fields();
    }
  });

  Stats& stats = result.stats;
  stats.field_bytes_budget = picture.wants_fields ? picture.field_memory : 0;
  stats.time_primary /= threads;
  stats.time_secondary /= threads;
  stats.time_bake /= threads;
  stats.method = options.method == Method::hybrid ? "hybrid" : "montecarlo";
  stats.spp = picture.spp;
  stats.light_samples = options.light_samples;
  stats.open_light_samples = std::max(stats.open_light_samples, options.light_samples);
  stats.tolerance = options.tolerance;
  stats.width = picture.window.width;
  stats.height = picture.window.height;
  stats.threads = threads;
  stats.isa = isa_name(picture.settings.isa);
  stats.device = device ? options.device : "cpu";
  if (device) {
    const DeviceCounts counts = device->counts();
    stats.device_blocks = counts.blocks;
    stats.device_blocks_cpu = counts.blocks_cpu;
    stats.device_waves = counts.waves;
    stats.device_bytes = counts.bytes_peak;
  }
  stats.seed = picture.settings.seed;
  stats.triangles = scene.triangle_count();
  stats.instances = scene.instances.size();
  stats.lights = scene.emitters.size();
  stats.time_total = seconds_since(begin);
  return result;
}

}  // namespace fieldtrace
