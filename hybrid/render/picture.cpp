#include "hybrid/render/picture.h"

#include <algorithm>

#include "hybrid/fields/field_set.h"
#include "hybrid/fields/thesis_fields.h"
#include "hybrid/survey/open_light_samples.h"
#include "hybrid/transport/trace_pixels.h"

namespace fieldtrace {
namespace {

void check_range(const char* option, long long value, long long low, long long high) {
  if (value < low || value > high) {
    throw UsageError(std::string(option) + " is " + std::to_string(value) + "; it must lie between " +
                     std::to_string(low) + " and " + std::to_string(high));
  }
}

// Indices into sample sequences have 32 bits: camera samples x lobe samples must stay below this.
constexpr long long k_most_samples = 1ll << 31, k_most_camera_samples = 1ll << 24;
static_assert(k_most_camera_samples * k_most_open_samples <= k_most_samples);

void check_options(const RenderOptions& o, int spp) {
  check_range("the number of camera samples", spp, 1, k_most_camera_samples);
  check_range("the number of light samples", o.light_samples, 1, k_most_light_samples);
  check_range("the number of lobe samples", o.lobe_samples, 1, k_most_lobe_samples);
  check_range("camera samples x light samples", int64_t(spp) * o.light_samples, 1, k_most_samples);
  check_range("camera samples x lobe samples", int64_t(spp) * o.lobe_samples, 1, k_most_samples);
  check_range("the number of threads", o.threads, 0, 4096);
  if (o.tolerance && !(*o.tolerance >= 0.0f && *o.tolerance <= 1.0f))
    throw UsageError("the tolerance is " + std::to_string(*o.tolerance) + "; it must lie between 0 and 1");
  if (!(o.ao_distance > 0.0f))
    throw UsageError("the distance of ambient occlusion is " + std::to_string(o.ao_distance) +
                     "; it must be greater than 0");
  if (o.chart == Chart::thesis) thesis_directions(o.directions, o.plane);
  if (!(o.target_error >= 0.0f && o.target_error < k_infinity))
    throw UsageError("the target error is " + std::to_string(o.target_error) + "; it must be 0 or more");
  if (!(o.time_limit >= 0.0f && o.time_limit < k_infinity))
    throw UsageError("the time limit is " + std::to_string(o.time_limit) + " s; it must be 0 or more");
  if (o.by_rounds() && spp < 2 && o.spp != 0)
    throw UsageError("a picture to an error or a time needs 2 samples a pixel at least, but --spp allows 1");
  if (!o.checkpoint.empty() && !(o.checkpoint_seconds >= 0.0))
    throw UsageError("a checkpoint every " + std::to_string(o.checkpoint_seconds) + " s; it must be 0 or more");
  if (o.keeps_sums() && o.chart == Chart::thesis)
    throw UsageError("pictures by the thesis' chart are made of --spp samples at once: no target, limit, checkpoint");
  if (o.slice && o.keeps_sums())
    throw UsageError("slices are of pictures of --spp samples at once: no target error, time limit, checkpoint");
  if (o.max_depth) check_range("the maximum depth", *o.max_depth, -1, 1 << 30);
}

// All but what depends on the number of samples.
TransportSettings make_settings(const Scene& scene, const RenderOptions& options, const std::vector<Aov>& aovs) {
  TransportSettings s;
  s.light_samples = options.light_samples;
  s.max_depth = options.max_depth.value_or(scene.integrator.max_depth);
  s.rr_depth = scene.integrator.rr_depth;
  s.hide_emitters = scene.integrator.hide_emitters;
  s.seed = options.seed.value_or(scene.seed);
  s.isa = resolve_isa(options.isa);
  s.first_hits = std::any_of(aovs.begin(), aovs.end(), is_of_first_hits);
  s.count_first_hits =
      std::any_of(aovs.begin(), aovs.end(), [](Aov aov) { return aov == Aov::visibility || aov == Aov::exact; });
  s.count_reflections = std::any_of(aovs.begin(), aovs.end(), [](Aov aov) {
    return aov == Aov::reflected_depth || aov == Aov::reflected_object || aov == Aov::glossy_exact;
  });
  s.pass_smooth = std::any_of(aovs.begin(), aovs.end(),
                              [](Aov aov) { return aov == Aov::denoise_albedo || aov == Aov::denoise_normal; });
  s.occlusion = std::find(aovs.begin(), aovs.end(), Aov::ao) != aovs.end();
  s.occlusion_distance = options.ao_distance;
  return s;
}

}  // namespace

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

std::unique_ptr<FieldCache> open_cache(const Picture& picture) {
  const RenderOptions& o = picture.options;
  if (o.field_cache.empty()) return nullptr;
  return std::make_unique<FieldCache>(o.field_cache, o.field_cache_limit, picture.callbacks.warning,
                                      picture.callbacks.stop);
}

Picture::Picture(const Scene& s, const RenderOptions& o, const RenderCallbacks& c)
    : scene(s), options(o), callbacks(c), spp(o.spp == 0 ? s.sample_count : o.spp) {
  check_options(options, spp);
  if (by_rounds() && options.spp == 0)
    most_samples = int(std::min(k_most_camera_samples, k_most_samples / std::max(o.light_samples, o.lobe_samples)));
  else
    most_samples = spp;
  aovs = parse_aovs(options.aovs);
  window = crop_window(scene.film, options.crop);
  wants_fields = options.method == Method::hybrid && (options.base_tolerance() > 0.0f || options.force_undecided);
  settings = make_settings(scene, options, aovs);
  split_lobes(settings, options.lobe_samples);
  field_memory = options.field_memory ? options.field_memory : default_field_memory();
}

void Picture::expect(double samples) { plan(int(std::clamp(samples, 1.0, double(most_samples)))); }

void Picture::plan(int samples) {
  spp = samples;
  split_lobes(settings, options.lobe_samples);
}

void Picture::split_lobes(TransportSettings& s, int lobe_samples) const {
  s.lobe_samples = lobe_samples;
  // However few samples are expected, rounds may take more.
  s.pixel_samples = std::min(by_rounds() ? std::max(spp, k_fewest_cone_samples) : spp, batch_samples(lobe_samples));
}

bool Picture::is_adaptive() const {
  if (options.light_estimator != LightEstimator::automatic) return options.light_estimator == LightEstimator::adaptive;
  return by_rounds() || (wants_fields && !options.force_undecided);
}

bool Picture::adapts_light_samples() const {
  const std::vector<Emitter>& e = scene.emitters;
  return is_adaptive() &&
         std::any_of(e.begin(), e.end(), [](const Emitter& emitter) { return emitter.kind == EmitterKind::area; });
}

int Picture::most_open_samples() const {
  return adapts_light_samples() ? std::max(options.light_samples, k_most_open_samples) : options.light_samples;
}

bool Picture::has_few_light_samples(int open_samples) const {
  return int64_t(spp) * open_samples < k_fewest_field_samples;
}

int Picture::open_sun_samples() const {
  return is_adaptive() ? std::max(options.light_samples, k_open_sun_samples) : 1;
}

float Picture::light_tolerance(int open_samples) const {
  if (options.tolerance) return *options.tolerance;
  if (options.target_error > 0.0f) return k_default_tolerance;  // a survey tells whether it will do
  const double of_pixel = double(spp) * double(std::max(options.light_samples, open_samples));
  return float(k_default_tolerance * std::min(1.0, k_tolerated_light_samples / of_pixel));
}

Rect Picture::sampled_window() const { return by_rounds() ? window : crop_window(scene.film, {}); }

uint64_t Picture::film_samples() const {
  const Rect film = sampled_window();
  return uint64_t(film.width) * uint64_t(film.height) * uint64_t(spp);
}

uint32_t Picture::survey_samples(double part) const {
  const Rect film = sampled_window();
  return few_samples_of(double(film.width) * double(film.height), std::max(int(part * spp), 1));
}

PictureSurvey picture_survey(const Picture& picture, const Stage& stage, uint32_t samples) {
  return {picture.scene,
          stage.accel,
          stage.traits,
          stage.lights,
          picture.settings,
          picture.sampled_window(),
          samples,
          picture.options.error_measure,
          while_surveys_may(picture, stage)};
}

}  // namespace fieldtrace
