#include "hybrid/render/render.h"

#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <thread>

#include "core/platform/stop_at.h"
#include "core/platform/stopwatch.h"
#include "core/platform/threads.h"
#include "hybrid/fields/field_resolution.h"
#include "hybrid/fields/thesis_fields.h"
#include "hybrid/render/attempt.h"
#include "hybrid/render/glossy_stage.h"
#include "hybrid/render/indirect_stage.h"
#include "hybrid/render/picture.h"
#include "hybrid/render/picture_identity.h"
#include "hybrid/render/render_pilot.h"
#include "hybrid/render/render_tiles.h"
#include "hybrid/render/sky_stage.h"
#include "hybrid/render/sky_survey.h"
#include "hybrid/survey/light_noise.h"
#include "hybrid/visibility/shadow_answerer.h"

namespace fieldtrace {
namespace {

// Numbers that may still be multiplied by what maps gain.
uint64_t whole_rays(double rays) { return uint64_t(std::min(rays, 0x1p58)); }

// `wants_bounces`: unless they are too dear.
SkyRequest sky_request(const Picture& picture, Stage& stage, bool wants_bounces, Stats& stats) {
  SkyRequest request;
  const Scene& scene = picture.scene;
  const int depth = picture.settings.max_depth;
  const bool is_lit = has_sky(scene) && depth != 0 && depth != 1;
  if (wants_bounces) {
    IndirectPlan plan = plan_indirect(scene, *stage.lights, stage.traits, depth);
    request.bounce_rays = plan.rays;
    request.sends = std::move(plan.sends);
  }
  if (is_lit || picture.settings.occlusion || request.bounce_rays > 0) {
    if (!stage.sky_survey) {
      stage.sky_survey = survey_sky(scene, stage.accel, stage.traits, stage.camera, picture.sampled_window());
    }
    const SkySurvey& survey = *stage.sky_survey;
    const auto samples = double(picture.film_samples()), lights = samples * double(picture.options.light_samples);
    if (picture.settings.occlusion) request.occlusion_rays = whole_rays(survey.met * lights);
    // Diffuse surfaces send one path. The sky gets a ray from each light sample and each path.
    const double to_sky = is_lit ? survey.diffuse * (lights + samples) : 0.0;
    const double of_path = rays_a_path(depth, survey.open, scene.emitters.size()) - (is_lit ? 1.0 : 0.0);
    const double with_paths = to_sky + survey.diffuse * samples * std::max(of_path, 0.0);
    const RenderOptions& o = picture.options;
    const bool suits = admits_maps(o) && (o.at_any_cost() || !survey.is_enclosed());
    const double known = request.bounce_rays > 0 ? survey.share_of_met_next(request.sends) : 0.0;
    std::optional<LightNoise>& noise = stage.light_noise;
    // A camera ray that meets nothing takes half of another's time; maps answer one light sample or many in the same.
    const double by_rays = 0.5 * (1.0 + survey.met) * samples + with_paths,
                 by_maps = by_rays - survey.diffuse * (lights - samples);
    // The rays that maps may cost if they know such a share of what objects send on: as many as they spare.
    const auto worth = [&](double share) {
      if (!is_lit) return double(k_usual_maps_gain) * with_paths;  // a lamp's own noise stays
      if (!noise && (!o.at_any_cost() || picture.adapts_light_samples()))
        noise.emplace(picture_survey(picture, stage, picture.survey_samples()), stats);
      const LightNoise::Without without = noise ? noise->without(share) : LightNoise::Without();
      const double gain = o.at_any_cost() ? LightNoise::most_gain() : without.gain;
      return std::max(gain * by_rays - k_time_by_maps * by_maps, 0.0);
    };
    if (suits && request.bounce_rays > 0 && with_paths > 0.0) {
      const double all = worth(known), bounces = double(request.bounce_rays);
      request.bounces = bounces <= known * all;
      if (request.bounces) {
        request.light_cost = whole_rays(is_lit ? all - bounces : with_paths * double(k_bounce_maps_gain));
      }
    }
    if (suits) request.light_rays = whole_rays(request.bounces ? to_sky + known * (with_paths - to_sky) : to_sky);
    if (request.light_rays > 0 && !request.bounces) request.light_cost = whole_rays(worth(0.0));
    if (noise) {
      const double share = request.bounces ? known : 0.0;
      request.noise_left = noise->without(share).share;
      if (!o.at_any_cost() && !picture.by_rounds()) {
        const double points = survey.diffuse * samples / double(picture.spp);
        request.frame = {by_maps, points * double(scene.instances.size()), noise->left_of(share, picture.spp),
                         (1.0 - survey.open) * noise->light()};
      }
    }
    if (request.light_cost == 0) request.light_rays = 0;
    request.seen = survey.seen;
  }
  request.occlusion_distance = picture.settings.occlusion_distance;
  request.samples = picture.by_rounds() ? std::numeric_limits<uint64_t>::max()
                                        : uint64_t(picture.spp) * uint64_t(picture.options.light_samples);
  request.coarse = stage.accuracy == FieldAccuracy::coarse_maps;
  request.most_bytes = std::min(picture.field_memory, stage.address_space) / FieldBudget::k_map_share;
  return request;
}

void drop_maps(Stage& stage, Stats& stats) {
  if (stage.sky.noise_left) stage.open_noise.reset();  // surveyed for what they leave
  stage.sky = {};
  stats.sky_objects = 0;
  stats.sky_directions = stats.sky_texels = 0;
}

// Makes the direction maps of the stage's accuracy, where the picture wants any. Where they are not whole once surveys
// have had their share of a time limit, rays answer.
void make_maps(const Picture& picture, Stage& stage, Stats& stats) {
  if (!picture.wants_fields) return;
  drop_maps(stage, stats);
  const StopAt stop(picture.callbacks.stop, stage.survey_end);
  RenderCallbacks callbacks = picture.callbacks;
  callbacks.stop = stop.flag();
  SkyRequest request = sky_request(picture, stage, /*wants_bounces=*/true, stats);
  const auto cache = [&] { return cache_of(picture, stage); };
  const auto make = [&] {
    stage.sky = make_sky(picture.scene, stage.accel, stage.traits, picture.options, request, cache, callbacks, stats);
  };
  make();
  // Maps may pay where they and bounces together do not.
  if (request.bounces && !stage.sky.maps && !stop.is_set()) {
    request = sky_request(picture, stage, /*wants_bounces=*/false, stats);
    make();
  }
  const bool is_late_for_maps = (stop.is_set() || stage.surveys_are_over()) && !stage.sky.maps;
  const bool has_all = make_indirect({picture.scene, stage.accel, stage.camera, stage.traits, stage.lights,
                                      picture.settings, callbacks, request, picture.options.check},
                                     stage.sky, stats);
  if ((is_late_for_maps || !has_all) && !picture.stopped()) {
    drop_maps(stage, stats);
    if (!stage.resumed) stage.accuracy = FieldAccuracy::rays;
    return;
  }
  if (request.bounces && stage.sky.light && !stage.sky.light->indirect()) stage.sky.noise_left.reset();
  if (stage.sky.light && !has_sky(picture.scene) && !stage.sky.light->indirect()) {
    stage.sky.light.reset();
    stage.sky.can_be_finer = false;
    if (!stage.sky.occlusion) drop_maps(stage, stats);
  }
}

// The samples of a pixel that a resumed picture has at least: the first command's, and with those of the pass that it
// is amid. Tiles of it that are done have them.
int samples_begun(const Checkpoint& state) {
  const bool is_begun = !state.film.pixels.empty() && !state.counts.empty() && state.counts[0] > 0;
  if (!is_begun) return state.planned_samples;
  const std::vector<uint8_t>& done = state.tiles_done;
  const bool is_done = std::all_of(done.begin(), done.end(), [](uint8_t tile) { return tile != 0; });
  uint32_t fewest = std::numeric_limits<uint32_t>::max();
  for (const StoredSums& p : state.film.pixels) fewest = std::min(fewest, PixelSums(p).samples());
  return std::max(state.planned_samples, int(fewest + (is_done ? 0 : state.counts[0])));
}

// Whether lamps beside a sky that maps answer for are left to rays: the samples that a picture by rounds is expected to
// need are those of a sky without maps, many times what it takes with them (docs/decisions/051-blocks-of-pixels.md).
bool leaves_lamps(const Picture& picture, const Stage& stage) {
  return picture.by_rounds() && stage.sky.light && has_sky(picture.scene);
}

// Once maps are made.
FieldPlan first_plan(const Picture& picture, const Stage& stage) {
  const Scene& scene = picture.scene;
  const RenderOptions& options = picture.options;
  FieldPlan plan;
  plan.parameters = choose_resolution(scene, stage.traits, picture.rays_per_light());
  if (options.directions) plan.parameters.directions = options.directions;
  if (options.plane) plan.parameters.plane = options.plane;
  // No shape is left out for its cost where every cell answers, or undecided cells are requested.
  if (!options.at_any_cost() && !options.force_undecided && options.base_tolerance() < 1.0f) {
    const int open_samples = picture.most_open_samples();
    const auto samples = double(picture.film_samples()) * open_samples;
    const bool by_rays = picture.has_few_light_samples(open_samples) || leaves_lamps(picture, stage);
    plan.light_samples = by_rays ? 0.0 : samples * double(scene.emitters.size());
  }
  if (picture.wants_fields)
    plan.hit_instances =
        choose_hit_instances(scene, stage.traits, picture.settings, options, plan.parameters, picture.film_samples());
  return plan;
}

void warn_of_no_hits(const Picture& picture) {
  if (picture.options.field_hits != FieldHits::always) return;
  warn(picture.callbacks.warning, {},
       "--field-hits always: fields answer no glossy ray of this picture (docs/command_line.md says which they can)");
}

void warn_of_no_variance(const Picture& picture) {
  if (picture.by_rounds() || picture.spp > 1) return;
  if (std::find(picture.aovs.begin(), picture.aovs.end(), Aov::variance) == picture.aovs.end()) return;
  warn(picture.callbacks.warning, {}, "one sample of a pixel tells nothing of its variance: the layer is 0");
}

// Surveys may take this part of a time limit: 1 / k_survey_part.
constexpr int k_survey_part = 2;
// Seconds: 30 years, which clocks can add.
constexpr float k_most_time_limit = 1e9f;

// Renders the picture with fields of the thesis' chart.
void render_by_thesis(const Picture& picture, const Stage& stage, RenderResult& result) {
  const RenderOptions& options = picture.options;
  const RenderCallbacks& callbacks = picture.callbacks;
  const int m = thesis_directions(options.directions, options.plane);
  ThesisFieldSet fields(picture.scene, stage.traits, m, picture.field_memory);
  const std::unique_ptr<FieldCache> cache = fields.empty() ? nullptr : open_cache(picture);
  ThesisBakeCallbacks bake;
  bake.stop = callbacks.stop;
  if (callbacks.progress) bake.progress = [&](float share) { callbacks.progress(share, "bake"); };
  const bool complete = fields.make(stage.accel, cache.get(), bake, callbacks.warning, result.stats);
  AnswererSettings settings{picture.settings.isa, options.base_tolerance(), options.check};
  const ShadowAnswerer answerer(picture.scene, stage.accel, stage.traits, {}, settings, fields.pointers());
  const TransportContext context(picture.scene, stage.accel, stage.camera, answerer, picture.settings, stage.lights);
  const FieldBudget no_limit;
  result.image = make_image(picture.window, picture.aovs);
  Job job{picture, context, no_limit};
  job.interrupted = !complete;
  render_tiles(job, result.image, result.stats);
  result.interrupted = job.interrupted;
  result.has_samples = job.has_samples;
  fields.count(result.stats);
  warn_of_not_finite(job);
}

// Where a picture that was begun at `begin` must end, and where it goes on: from a checkpoint, or with what a pilot
// expects of it.
void begin_stage(Picture& picture, Clock::time_point begin, Stage& stage, RenderResult& result) {
  const RenderOptions& options = picture.options;
  if (options.time_limit > 0.0f) {
    const auto seconds = std::chrono::duration<float>(std::min(options.time_limit, k_most_time_limit));
    const auto limit = std::chrono::duration_cast<Clock::duration>(seconds);
    stage.deadline = begin + limit;
    // What a resumed picture decided, holds: its surveys may take all of the time.
    stage.survey_end = begin + (options.resume.empty() ? limit / k_survey_part : limit);
  }
  if (options.keeps_sums()) stage.identity = picture_identity(picture);
  if (options.slice) result.part = part_of(picture);
  if (!options.resume.empty()) {
    stage.resumed = read_checkpoint(options.resume, stage.identity);
    const int goal = picture.by_rounds() ? 0 : samples_begun(*stage.resumed);
    if (picture.spp < goal) {
      throw Error({options.resume}, "was begun for " + std::to_string(goal) + " samples a pixel; give --spp " +
                                        std::to_string(goal) + " or more");
    }
    stage.accuracy = stage.resumed->accuracy;
    picture.plan(stage.resumed->planned_samples);
    result.stats.resumed = true;
  } else if (picture.by_rounds()) {
    expect_samples(picture, stage, result.stats);
  }
}

// What a picture's statistics say of its options, its scene and its threads.
void fill_stats(const Picture& picture, int threads, Stats& stats) {
  const RenderOptions& options = picture.options;
  stats.method = options.method == Method::hybrid ? "hybrid" : "montecarlo";
  stats.field_bytes_budget = picture.wants_fields ? picture.field_memory : 0;
  stats.time_primary /= threads;
  stats.time_secondary /= threads;
  stats.time_bake /= threads;
  if (options.slice) stats.slice = slice_text(*options.slice);
  if (picture.by_rounds())
    stats.spp = int(std::lround(stats.samples_mean));
  else if (stats.spp == 0)
    stats.spp = picture.spp;
  stats.target_error = options.target_error;
  stats.time_limit = options.time_limit;
  if (stats.light_samples == 0) stats.light_samples = options.light_samples;
  stats.open_light_samples = std::max(stats.open_light_samples, stats.light_samples);
  stats.width = picture.window.width;
  stats.height = picture.window.height;
  stats.threads = threads;
  stats.isa = isa_name(picture.settings.isa);
  stats.seed = picture.settings.seed;
  stats.triangles = picture.scene.triangle_count();
  stats.instances = picture.scene.instances.size();
  stats.lights = picture.scene.emitters.size();
}

void count_device(const VisibilityDevice& device, Stats& stats) {
  const DeviceCounts counts = device.counts();
  stats.device_blocks = counts.blocks;
  stats.device_blocks_cpu = counts.blocks_cpu;
  stats.device_waves = counts.waves;
  stats.device_waves_full = counts.waves_full;
  stats.device_samples = counts.samples;
  stats.device_bytes = counts.bytes_peak;
}

}  // namespace

RenderResult render(const Scene& scene, const RenderOptions& options, const RenderCallbacks& callbacks) {
  const Clock::time_point begin = Clock::now();
  // Each attempt would repeat its warnings.
  RenderCallbacks told_once = callbacks;
  told_once.warning = without_repeats(callbacks.warning);
  Picture picture(scene, options, told_once);
  warn_of_no_variance(picture);
  const int threads = threads_or_all(options.threads);

  std::optional<OpeningDevice> opening;
  if (picture.wants_fields && options.chart == Chart::orthographic) {
    opening.emplace(options.device, DeviceOptions{options.device_memory, told_once.warning});
  }
  RenderResult result;
  result.stats.tolerance = options.base_tolerance();
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
    begin_stage(picture, begin, stage, result);
    if (options.chart == Chart::thesis && picture.wants_fields) {
      warn_of_no_hits(picture);
      render_by_thesis(picture, stage, result);
      return;
    }
    if (opening) stage.device = &*opening;
    if (stage.uses_fields()) make_maps(picture, stage, result.stats);
    FieldPlan plan = first_plan(picture, stage);
    if (plan.hit_instances.empty()) warn_of_no_hits(picture);
    for (bool is_done = false; !is_done;) {
      is_done = attempt(picture, stage, plan, result);
      const bool wants_finer = stage.uses_fields() && stage.accuracy != FieldAccuracy::coarse_maps;
      if (!is_done && wants_finer && stage.sky.can_be_finer) make_maps(picture, stage, result.stats);
      if (!is_done && !stage.uses_fields()) drop_maps(stage, result.stats);
      if (opening && opening->in_use()) opening->in_use()->forget_fields();
    }
  });

  Stats& stats = result.stats;
  const VisibilityDevice* const device = opening ? opening->in_use() : nullptr;
  if (opening && !device) opening->get();  // says what is missing also where nothing was to be asked
  stats.device = device ? options.device : "cpu";
  if (device) count_device(*device, stats);
  fill_stats(picture, threads, stats);
  stats.time_total = seconds_since(begin);
  return result;
}

}  // namespace fieldtrace
