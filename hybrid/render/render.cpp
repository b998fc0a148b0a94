#include "hybrid/render/render.h"

#include <fmt/format.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <future>
#include <limits>
#include <memory>
#include <thread>

#include "core/platform/stop_at.h"
#include "core/platform/stopwatch.h"
#include "core/platform/threads.h"
#include "field/file/vdb_grid.h"
#include "hybrid/fields/field_resolution.h"
#include "hybrid/fields/field_set.h"
#include "hybrid/fields/thesis_fields.h"
#include "hybrid/glossy/lobe_answerer.h"
#include "hybrid/light/direct_light.h"
#include "hybrid/render/field_choice.h"
#include "hybrid/render/glossy_stage.h"
#include "hybrid/render/indirect_stage.h"
#include "hybrid/render/open_light_samples.h"
#include "hybrid/render/picture.h"
#include "hybrid/render/picture_identity.h"
#include "hybrid/render/render_pilot.h"
#include "hybrid/render/render_rounds.h"
#include "hybrid/render/render_tiles.h"
#include "hybrid/render/sky_stage.h"
#include "hybrid/render/sky_survey.h"
#include "hybrid/visibility/shadow_answerer.h"

namespace fieldtrace {
namespace {

// The cache of `options`; null if there is none, or no fields to keep in it.
std::unique_ptr<FieldCache> open_cache(const RenderOptions& options, bool no_fields, const RenderCallbacks& callbacks) {
  if (options.field_cache.empty() || no_fields) return nullptr;
  return std::make_unique<FieldCache>(options.field_cache, options.field_cache_limit, callbacks.warning,
                                      callbacks.stop);
}

SkyRequest sky_request(const Picture& picture, const Stage& stage) {
  SkyRequest request;
  const int depth = picture.settings.max_depth;
  const bool is_lit = has_sky(picture.scene) && depth != 0 && depth != 1;
  // A light sample sends one ray to the sky and one from the material.
  const uint64_t light_rays = 2 * picture.rays_per_light();
  request.bounces = plans_indirect(picture.scene, *stage.lights, stage.traits, depth, light_rays);
  if (is_lit || request.bounces) {
    const SkySurvey survey = survey_sky(picture.scene, stage.accel, stage.traits, stage.camera);
    request.light_rays = uint64_t(survey.diffuse * double(light_rays));
    if (is_lit && !picture.options.at_any_cost()) {
      request.bounces = request.bounces && !survey.is_dim() && !survey.is_enclosed();
      if (survey.is_enclosed()) request.light_rays = 0;
    }
  }
  if (picture.settings.occlusion) request.occlusion_rays = picture.rays_per_light();
  request.occlusion_distance = picture.settings.occlusion_distance;
  // Light from surface to surface is smooth: errors of its maps show beside the noise of any number of samples.
  const bool any_number = picture.by_rounds() || request.bounces;
  request.samples = any_number ? std::numeric_limits<uint64_t>::max()
                               : uint64_t(picture.spp) * uint64_t(picture.options.light_samples);
  request.coarse = stage.accuracy == FieldAccuracy::coarse_maps;
  request.most_bytes = std::min(picture.field_memory, stage.address_space) / FieldBudget::k_map_share;
  request.bounces_alone = !is_lit;
  return request;
}

void drop_maps(Stage& stage, Stats& stats) {
  stage.sky = {};
  stats.sky_objects = 0;
  stats.sky_directions = stats.sky_texels = 0;
}

// Makes the direction maps of the stage's accuracy, where the picture wants any. Where they are not whole once surveys
// have had their share of a time limit, rays answer.
void make_maps(const Picture& picture, Stage& stage, Stats& stats) {
  if (!picture.wants_fields) return;
  drop_maps(stage, stats);
  const auto cache = [&] {
    if (!stage.cache) stage.cache = open_cache(picture.options, /*no_fields=*/false, picture.callbacks);
    return stage.cache.get();
  };
  const StopAt stop(picture.callbacks.stop, stage.survey_end);
  RenderCallbacks callbacks = picture.callbacks;
  callbacks.stop = stop.flag();
  const SkyRequest request = sky_request(picture, stage);
  stage.sky = make_sky(picture.scene, stage.accel, stage.traits, picture.options, request, cache, callbacks, stats);
  const bool is_late_for_maps = stop.is_set() && !stage.sky.maps;
  const bool has_all = make_indirect({picture.scene, stage.accel, stage.camera, stage.traits, stage.lights,
                                      picture.settings, callbacks, request, picture.options.check},
                                     stage.sky, stats);
  if ((is_late_for_maps || !has_all) && !picture.stopped()) {
    drop_maps(stage, stats);
    if (!stage.resumed) stage.accuracy = FieldAccuracy::rays;
    return;
  }
  if (stage.sky.light && !has_sky(picture.scene) && !stage.sky.light->indirect()) {
    stage.sky.light.reset();
    stage.sky.can_be_finer = false;
    if (!stage.sky.occlusion) drop_maps(stage, stats);
  }
}

// Clusters of so few light samples send rays; what single rays gain from cells does not pay for surveys
// (docs/decisions/012-left-to-rays.md).
bool has_few_light_samples(int spp, const RenderOptions& options) {
  return int64_t(spp) * options.light_samples < k_fewest_cone_samples;
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

FieldPlan first_plan(const Picture& picture, const Stage& stage) {
  const Scene& scene = picture.scene;
  const RenderOptions& options = picture.options;
  FieldPlan plan;
  plan.parameters = choose_resolution(scene, stage.traits, picture.rays_per_light());
  if (options.directions) plan.parameters.directions = options.directions;
  if (options.plane) plan.parameters.plane = options.plane;
  // No shape is left out for its cost where every cell answers, or undecided cells are requested.
  if (!options.at_any_cost() && !options.force_undecided && options.base_tolerance() < 1.0f) {
    plan.light_samples = has_few_light_samples(picture.spp, options)
                             ? 0.0
                             : double(picture.rays_per_light()) * double(scene.emitters.size());
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
  return picture.wants_fields && stage.uses_fields() && !(maps_answer && plan.hit_instances.empty());
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

void warn_of_no_maps(const Picture& picture, const Stage& stage, size_t objects) {
  if (objects == 0) return;
  const bool by_addresses = stage.address_space < picture.field_memory;
  warn(picture.callbacks.warning, {},
       "radiance maps of " + std::to_string(objects) + (objects == 1 ? " object" : " objects") +
           " do not fit into their memory, and rays answer for them; raise " +
           (by_addresses ? "the limit of address space (ulimit -v)" : "--field-memory") + " to have them");
}

std::string outgrown(const Picture& picture, bool out_of_addresses, const std::string& change) {
  if (out_of_addresses) {
    return "the fields outgrew the address space that they may reserve; the render " + change +
           " (raise the limit, ulimit -v, to avoid it)";
  }
  return "the fields outgrew their " + std::to_string(picture.field_memory / 1000000) + " MB; the render " + change +
         " (raise --field-memory to avoid it)";
}

[[noreturn]] void fail_outgrown(const Picture& picture, bool out_of_addresses) {
  const std::string memory = std::to_string(picture.field_memory / 1000000) + " MB; ";
  throw Error("the fields of slice " + slice_text(*picture.options.slice) + " outgrew " +
              (out_of_addresses ? "the address space that they may reserve; raise the limit (ulimit -v)"
                                : "their " + memory + "raise --field-memory") +
              ", or give coarser fields to all slices by --directions and --plane: what the whole picture would do "
              "without memory, no slice can tell");
}

// What depends on the memory of a machine.
PictureIdentity decided_by_memory(const TransportContext& context, const Stage& stage, size_t maps_left_out) {
  const bool has_maps = stage.uses_fields() && stage.sky.maps;
  return {{"direction maps", has_maps ? std::to_string(stage.sky.maps->bytes()) + " bytes" : "none"},
          {"light from surface to surface by maps", context.indirect ? "yes" : "no"},
          {"radiance maps left out for memory", std::to_string(maps_left_out)}};
}

// The same, and what surveys decide.
PictureIdentity decisions_of(const FieldSet& fields, const FieldPlan& plan, const TransportContext& context,
                             const Stage& stage, size_t maps_left_out, float tolerance) {
  Stats s;
  fields.count(s);
  const auto number = [](auto n) { return std::to_string(n); };
  PictureIdentity decisions = decided_by_memory(context, stage, maps_left_out);
  const PictureIdentity by_surveys = {
      {"fields", number(s.field_objects)},
      {"objects left to rays", number(s.field_left_to_rays)},
      {"objects left to rays for shadows on themselves", number(s.field_self_to_rays)},
      {"the fields' cells", number(s.field_directions) + " x " + number(s.field_plane)},
      {"objects whose fields answer glossy rays", number(plan.hit_instances.size())},
      {"light samples where a light may be hidden", number(context.settings.open_light_samples)},
      {"the tolerance of lights", number(tolerance)}};
  decisions.insert(decisions.end(), by_surveys.begin(), by_surveys.end());
  return decisions;
}

// What a checkpoint's picture decided, without its samples.
Checkpoint decisions_alone(Checkpoint state) {
  state.film = {};
  state.counts.clear(), state.tiles_done.clear();
  state.round = 0;
  return state;
}

// Takes samples as a checkpoint's picture had decided.
void set_samples(const Picture& picture, const Checkpoint& decided, TransportContext& context) {
  context.settings.light_samples = decided.light_samples;
  context.settings.open_light_samples = decided.open_light_samples;
  picture.split_lobes(context.settings, decided.lobe_samples);
}

// What depends on memory may not change amid a picture. Where the time is up nothing is added.
void require_same_decisions(const Picture& picture, const Stage& stage, const PictureIdentity& decided) {
  if (picture.stopped() || stage.surveys_are_over()) return;
  const std::vector<std::string> differences = differences_of(decided, stage.resumed->decided);
  if (differences.empty()) return;
  throw Error({picture.options.resume},
              fmt::format("the picture was begun with other memory: {}; resume it with as much as it had",
                          fmt::join(differences, "; ")));
}

// One attempt with the fields of `plan`. Returns false if they exceeded their memory, `plan` is then the next
// attempt's, or if a survey changed the stage's accuracy.
bool attempt(const Picture& picture, Stage& stage, FieldPlan& plan, RenderResult& result) {
  const RenderOptions& options = picture.options;
  const WarningSink& warning = picture.callbacks.warning;
  Stats& stats = result.stats;
  FieldSet fields(picture.scene, stage.traits, plan, picture.field_memory, wants_fields(picture, stage, plan),
                  stage.address_space);
  if (stage.resumed && plan.reductions < stage.resumed->reductions) {
    std::string known;
    plan = fields.next_plan(known);
    return false;
  }
  OpenLight open = {options.light_samples};
  bool surveyed = leave_unpaid(picture, stage, fields, open, stats);
  const bool resumes = stage.resumed && stage.resumed->reductions == plan.reductions;
  stats.tolerance = resumes ? stage.resumed->tolerance : picture.light_tolerance(open.samples);
  if (!stage.cache) stage.cache = open_cache(options, fields.empty(), picture.callbacks);
  FieldCache* const cache = stage.cache.get();
  if (cache) {
    const ScopedTimer timer(stats.time_cache);
    fields.load(*cache);
  }
  surveyed = surveyed && leave_to_rays(picture, stage, fields, stats.tolerance, open, stats);
  if (!surveyed && is_late(picture, stage) && !picture.stopped()) {
    stage.accuracy = FieldAccuracy::rays;
    return false;
  }
  AnswererSettings settings{picture.settings.isa, stats.tolerance, options.check, options.force_undecided,
                            options.whole_lights};
  settings.self_to_rays = fields.self_to_rays();
  ShadowAnswerer answerer(picture.scene, stage.accel, stage.traits, fields.pointers(), settings);
  TransportSettings tracing = settings_for(picture, fields, stats.tolerance);
  tracing.open_light_samples = open.samples;
  tracing.open_sun_samples = picture.open_sun_samples();
  TransportContext context(picture.scene, stage.accel, stage.camera, answerer, tracing, stage.lights);
  const bool estimates = stage.uses_fields();
  context.sky = estimates ? stage.sky.light.get() : nullptr;
  context.indirect = context.sky ? context.sky->indirect() : nullptr;
  context.occlusion_sky = estimates ? stage.sky.occlusion.get() : nullptr;
  // Single rays of the layer `ao` gain nothing from fields.
  std::optional<ShadowAnswerer> for_occlusion;
  if (picture.settings.occlusion && !context.occlusion_sky && !fields.empty()) {
    for_occlusion.emplace(picture.scene, stage.accel, stage.traits, std::vector<Field*>(), settings);
    context.occlusion_answerer = &*for_occlusion;
  }
  const std::vector<Field*> all_fields = fields.all_pointers();
  std::optional<GlossyStage> glossy;
  if (picture.wants_fields && estimates) {
    glossy.emplace(GlossyInput{picture.scene, stage.accel, stage.camera, stage.traits, stage.lights, picture.settings,
                               options, all_fields, plan.hit_instances, picture.film_samples(),
                               std::min(picture.field_memory, stage.address_space) / FieldBudget::k_map_share});
    context.lobes = glossy->lobes();
    context.hits = glossy->hits();
    warn_of_no_maps(picture, stage, glossy->maps_left_out());
  }
  if (stage.device && (context.sky || context.occlusion_sky || context.lobes || fields.answers_shadows())) {
    answerer.use(stage.device->get());
  }
  Job job{picture, context, fields.budget(), stage.deadline};
  Checkpoint state;
  if (stage.resumed && !resumes) {
    std::error_code failed;
    job.keeps_at_end = std::filesystem::equivalent(options.resume, options.checkpoint, failed);
    warn(warning, {options.resume},
         std::string("was made with more of the fields' memory, so the picture begins anew") +
             (job.keeps_at_end ? "; the file stays as it is until the picture is done" : ""));
  }
  if (resumes) {
    state = *stage.resumed;
    set_samples(picture, state, context);
  } else if (options.keeps_sums()) {
    if (stage.resumed) {
      state = decisions_alone(*stage.resumed);
      set_samples(picture, state, context);
    } else {
      state.identity = stage.identity;
      state.expected_samples = picture.spp;
      if (!stage.ray_noise.empty()) state.decay = stage.ray_noise.front().noise.decay;
    }
    state.reductions = plan.reductions;
    const bool estimates_anything = context.sky || context.lobes || context.hits || !fields.empty();
    if (picture.by_rounds() && surveyed && !stage.resumed) {
      choose_samples(picture, stage, !estimates_anything, context, state, stats);
      const FieldAccuracy accuracy = stage.accuracy;
      const bool is_decided =
          !estimates_anything || !job.goes_on() || trusts_fields(picture, stage, context, state, stats);
      // What fields that outgrew their memory show depends on the threads.
      if (fields.budget().exceeded())
        stage.accuracy = accuracy;
      else if (!is_decided)
        return false;
    }
    state.planned_samples = picture.spp;
    state.accuracy = stage.accuracy;
    state.light_samples = context.settings.light_samples;
    state.open_light_samples = context.settings.open_light_samples;
    state.lobe_samples = context.settings.lobe_samples;
    state.tolerance = stats.tolerance;
  }
  if (options.keeps_sums() && surveyed) {
    const PictureIdentity decided = decided_by_memory(context, stage, glossy ? glossy->maps_left_out() : 0);
    if (resumes) {
      require_same_decisions(picture, stage, decided);
    } else {
      state.decided = decided;
    }
  }
  stats.light_samples = context.settings.light_samples;
  stats.open_light_samples = context.settings.open_light_samples;
  result.image = make_image(picture.window, picture.aovs);
  Stats done;
  const bool begins = surveyed && !picture.stopped();
  if (!begins) {
    job.interrupted = true;  // perhaps amid decisions, which no checkpoint may keep
  } else if (options.keeps_sums()) {
    render_rounds(job, std::move(state), result.image, done);
  } else {
    render_tiles(job, result.image, done);
  }
  // However early a resumed picture ends, what was there is written.
  const bool ends = picture.stopped() || (!begins && stage.surveys_are_over());
  if (ends && stage.resumed && !(begins && resumes)) {
    job.interrupted = picture.stopped();
    render_rounds(job, *stage.resumed, result.image, done);
  }
  stats.field_bytes_peak = std::max(stats.field_bytes_peak, fields.budget().used());
  // Even if all tiles were finished before the budget ran out: whether they are depends on the threads. Late in a
  // picture with a time limit, which depends on them anyway, what there is is more than what a new beginning makes.
  const bool ends_early = fields.budget().exceeded() && stage.surveys_are_over() && job.has_samples;
  if (ends_early && !picture.stopped()) {
    job.interrupted = false;
    warn(warning, {},
         outgrown(picture, fields.budget().out_of_addresses(),
                  "ends early with the samples that it has, which no checkpoint keeps"));
  } else if (fields.budget().exceeded() && !picture.stopped()) {
    stats.add_bake(done);
    stats.field_restarts += 1;
    std::string change;
    plan = fields.next_plan(change);
    // Without what the cache held the picture is the same.
    if (options.slice && plan.read_cache) fail_outgrown(picture, fields.budget().out_of_addresses());
    warn(warning, {}, outgrown(picture, fields.budget().out_of_addresses(), change));
    return false;
  }
  result.interrupted = job.interrupted;
  result.has_samples = job.has_samples;
  stats.merge_counters(done);
  fields.count(stats);
  if (result.part) {
    result.part->decided =
        decisions_of(fields, plan, context, stage, glossy ? glossy->maps_left_out() : 0, stats.tolerance);
  }
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
  const std::unique_ptr<FieldCache> cache = open_cache(options, fields.empty(), callbacks);
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

}  // namespace

bool is_likely_to_use_cache(const RenderOptions& options, bool has_sky) {
  if (options.method != Method::hybrid || options.field_cache.empty()) return false;
  const std::vector<std::string>& layers = options.aovs;
  if (has_sky) return true;
  // Surveys often leave pictures by rounds to rays then.
  if (options.by_rounds()) return false;
  if (std::find(layers.begin(), layers.end(), "ao") != layers.end()) return true;
  const bool are_few = options.spp != 0 && has_few_light_samples(options.spp, options);
  return !are_few;
}

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
    std::future<void> vdb;
    if (picture.by_rounds() && picture.wants_fields && stage.uses_fields() && !options.field_cache.empty())
      vdb = open_vdb_early();
    if (options.chart == Chart::thesis && picture.wants_fields) {
      warn_of_no_hits(picture);
      render_by_thesis(picture, stage, result);
      return;
    }
    if (opening) stage.device = &*opening;
    FieldPlan plan = first_plan(picture, stage);
    if (plan.hit_instances.empty()) warn_of_no_hits(picture);
    if (stage.uses_fields()) make_maps(picture, stage, result.stats);
    for (bool is_done = false; !is_done;) {
      is_done = attempt(picture, stage, plan, result);
      const bool wants_finer = stage.uses_fields() && stage.accuracy != FieldAccuracy::coarse_maps;
      if (!is_done && wants_finer && stage.sky.can_be_finer) make_maps(picture, stage, result.stats);
      if (!is_done && !stage.uses_fields()) drop_maps(stage, result.stats);
      if (opening && opening->in_use()) opening->in_use()->forget_fields();
    }
  });

  Stats& stats = result.stats;
  stats.field_bytes_budget = picture.wants_fields ? picture.field_memory : 0;
  stats.time_primary /= threads;
  stats.time_secondary /= threads;
  stats.time_bake /= threads;
  stats.method = options.method == Method::hybrid ? "hybrid" : "montecarlo";
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
  const VisibilityDevice* const device = opening ? opening->in_use() : nullptr;
  if (opening && !device) opening->get();  // says what is missing also where nothing was to be asked
  stats.device = device ? options.device : "cpu";
  if (device) {
    const DeviceCounts counts = device->counts();
    stats.device_blocks = counts.blocks;
    stats.device_blocks_cpu = counts.blocks_cpu;
    stats.device_waves = counts.waves;
    stats.device_waves_full = counts.waves_full;
    stats.device_samples = counts.samples;
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
