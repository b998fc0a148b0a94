#include "hybrid/survey/noise_survey.h"

#include <tbb/enumerable_thread_specific.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <span>

#include "core/platform/parallel.h"
#include "core/sampling/sobol.hd.h"
#include "hybrid/path/ray_context.h"
#include "hybrid/transport/trace_pixels.h"

namespace fieldtrace {
namespace {

// Pixels of one task.
constexpr size_t k_task_pixels = 64;
// Those that tell the noise of few samples.
constexpr double k_few_samples_pixels = 1024.0;
// The share of a picture's camera samples that such surveys take, from one of each of these pixels up to a number from
// which on light hardly makes more of the noise.
constexpr double k_survey_share = 0.01, k_most_few_samples = 16.0;

}  // namespace

std::vector<PixelPosition> survey_pixels(const Rect& w, uint32_t picture_seed, double wanted) {
  const double side = std::max(std::sqrt(double(w.width) * double(w.height) / wanted), 1.0);
  const int columns = int(std::ceil(w.width / side)), rows = int(std::ceil(w.height / side));
  const auto place = [](int i, float shift, int count, int size) {
    return std::min(int((double(i) + double(shift)) * size / count), size - 1);
  };
  std::vector<PixelPosition> pixels;
  for (int j = 0; j < rows; ++j) {
    for (int i = 0; i < columns; ++i) {
      const auto seed = scalar::pixel_seed(picture_seed, uint32_t(i), uint32_t(j));
      const auto shift = scalar::sample_2d(0, seed, 0);
      pixels.push_back({w.x + place(i, shift.x, columns, w.width), w.y + place(j, shift.y, rows, w.height)});
    }
  }
  return pixels;
}

bool trace_survey(const TransportContext& context, uint32_t samples, uint32_t replicate, const GoesOn& goes_on,
                  NoiseSurvey& survey, Stats& stats) {
  survey.sums.assign(survey.pixels.size(), {});
  std::atomic<bool> is_complete = true;
  tbb::enumerable_thread_specific<TransportWorker> workers([&] { return TransportWorker(context); });
  const size_t tasks = (survey.pixels.size() + k_task_pixels - 1) / k_task_pixels;
  parallel_for_isolated(tasks, [&](size_t task) {
    const size_t begin = task * k_task_pixels, end = std::min(begin + k_task_pixels, survey.pixels.size());
    const auto pixels = std::span<const PixelPosition>(survey.pixels).subspan(begin, end - begin);
    const std::vector<SampleRange> ranges(pixels.size(), {0, samples});
    TransportWorker& worker = workers.local();
    const auto add = [&](const PixelRun& run, std::span<const Rgb> radiance, std::span<const FirstHit>) {
      const TransportWorker::Cost& cost = worker.sample_cost();
      PixelSums& sums = survey.sums[begin + run.pixel][size_t(run.sequence)];
      sums.add_of(run.first, samples, radiance, cost.work, cost.seconds);
    };
    if (!trace_pixels(pixels, ranges, Sequences{2, replicate}, context.settings.lobe_samples, worker, goes_on, add))
      is_complete = false;
  });
  for (const TransportWorker& worker : workers) {
    stats.survey_rays += worker.stats().rays_exact;
    stats.add_bake(worker.stats());
  }
  return is_complete;
}

NoiseForecast noise_of(const NoiseSurvey& survey, ErrorMeasure measure, double most) {
  NoiseForecast noise;
  double samples = 0.0, work = 0.0, seconds = 0.0, fall = 0.0, squares = 0.0;
  for (const SequencePair& pair : survey.sums) {
    const DVec3 value = 0.5 * (pair[0].mean() + pair[1].mean()), apart = pair[0].mean() - pair[1].mean();
    const double of_pixel = 0.5 * weighted_square(apart * apart, value, measure);
    double fall_of_pixel = 0.0;
    for (const PixelSums& p : pair) {
      if (p.has_quarters())
        fall_of_pixel += 0.5 * weighted_square(p.half_difference() + p.quarter_difference(), value, measure);
      samples += double(p.samples());
      work += p.work;
      seconds += p.seconds;
    }
    noise.mean_square += of_pixel;
    fall += fall_of_pixel;
    squares += (of_pixel + fall_of_pixel) * (of_pixel + fall_of_pixel);
  }
  if (!(samples > 0.0)) return noise;
  const auto pixels = double(survey.sums.size());
  noise.quarter = (noise.mean_square + fall) / pixels;
  noise.quarter_error = std::sqrt(std::max(squares / pixels - noise.quarter * noise.quarter, 0.0) / pixels);
  if (noise.mean_square > 0.0) noise.decay = std::clamp(0.5 * std::log2(1.0 + fall / noise.mean_square), 1.0, most);
  noise.mean_square /= pixels;
  noise.samples = 0.5 * samples / pixels;
  noise.work = work / samples;
  noise.seconds = seconds / samples;
  return noise;
}

uint32_t few_samples_of(double pixels, int samples) {
  // Two surveys of two sequences each are compared, or three where paths may be longer.
  const double wanted = k_survey_share * pixels * samples / (4.0 * std::min(pixels, k_few_samples_pixels));
  const double most = std::min(double(samples), k_most_few_samples);
  return uint32_t(std::min(nearest_power(std::max(wanted, 1.0)), most));
}

NoiseSurvey survey_few(const PictureSurvey& picture, const Camera& camera, const Film& film, TransportSettings settings,
                       SurveySpread spread, Stats& stats) {
  const CameraSampler sampler(camera, film);
  settings.first_hits = false;
  settings.seed = 0;  // what surveys decide does not depend on the picture's
  const RayContext rays(picture.scene, picture.accel, picture.traits, sampler, settings, picture.lights, false);
  const uint32_t samples = spread == SurveySpread::few_pixels ? picture.samples : 1;
  const double pixels = k_few_samples_pixels * double(picture.samples / samples);
  NoiseSurvey survey = {survey_pixels(picture.window, settings.seed, pixels)};
  if (!trace_survey(rays.context(), samples, k_few_samples_replicates, picture.goes_on, survey, stats)) return {};
  return survey;
}

}  // namespace fieldtrace
