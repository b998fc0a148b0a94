#include "hybrid/render/render_pilot.h"

#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <utility>

#include "core/platform/stopwatch.h"
#include "hybrid/film/noise_sums.h"
#include "hybrid/path/ray_context.h"
#include "hybrid/survey/noise_survey.h"
#include "hybrid/visibility/shadow_answerer.h"

namespace fieldtrace {
namespace {

// One pixel in this many, but a least number, tells how noisy pictures are, with this many samples of each sequence;
constexpr int k_noise_pixels_each = 128, k_fewest_noise_pixels = 2048;
constexpr uint32_t k_noise_samples = 4;
// and so many times as many pixels whether one sample will do, with one of each sequence;
constexpr int k_one_pixels = 4;
// and how far fields err, with these.
constexpr int k_error_pixels_each = 512, k_fewest_error_pixels = 256;
constexpr double k_least_samples = 64.0, k_most_samples = 512.0;
// Light samples of each camera sample, of which rays take more than of light samples; one where other answers than
// those to light samples count, of objects' light and of lobes.
constexpr int k_error_light_samples = 4;

double pixels_of(const Picture& picture) { return double(picture.window.width) * double(picture.window.height); }

// Single pixels, at least `fewest` and one in `each`, as far as the window has so many.
NoiseSurvey survey_of(const Picture& picture, int each, int fewest) {
  const double wanted = std::max(pixels_of(picture) / each, double(fewest));
  return {survey_pixels(picture.window, picture.settings.seed, wanted)};
}

RayContext make_ray_context(const Picture& picture, const Stage& stage) {
  TransportSettings settings = picture.settings;
  settings.first_hits = false;
  return {picture.scene, stage.accel, stage.traits, stage.camera, settings, stage.lights, false};
}

// What samples in `context` leave, as few of them show it; nothing if goes_on() became false meanwhile.
std::optional<NoiseForecast> forecast_noise(const Picture& picture, const TransportContext& context,
                                            const GoesOn& goes_on, Stats& stats) {
  NoiseSurvey survey = survey_of(picture, k_noise_pixels_each, k_fewest_noise_pixels);
  if (!trace_survey(context, k_noise_samples, k_noise_replicates, goes_on, survey, stats)) return {};
  return noise_of(survey, picture.options.error_measure, most_decay(context.has_fields()));
}

// The same of one sample, by more pixels.
std::optional<NoiseForecast> forecast_noise_of_one(const Picture& picture, const TransportContext& context,
                                                   const GoesOn& goes_on, Stats& stats) {
  constexpr int each = std::max(k_noise_pixels_each / k_one_pixels, 1), fewest = k_fewest_noise_pixels * k_one_pixels;
  NoiseSurvey survey = survey_of(picture, each, fewest);
  if (!trace_survey(context, 1, k_one_replicates, goes_on, survey, stats)) return {};
  return noise_of(survey, picture.options.error_measure, most_decay(context.has_fields()));
}

// How far pictures in a context and by rays differ where noise is averaged away, as a mean square; and what noise and
// what samples these had.
struct FieldError {
  double mean_square = 0.0;
  NoiseForecast fields, rays;
};

// With about Stage::survey_samples light samples of each sequence, as far as few and many go. Rays are traced once for
// all accuracies (Stage::ray_survey). Nothing if the picture was stopped meanwhile or surveys were over.
std::optional<FieldError> survey_field_error(const Picture& picture, Stage& stage, const TransportContext& context,
                                             Stats& stats) {
  NoiseSurvey by_fields = survey_of(picture, k_error_pixels_each, k_fewest_error_pixels);
  NoiseSurvey by_rays = {by_fields.pixels};
  TransportContext fields = context;
  RayContext rays = make_ray_context(picture, stage);
  const int each = context.indirect || context.lobes ? 1 : k_error_light_samples;
  for (TransportSettings* s : {&fields.settings, &rays.context().settings}) {
    if (each == 1) break;
    s->light_samples = s->open_light_samples = each * picture.settings.light_samples;
    s->pixel_samples = std::max(s->pixel_samples / each, 2);  // clusters have as many light samples as the picture's
  }
  const double light_samples = nearest_power(std::clamp(stage.survey_samples, k_least_samples, k_most_samples));
  const uint32_t of_sequence = uint32_t(light_samples) / uint32_t(each);
  const GoesOn goes_on = while_surveys_may(picture, stage);
  const auto trace = [&](const TransportContext& with, NoiseSurvey& survey) {
    return trace_survey(with, of_sequence, k_error_replicates, goes_on, survey, stats);
  };
  if (!trace(fields, by_fields)) return {};
  if (stage.ray_survey_samples == of_sequence) {
    by_rays.sums = stage.ray_survey;
  } else {
    if (!trace(rays.context(), by_rays)) return {};
    stage.ray_survey = by_rays.sums, stage.ray_survey_samples = of_sequence;
  }
  const ErrorMeasure measure = picture.options.error_measure;
  FieldError error = {0.0, noise_of(by_fields, measure, most_decay(true)),
                      noise_of(by_rays, measure, most_decay(false))};
  for (size_t i = 0; i < by_fields.pixels.size(); ++i) {
    const SequencePair &f = by_fields.sums[i], &r = by_rays.sums[i];
    // The sequences' noise is independent: the mean of the product is the square of what both share.
    const DVec3 product = (f[0].mean() - r[0].mean()) * (f[1].mean() - r[1].mean());
    error.mean_square += weighted_square(product, 0.5 * (r[0].mean() + r[1].mean()), measure);
  }
  error.mean_square = std::max(error.mean_square / double(by_fields.pixels.size()), 0.0);
  return error;
}

// The squared error that may be left.
double square_of_target(const RenderOptions& options) {
  return double(options.target_error) * double(options.target_error);
}

// Pictures that need no more work than this many samples of a pixel with the usual light samples are left to rays.
constexpr double k_fewest_samples = 8.0;

// Where fields need this many times less work than rays with the usual samples, those that suit rays best are not
// sought.
constexpr double k_clear_gain = 4.0;

// Where fields make more of the squared target, maps are made finer if they can be.
constexpr double k_field_share = 0.7;

// Light and lobe samples that are tried beside one.
constexpr int k_more_samples = 4;

// Standard errors of a survey by which the noise of one sample must lie below the target where no more are taken.
constexpr double k_sure = 2.0;

double threads() { return double(tbb::this_task_arena::max_concurrency()); }

// Whether light samples may be chosen.
bool chooses_light_samples(const Picture& picture) {
  return picture.options.light_samples == 1 && picture.options.light_estimator == LightEstimator::automatic;
}

void set_light_samples(const RayNoise& r, TransportSettings& settings) {
  settings.light_samples = r.light_samples;
  settings.open_light_samples = r.open_light_samples;
}

// Adds to what is known of rays (Stage::ray_noise) what they leave with these light samples: each is surveyed once,
// while surveys may go on.
void survey_ray_noise(const Picture& picture, Stage& stage, RayContext& rays, int light_samples, int open,
                      Stats& stats) {
  RayNoise r = {light_samples, open, {}};
  for (const RayNoise& known : stage.ray_noise) {
    if (known.light_samples == light_samples && known.open_light_samples == open) return;
  }
  set_light_samples(r, rays.context().settings);
  const auto noise = forecast_noise(picture, rays.context(), while_surveys_may(picture, stage), stats);
  if (!noise) return;
  r.noise = *noise;
  stage.ray_noise.push_back(r);
}

// The light samples of those surveyed that lower the noise of rays alone most for their work.
const RayNoise& best_for_rays(const Stage& stage) {
  return *std::min_element(stage.ray_noise.begin(), stage.ray_noise.end(), [](const RayNoise& a, const RayNoise& b) {
    return a.noise.mean_square * a.noise.work < b.noise.mean_square * b.noise.work;
  });
}

// Not where time ended before a rival of the usual light samples was surveyed.
bool has_choice(const Stage& stage) { return stage.ray_noise.size() > 1 || !stage.surveys_are_over(); }

// Whether one sample of each pixel, as a survey of noise saw it, leaves no more than this mean square.
static_assert(k_noise_samples == 4, "a quarter of a survey's samples is one, and so it is of one sample");
bool one_will_do(const NoiseForecast& noise, double mean_square) {
  return noise.quarter + k_sure * noise.quarter_error <= mean_square;
}

// Sets what `decided` says of samples in `context`, if their noise may have this mean square.
void plan_samples(const Picture& picture, const Stage& stage, const TransportContext& context,
                  const NoiseForecast& noise, double mean_square, Checkpoint& decided, Stats& stats) {
  decided.expected_samples = int(std::clamp(noise.samples_to(mean_square), 1.0, double(picture.most_samples)));
  decided.decay = noise.decay;
  // One sample tells nothing of its variance.
  const std::vector<Aov>& layers = picture.aovs;
  if (stage.deadline || std::find(layers.begin(), layers.end(), Aov::variance) != layers.end()) return;
  if (!one_will_do(noise, mean_square)) return;
  // Where few pixels hold the noise a survey may have missed them, and nothing after it would tell.
  const auto of_one = forecast_noise_of_one(picture, context, while_surveys_may(picture, stage), stats);
  if (of_one && one_will_do(*of_one, mean_square)) decided.first_mean_square = of_one->quarter;
}

}  // namespace

void expect_samples(Picture& picture, Stage& stage, Stats& stats) {
  RayContext rays = make_ray_context(picture, stage);
  const RenderOptions& options = picture.options;
  const TransportSettings& usual = picture.settings;
  survey_ray_noise(picture, stage, rays, usual.light_samples, usual.open_light_samples, stats);
  if (stage.ray_noise.empty()) {
    // There is time for a few samples at most.
    picture.expect(1.0);
    stage.accuracy = FieldAccuracy::rays;
    return;
  }
  const NoiseForecast noise = stage.ray_noise.front().noise;
  double samples = double(k_infinity);
  stage.survey_samples = samples;
  if (options.target_error > 0.0f) {
    const double target = square_of_target(options);
    samples = noise.samples_to(target);
    // Each sequence's noise is the target's then; but no more than the sequences of random samples would have.
    stage.survey_samples = std::min(samples, 0.5 * noise.samples * noise.mean_square / target);
    if (!options.tolerance && !options.directions && !options.plane) stage.accuracy = FieldAccuracy::coarse_maps;
  }
  if (options.time_limit > 0.0f) {
    const double seconds = std::max(noise.seconds * pixels_of(picture) / threads(), 1e-9);
    const double in_time = double(options.time_limit) / seconds;
    samples = std::min(samples, in_time);
    stage.survey_samples = std::min(stage.survey_samples, 0.5 * in_time);
  } else if (samples >= k_fewest_samples && !has_sky(picture.scene) && chooses_light_samples(picture)) {
    // Fewer may do, if they have more light samples where lights may be hidden.
    survey_ray_noise(picture, stage, rays, usual.light_samples, std::min(picture.most_open_samples(), k_more_samples),
                     stats);
    const NoiseForecast& best = best_for_rays(stage).noise;
    const double target = square_of_target(options);
    if (best.work_to(target) < k_fewest_samples * noise.work)
      samples = std::min(best.samples_to(target), k_fewest_samples - 1.0);
  }
  picture.expect(samples);
  // What fields could spare then, surveys take.
  if (samples < k_fewest_samples) stage.accuracy = FieldAccuracy::rays;
}

namespace {

// The lobe samples of each camera sample that lower noise most for their work, and their noise, if there is a choice.
std::optional<NoiseForecast> choose_lobe_samples(const Picture& picture, TransportContext& context,
                                                 const GoesOn& goes_on, Stats& stats) {
  // Radiance maps answer for whole lobes.
  if (picture.options.lobe_samples != 1 || context.lobes) return {};
  const std::vector<Bsdf>& all = picture.scene.bsdfs;
  const auto splits = [](const Bsdf& b) { return b.kind != BsdfKind::diffuse && b.kind != BsdfKind::conductor; };
  if (std::none_of(all.begin(), all.end(), splits)) return {};
  const std::optional<NoiseForecast> one = forecast_noise(picture, context, goes_on, stats);
  if (!one) return {};
  picture.split_lobes(context.settings, k_more_samples);
  const std::optional<NoiseForecast> more = forecast_noise(picture, context, goes_on, stats);
  if (more && more->mean_square * more->work < one->mean_square * one->work) return more;
  picture.split_lobes(context.settings, 1);
  return one;
}

// The samples of each camera sample that suit rays best; returns what these are expected to leave.
NoiseForecast choose_for_rays(const Picture& picture, Stage& stage, RayContext& rays, TransportContext& context,
                              Stats& stats) {
  if (chooses_light_samples(picture)) {
    const int open = context.settings.open_light_samples;
    survey_ray_noise(picture, stage, rays, 1, open, stats);
    survey_ray_noise(picture, stage, rays, k_more_samples, std::max(k_more_samples, open), stats);
    if (has_choice(stage)) set_light_samples(best_for_rays(stage), context.settings);
  }
  const GoesOn goes_on = while_surveys_may(picture, stage);
  return choose_lobe_samples(picture, context, goes_on, stats).value_or(best_for_rays(stage).noise);
}

// The same where few samples do: then the work counts that these take.
NoiseForecast choose_few_for_rays(const Picture& picture, Stage& stage, RayContext& rays, double target,
                                  TransportContext& context, Stats& stats) {
  const TransportSettings& s = context.settings;
  const bool chooses = chooses_light_samples(picture);
  if (!chooses || !one_will_do(stage.ray_noise.front().noise, target))
    survey_ray_noise(picture, stage, rays, s.light_samples, s.open_light_samples, stats);
  if (!chooses) return stage.ray_noise.back().noise;
  const auto best = std::min_element(
      stage.ray_noise.begin(), stage.ray_noise.end(),
      [&](const RayNoise& a, const RayNoise& b) { return a.noise.work_to(target) < b.noise.work_to(target); });
  if (has_choice(stage)) set_light_samples(*best, context.settings);
  return best->noise;
}

// Whether finer maps may take fields' part of the error down, and there is time.
bool can_be_finer(const Picture& picture, const Stage& stage) {
  const bool is_over = stage.deadline && seconds_since(*stage.deadline) > 0.0;
  return stage.accuracy == FieldAccuracy::coarse_maps && stage.sky.can_be_finer && !picture.stopped() && !is_over;
}

}  // namespace

void choose_samples(const Picture& picture, Stage& stage, bool rays_alone, TransportContext& context,
                    Checkpoint& decided, Stats& stats) {
  const bool is_short = picture.spp < k_fewest_samples;
  if (!rays_alone) {
    // A survey has chosen light samples already.
    if (!is_short) choose_lobe_samples(picture, context, while_surveys_may(picture, stage), stats);
    return;
  }
  const double target = square_of_target(picture.options);
  if (stage.ray_noise.empty() || (is_short && !(target > 0.0))) return;
  RayContext rays = make_ray_context(picture, stage);
  NoiseForecast noise;
  if (is_short)
    noise = choose_few_for_rays(picture, stage, rays, target, context, stats);
  else
    noise = choose_for_rays(picture, stage, rays, context, stats);
  if (target > 0.0) plan_samples(picture, stage, context, noise, target, decided, stats);
}

bool trusts_fields(const Picture& picture, Stage& stage, const TransportContext& context, Checkpoint& decided,
                   Stats& stats) {
  const auto leave_to_rays = [&] {
    stage.accuracy = FieldAccuracy::rays;
    return false;
  };
  const std::optional<FieldError> survey = survey_field_error(picture, stage, context, stats);
  if (!survey) return leave_to_rays();
  const double error = survey->mean_square;
  decided.field_mean_square = error;
  bool are_better;
  if (picture.options.target_error > 0.0f) {
    const double target = square_of_target(picture.options);
    if (error > k_field_share * target && can_be_finer(picture, stage)) {
      stage.accuracy = FieldAccuracy::usual;
      return false;
    }
    const std::optional<NoiseForecast> noise =
        forecast_noise(picture, context, while_surveys_may(picture, stage), stats);
    if (!noise) return leave_to_rays();
    const double work = noise->work_to(target - error);
    double ray_work = stage.ray_noise.front().noise.work_to(target);
    RayContext rays = make_ray_context(picture, stage);
    if (ray_work >= work && ray_work < k_clear_gain * work)
      ray_work = choose_for_rays(picture, stage, rays, rays.context(), stats).work_to(target);
    are_better = ray_work >= work;
    plan_samples(picture, stage, context, *noise, target - error, decided, stats);
  } else {
    const double seconds = std::max(-seconds_since(*stage.deadline), 0.0) * threads() / pixels_of(picture);
    const auto noise_in_time = [&](const NoiseForecast& n) { return n.mean_square_of(seconds / n.seconds); };
    are_better = error + noise_in_time(survey->fields) <= noise_in_time(survey->rays);
  }
  if (!are_better) stage.accuracy = FieldAccuracy::rays;
  return are_better;
}

}  // namespace fieldtrace
