#include "hybrid/render/attempt.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <limits>

#include "core/platform/stopwatch.h"
#include "hybrid/render/field_choice.h"
#include "hybrid/render/glossy_stage.h"
#include "hybrid/render/render_pilot.h"
#include "hybrid/render/render_rounds.h"
#include "hybrid/render/render_tiles.h"
#include "hybrid/visibility/shadow_answerer.h"

namespace fieldtrace {
namespace {

// Where maps answer for all lights, fields do only for glossy rays.
bool wants_fields(const Picture& picture, const Stage& stage, const FieldPlan& plan) {
  const std::vector<Emitter>& emitters = picture.scene.emitters;
  const bool maps_answer =
      stage.sky.light && std::all_of(emitters.begin(), emitters.end(), [](const Emitter& e) { return is_sky(e.kind); });
  return picture.wants_fields && stage.uses_fields() && !(maps_answer && plan.hit_instances.empty());
}

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

// What answers the rays of an attempt. Refers to its arguments.
struct Answers {
  AnswererSettings settings;
  ShadowAnswerer answerer;
  TransportContext context;
  std::optional<ShadowAnswerer> occlusion_answerer;
  std::optional<GlossyStage> glossy;

  Answers(const Picture& picture, const Stage& stage, const FieldPlan& plan, const FieldSet& fields, int open_samples,
          float tolerance);

