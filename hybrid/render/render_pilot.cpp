#include "hybrid/render/render_pilot.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

#include "core/platform/parallel.h"
#include "core/sampling/sobol.hd.h"
#include "hybrid/film/sample_allocation.h"
#include "hybrid/stats/stopwatch.h"
#include "hybrid/transport/trace_pixels.h"
#include "hybrid/visibility/shadow_answerer.h"

namespace fieldtrace {
namespace {

// Numbers of sequences that no round uses.
constexpr uint32_t k_noise_replicates = 0x80000000u, k_error_replicates = 0x80000002u, k_decay_replicates = 0x80000004u;
// Noise is surveyed by one block of 4 x 4 pixels in this many by as many, with 4 samples of each half; how fast it
// falls, with 1 besides.
constexpr int k_block_step = 6;
constexpr uint32_t k_noise_samples = 4;
// Field errors by one pixel in this many, as far as there are,
constexpr int k_pixels_each = 512;
constexpr int k_fewest_pixels = 256;
// with this many samples of each half.
constexpr double k_least_samples = 8.0, k_most_samples = 512.0;
// Pixels of one task.
constexpr size_t k_task_pixels = 16;

// Camera samples of a picture, by its measure of errors.
struct SampleCost {
  double variance = 0.0;  // of one sample, mean over pixels and channels
  double work = 0.0;      // of one sample: itself and its rays
  double seconds = 0.0;   // of one sample, of one thread

  // Work until noise is `mean_square`; infinite where that is not above 0.
  double work_to(double mean_square) const {
    return mean_square > 0.0 ? std::max(variance / mean_square, 1.0) * work : double(k_infinity);
  }
};

// A context in which rays answer everything.
class RayContext {
 public:
  RayContext(const Picture& picture, const Stage& stage);
  TransportContext& context() const { return *context_; }

 private:
  std::unique_ptr<ShadowAnswerer> answerer_;
  std::unique_ptr<TransportContext> context_;
};

// How far pictures in a context and by rays differ where noise is averaged away, as a mean square; and what samples of
// either cost.
struct FieldError {
  double mean_square = 0.0;
  SampleCost fields, rays;
};

struct Survey {
  std::vector<PixelPosition> pixels;
  std::vector<PixelSums> sums;
};

// Traces the survey's pixels with `samples` samples of each half.
void trace_survey(const Picture& picture, const TransportContext& context, uint32_t samples, uint32_t replicate,
                  Survey& survey, Stats& stats) {
  survey.sums.assign(survey.pixels.size(), {});
  tbb::enumerable_thread_specific<TransportWorker> workers([&] { return TransportWorker(context); });
  const size_t tasks = (survey.pixels.size() + k_task_pixels - 1) / k_task_pixels;
  parallel_for(tasks, [&](size_t task) {
    const size_t begin = task * k_task_pixels, end = std::min(begin + k_task_pixels, survey.pixels.size());
    const auto pixels = std::span<const PixelPosition>(survey.pixels).subspan(begin, end - begin);
    const std::vector<uint32_t> counts(pixels.size(), samples);
    TransportWorker& worker = workers.local();
    const auto add = [&](const PixelRun& run, std::span<const Rgb> radiance, std::span<const FirstHit>) {
      const TransportWorker::Cost& cost = worker.sample_cost();
      survey.sums[begin + run.pixel].add(run.half, radiance, cost.work, cost.seconds);
    };
    const auto goes_on = [&] { return !picture.stopped(); };
    // Isolated like the tiles of the picture (render_tiles).
    tbb::this_task_arena::isolate([&] {
      trace_pixels(pixels, counts, Halves{2, replicate}, context.settings.lobe_samples, worker, goes_on, add);
    });
  });
  for (const TransportWorker& worker : workers) {
    stats.survey_rays += worker.stats().rays_exact;
    stats.add_bake(worker.stats());
  }
}

SampleCost cost_of(const Survey& survey, ErrorMeasure measure) {
  SampleCost cost;
  double samples = 0.0;
  for (const PixelSums& p : survey.sums) {
    cost.variance += noise_square(p, measure) * double(p.samples());
    cost.work += p.work;
    cost.seconds += p.seconds;
    samples += double(p.samples());
  }
  if (!(samples > 0.0)) return {0.0, 1.0, 0.0};
  return {cost.variance / double(survey.sums.size()), cost.work / samples, cost.seconds / samples};
}

RayContext::RayContext(const Picture& picture, const Stage& stage) {
  const std::vector<Field*> none(picture.scene.shapes.size(), nullptr);
  answerer_ = std::make_unique<ShadowAnswerer>(picture.scene, stage.accel, stage.traits, none,
                                               AnswererSettings{picture.settings.isa, 0.0f});
  TransportSettings settings = picture.settings;
  settings.first_hits = false;
  context_ =
      std::make_unique<TransportContext>(picture.scene, stage.accel, stage.camera, *answerer_, settings, stage.lights);
}

// Of camera samples in `context`, by blocks of pixels that a grid spreads over the window.
SampleCost survey_noise(const Picture& picture, const TransportContext& context, Stats& stats,
                        uint32_t samples = k_noise_samples, uint32_t replicates = k_noise_replicates) {
  Survey survey;
  const Rect& w = picture.window;
  const int step = 4 * std::clamp(std::min(w.width, w.height) / 32, 1, k_block_step);
  for (int y = 0; y < w.height; y += step) {
    for (int x = 0; x < w.width; x += step) {
      const Rect block{w.x + x, w.y + y, std::min(4, w.width - x), std::min(4, w.height - y)};
      for (const PixelPosition& p : tile_pixels(block)) survey.pixels.push_back(p);
    }
  }
  trace_survey(picture, context, samples, replicates, survey, stats);
  return cost_of(survey, picture.options.error_measure);
}

// The noise of uniform samples, as few of them show it.
struct NoiseForecast {
  SampleCost cost;
  double decay = 1.0;  // as in SampleAllocation::Limits