  // Whether anything but exact rays answers.
  bool estimates(const FieldSet& fields) const {
    return context.sky || context.lobes || context.hits || !fields.empty();
  }
  size_t maps_left_out() const { return glossy ? glossy->maps_left_out() : 0; }
  uint64_t map_bytes(const Stage& stage) const;
};

AnswererSettings answerer_settings(const Picture& picture, const FieldSet& fields, float tolerance) {
  const RenderOptions& o = picture.options;
  AnswererSettings settings{picture.settings.isa, tolerance, o.check, o.force_undecided, o.whole_lights};
  settings.self_to_rays = fields.self_to_rays();
  return settings;
}

TransportSettings transport_settings(const Picture& picture, const FieldSet& fields, int open_samples,
                                     float tolerance) {
  TransportSettings settings = settings_for(picture, fields, tolerance);
  settings.open_light_samples = open_samples;
  settings.open_sun_samples = picture.open_sun_samples();
  return settings;
}

Answers::Answers(const Picture& picture, const Stage& stage, const FieldPlan& plan, const FieldSet& fields,
                 int open_samples, float tolerance)
    : settings(answerer_settings(picture, fields, tolerance)),
      answerer(picture.scene, stage.accel, stage.traits, fields.pointers(), settings),
      context(picture.scene, stage.accel, stage.camera, answerer,
              transport_settings(picture, fields, open_samples, tolerance), stage.lights) {
  if (stage.uses_fields()) {
    context.sky = stage.sky.light.get();
    context.indirect = context.sky ? context.sky->indirect() : nullptr;
    context.occlusion_sky = stage.sky.occlusion.get();
  }
  // Single rays of the layer `ao` gain nothing from fields.
  if (picture.settings.occlusion && !context.occlusion_sky && !fields.empty()) {
    occlusion_answerer.emplace(picture.scene, stage.accel, stage.traits, std::vector<Field*>(), settings);
    context.occlusion_answerer = &*occlusion_answerer;
  }
  if (picture.wants_fields && stage.uses_fields()) {
    glossy.emplace(GlossyInput{picture.scene, stage.accel, stage.camera, stage.traits, stage.lights, picture.settings,
                               picture.options, fields.all_pointers(), plan.hit_instances, picture.film_samples(),
                               std::min(picture.field_memory, stage.address_space) / FieldBudget::k_map_share});
    context.lobes = glossy->lobes();
    context.hits = glossy->hits();
    warn_of_no_maps(picture, stage, glossy->maps_left_out());
  }
  if (stage.device && (context.sky || context.occlusion_sky || context.lobes || fields.answers_shadows()))
    answerer.use(stage.device->get());
}

uint64_t Answers::map_bytes(const Stage& stage) const {
  uint64_t bytes = context.lobes ? context.lobes->bytes() : 0;
  if (stage.sky.maps) bytes += stage.sky.maps->bytes();
  if (context.indirect) bytes += context.indirect->bytes();
  return bytes;
}

// The sums that a picture by rounds, or with checkpoints, begins with: what surveys decide of its samples. None if they
// found that fields of another accuracy are to be tried.
std::optional<Checkpoint> decide_samples(const Picture& picture, Stage& stage, const FieldPlan& plan,
                                         const FieldSet& fields, bool surveyed, const Job& job, Answers& answers,
                                         Stats& stats) {
  TransportContext& context = answers.context;
  Checkpoint state;
  if (stage.resumed) {
    state = decisions_alone(*stage.resumed);
    set_samples(picture, state, context);
  } else {
    state.identity = stage.identity;
    state.expected_samples = picture.spp;
    if (!stage.ray_noise.empty()) state.decay = stage.ray_noise.front().noise.decay;
  }
  state.reductions = plan.reductions;
  if (picture.by_rounds() && surveyed && !stage.resumed) {
    const bool estimates = answers.estimates(fields);
    choose_samples(picture, stage, !estimates, context, state, stats);
    const FieldAccuracy accuracy = stage.accuracy;
    const bool is_decided = !estimates || !job.goes_on() || trusts_fields(picture, stage, context, state, stats);
    // What fields that outgrew their memory show depends on the threads.
    if (fields.budget().exceeded())
      stage.accuracy = accuracy;
    else if (!is_decided)
      return std::nullopt;
  }
  state.planned_samples = picture.spp;
  state.accuracy = stage.accuracy;
  state.light_samples = context.settings.light_samples;
  state.open_light_samples = context.settings.open_light_samples;
  state.lobe_samples = context.settings.lobe_samples;
  state.tolerance = stats.tolerance;
  if (surveyed) state.decided = decided_by_memory(context, stage, answers.maps_left_out());
  return state;
}

// The same where a checkpoint goes on that was made with as much memory.
Checkpoint resume(const Picture& picture, const Stage& stage, bool surveyed, Answers& answers) {
  set_samples(picture, *stage.resumed, answers.context);
  if (surveyed) {
    require_same_decisions(picture, stage, decided_by_memory(answers.context, stage, answers.maps_left_out()));
  }
  return *stage.resumed;
}

// Traces the picture from `state` on. Before surveys are done there is none to trace, but however early a resumed
// picture ends, what was there is written.
void trace(const Picture& picture, const Stage& stage, Checkpoint state, bool surveyed, bool resumes, Job& job,
           Image& image, Stats& stats) {
  const bool begins = surveyed && !picture.stopped();
  if (!begins) {
    job.interrupted = true;  // perhaps amid decisions, which no checkpoint may keep
  } else if (picture.options.keeps_sums()) {
    render_rounds(job, std::move(state), image, stats);
  } else {
    render_tiles(job, image, stats);
  }
  const bool ends = picture.stopped() || (!begins && stage.surveys_are_over());
  if (ends && stage.resumed && !(begins && resumes)) {
    job.interrupted = picture.stopped();
    render_rounds(job, *stage.resumed, image, stats);
  }
}

// A checkpoint that was made with more memory keeps nothing but its decisions.
void begin_anew(const Picture& picture, Job& job) {
  const RenderOptions& options = picture.options;
  std::error_code failed;
  job.keeps_at_end = std::filesystem::equivalent(options.resume, options.checkpoint, failed);
  warn(picture.callbacks.warning, {options.resume},
       std::string("was made with more of the fields' memory, so the picture begins anew") +
           (job.keeps_at_end ? "; the file stays as it is until the picture is done" : ""));
}

// Whether the picture stands, though its fields outgrew their memory: late in one with a time limit, which depends on
// the threads anyway, what there is is more than what a new beginning makes. Otherwise it does not even if all tiles
// were finished before the budget ran out, since whether they are depends on the threads: sets the next plan.
bool stands_outgrown(const Picture& picture, const Stage& stage, const FieldSet& fields, FieldPlan& plan, Job& job,
                     Stats& stats) {
  const bool out_of_addresses = fields.budget().out_of_addresses();
  if (stage.surveys_are_over() && job.has_samples) {
    job.interrupted = false;
    warn(picture.callbacks.warning, {},
         outgrown(picture, out_of_addresses, "ends early with the samples that it has, which no checkpoint keeps"));
    return true;
  }
  stats.field_restarts += 1;
  std::string change;
  plan = fields.next_plan(change);
  // Without what the cache held the picture is the same.
  if (picture.options.slice && plan.read_cache) fail_outgrown(picture, out_of_addresses);
  warn(picture.callbacks.warning, {}, outgrown(picture, out_of_addresses, change));
  return false;
}

}  // namespace

bool attempt(const Picture& picture, Stage& stage, FieldPlan& plan, RenderResult& result) {
  const RenderOptions& options = picture.options;
  Stats& stats = result.stats;
  FieldSet fields(picture.scene, stage.traits, plan, picture.field_memory, wants_fields(picture, stage, plan),
                  stage.address_space);
  if (stage.resumed && plan.reductions < stage.resumed->reductions) {
    std::string known;
    plan = fields.next_plan(known);
    return false;
  }
  const bool resumes = stage.resumed && stage.resumed->reductions == plan.reductions;

  int open_samples = options.light_samples;
  bool surveyed = choose_light_samples(picture, stage, open_samples, stats) &&
                  leave_unpaid(picture, stage, fields, open_samples, stats);
  const float tolerance = picture.light_tolerance(open_samples);
  FieldCache* const cache = fields.empty() ? stage.cache.get() : cache_of(picture, stage);
  if (cache && !fields.empty()) {
    const ScopedTimer timer(stats.time_cache);
    fields.load(*cache);
  }
  surveyed = surveyed && leave_undecided(picture, stage, fields, tolerance, stats);
  stats.tolerance = resumes ? stage.resumed->tolerance : tolerance;
  if (!surveyed && is_late(picture, stage) && !picture.stopped()) {
    stage.accuracy = FieldAccuracy::rays;
    return false;
  }

  Answers answers(picture, stage, plan, fields, open_samples, stats.tolerance);
  Job job{picture, answers.context, fields.budget(), stage.deadline};
  if (stage.resumed && !resumes) begin_anew(picture, job);
  std::optional<Checkpoint> state = Checkpoint();
  if (resumes)
    state = resume(picture, stage, surveyed, answers);
  else if (options.keeps_sums())
    state = decide_samples(picture, stage, plan, fields, surveyed, job, answers, stats);
  if (!state) return false;
  stats.light_samples = answers.context.settings.light_samples;
  stats.open_light_samples = answers.context.settings.open_light_samples;

  result.image = make_image(picture.window, picture.aovs);
  Stats traced;
  trace(picture, stage, *std::move(state), surveyed, resumes, job, result.image, traced);
  stats.field_bytes_peak = std::max(stats.field_bytes_peak, fields.budget().used());
  if (fields.budget().exceeded() && !picture.stopped() && !stands_outgrown(picture, stage, fields, plan, job, stats)) {
    stats.add_bake(traced);
    return false;
  }

  result.interrupted = job.interrupted;
  result.has_samples = job.has_samples;
  stats.merge_counters(traced);
  fields.count(stats);
  if (result.part) {
    result.part->decided = decisions_of(fields, plan, answers.context, stage, answers.maps_left_out(), stats.tolerance);
  }
  stats.field_bytes_maps = answers.map_bytes(stage);
  if (cache) {
    const ScopedTimer timer(stats.time_cache);
    cache->finish();
    for (const FieldIdentity& maps : stage.sky.identities) stats.field_bytes_disk += cache->bytes_on_disk(maps);
    fields.store(*cache, options.if_unkept, picture.callbacks.warning, stats);
    cache->trim();
  }
  warn_of_not_finite(job);
  return true;
}

}  // namespace fieldtrace