  double samples_to(double mean_square) const {
    constexpr double n = 2.0 * k_noise_samples;
    return n * std::pow(cost.variance / n / mean_square, 1.0 / decay);
  }
};

NoiseForecast forecast_noise(const Picture& picture, const TransportContext& context, Stats& stats) {
  NoiseForecast forecast = {survey_noise(picture, context, stats)};
  const SampleCost few = survey_noise(picture, context, stats, 1, k_decay_replicates);
  if (forecast.cost.variance > 0.0 && few.variance > 0.0) {
    const double decay = 1.0 + std::log(few.variance / forecast.cost.variance) / std::log(double(k_noise_samples));
    forecast.decay = std::clamp(decay, 1.0, k_most_decay);
  }
  return forecast;
}

// From single pixels spread over the window, with `samples` samples each, as far as few and many go.
FieldError survey_field_error(const Picture& picture, const TransportContext& context, const TransportContext& rays,
                              double samples, Stats& stats) {
  const Rect& w = picture.window;
  const double wanted = std::max(double(w.width) * double(w.height) / k_pixels_each, double(k_fewest_pixels));
  const double side = std::max(std::sqrt(double(w.width) * double(w.height) / wanted), 1.0);
  Survey by_fields;
  for (double y = 0.0; y < double(w.height); y += side) {
    for (double x = 0.0; x < double(w.width); x += side) {
      const auto seed = scalar::pixel_seed(picture.settings.seed, uint32_t(x), uint32_t(y));
      const auto place = scalar::sample_2d(0, seed, 0);
      by_fields.pixels.push_back({w.x + std::min(int(x + side * double(place.x)), w.width - 1),
                                  w.y + std::min(int(y + side * double(place.y)), w.height - 1)});
    }
  }
  Survey by_rays = by_fields;
  const auto half_samples = uint32_t(std::clamp(0.5 * samples, k_least_samples, k_most_samples));
  trace_survey(picture, context, half_samples, k_error_replicates, by_fields, stats);
  trace_survey(picture, rays, half_samples, k_error_replicates, by_rays, stats);
  FieldError error;
  for (size_t i = 0; i < by_fields.pixels.size(); ++i) {
    const PixelSums &f = by_fields.sums[i], &r = by_rays.sums[i];
    // Noise of the halves is independent: the mean of the product is the square of what both share.
    const DVec3 product = (f.mean_of(0) - r.mean_of(0)) * (f.mean_of(1) - r.mean_of(1));
    error.mean_square += weighted_square(product, r.mean(), picture.options.error_measure);
  }
  error.mean_square = std::max(error.mean_square / double(by_fields.pixels.size()), 0.0);
  error.fields = cost_of(by_fields, picture.options.error_measure);
  error.rays = cost_of(by_rays, picture.options.error_measure);
  return error;
}

// The squared error that may be left.
double square_of_target(const RenderOptions& options) {
  return double(options.target_error) * double(options.target_error);
}

// Pictures of which fewer samples of a pixel reach the error, or the end of the time, are left to rays.
constexpr double k_fewest_samples = 8.0;

// Where fields need this many times less work than rays with the usual samples, those that suit rays best are not
// sought.
constexpr double k_clear_gain = 4.0;

// Lobe samples that are tried beside one.
constexpr int k_more_lobe_samples = 4;

// Tolerances of lights where the usual one errs too much for a target error, in parts of it.
constexpr float k_less_trust = 0.125f;

double pixels_of(const Picture& picture) { return double(picture.window.width) * double(picture.window.height); }

double threads() { return double(tbb::this_task_arena::max_concurrency()); }

}  // namespace

void expect_samples(Picture& picture, Stage& stage, Stats& stats) {
  const RayContext rays(picture, stage);
  const NoiseForecast noise = forecast_noise(picture, rays.context(), stats);
  double samples = double(k_infinity);
  stage.survey_samples = samples;
  if (picture.options.target_error > 0.0f) {
    samples = noise.samples_to(square_of_target(picture.options));
    stage.survey_samples = noise.cost.variance / square_of_target(picture.options);
  }
  if (picture.options.time_limit > 0.0f) {
    const double seconds = std::max(noise.cost.seconds * pixels_of(picture) / threads(), 1e-9);
    const double in_time = double(picture.options.time_limit) / seconds;
    samples = std::min(samples, in_time);
    stage.survey_samples = std::min(stage.survey_samples, in_time);
  }
  picture.expect(samples);
  // What fields could spare then, surveys take.
  if (samples < k_fewest_samples) stage.trust = 0.0f;
}

namespace {

// The light samples of each camera sample that lower the noise of rays alone most for their work.
void choose_light_samples(const Picture& picture, TransportContext& context, Stats& stats) {
  if (picture.options.light_samples != 1 || picture.options.light_estimator != LightEstimator::automatic) return;
  const int open = context.settings.open_light_samples;
  double least = double(k_infinity);
  TransportSettings best = context.settings;
  std::vector<std::pair<int, int>> tried;
  for (const std::pair<int, int>& samples : {std::pair(1, open), std::pair(1, 1), std::pair(4, std::max(4, open))}) {
    if (std::find(tried.begin(), tried.end(), samples) != tried.end()) continue;
    tried.push_back(samples);
    context.settings.light_samples = samples.first;
    context.settings.open_light_samples = samples.second;
    const SampleCost cost = survey_noise(picture, context, stats);
    if (!(cost.variance * cost.work < least)) continue;
    least = cost.variance * cost.work;
    best = context.settings;
  }
  context.settings = best;
}

// The lobe samples of each camera sample likewise.
void choose_lobe_samples(const Picture& picture, TransportContext& context, Stats& stats) {
  // Radiance maps answer for whole lobes.
  if (picture.options.lobe_samples != 1 || context.lobes) return;
  const std::vector<Bsdf>& all = picture.scene.bsdfs;
  const auto splits = [](const Bsdf& b) { return b.kind != BsdfKind::diffuse && b.kind != BsdfKind::conductor; };
  if (std::none_of(all.begin(), all.end(), splits)) return;
  const SampleCost one = survey_noise(picture, context, stats);
  picture.split_lobes(context.settings, k_more_lobe_samples);
  const SampleCost more = survey_noise(picture, context, stats);
  if (!(more.variance * more.work < one.variance * one.work)) picture.split_lobes(context.settings, 1);
}

}  // namespace

void choose_samples(const Picture& picture, bool rays_alone, TransportContext& context, Stats& stats) {
  if (picture.spp < k_fewest_samples) return;
  // Where fields answer, a survey has chosen light samples already.
  if (rays_alone) choose_light_samples(picture, context, stats);
  choose_lobe_samples(picture, context, stats);
}

bool trusts_fields(const Picture& picture, Stage& stage, const TransportContext& context, Checkpoint& decided,
                   Stats& stats) {
  const RayContext rays(picture, stage);
  const auto survey = [&] { return survey_field_error(picture, context, rays.context(), stage.survey_samples, stats); };
  FieldError error = survey();
  const double target = square_of_target(picture.options);
  decided.field_mean_square = error.mean_square;
  if (picture.options.target_error == 0.0f) {
    const double seconds = std::max(-seconds_since(*stage.deadline), 0.0) * threads();
    const auto noise_in_time = [&](const SampleCost& cost) {
      return cost.variance * cost.seconds * pixels_of(picture) / seconds;
    };
    if (error.mean_square + noise_in_time(error.fields) <= noise_in_time(error.rays)) return true;
    stage.trust = 0.0f;
    return false;
  }
  // Where the tolerance may be at fault, less of it is tried first.
  const bool by_tolerance = context.settings.estimates && !picture.options.tolerance && stage.trust == 1.0f;
  if (by_tolerance && error.mean_square > 0.25 * target) {
    stage.trust = k_less_trust;
    return false;
  }
  const auto left = [&] { return target - error.mean_square; };
  const auto gain = [&] { return error.rays.work_to(target) / error.fields.work_to(left()); };
  if (gain() >= 1.0 && gain() < k_clear_gain) {
    choose_samples(picture, /*rays_alone=*/true, rays.context(), stats);
    error = survey();
    decided.field_mean_square = error.mean_square;
  }
  if (gain() >= 1.0) {
    const NoiseForecast noise = forecast_noise(picture, context, stats);
    decided.expected_samples = int(std::clamp(noise.samples_to(left()), 1.0, double(picture.most_samples)));
    decided.decay = noise.decay;
    return true;
  }
  stage.trust = 0.0f;
  return false;
}

}  // namespace fieldtrace
