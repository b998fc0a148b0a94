#include "hybrid/render/render_pilot.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <mutex>

#include "core/platform/parallel.h"
#include "core/sampling/sobol.hd.h"
#include "hybrid/film/sample_allocation.h"
#include "hybrid/transport/trace_pixels.h"
#include "hybrid/visibility/shadow_answerer.h"

namespace fieldtrace {
namespace {

// Numbers of sequences that no round uses.
constexpr uint32_t k_noise_replicates = 0x80000000u, k_error_replicates = 0x80000002u;
// Noise is surveyed by one block of 4 x 4 pixels in this many by as many, with 4 samples of each half.
constexpr int k_block_step = 6;
constexpr uint32_t k_noise_samples = 4;
// Field errors by one pixel in this many, as far as there are,
constexpr int k_pixels_each = 512;
constexpr int k_fewest_pixels = 256;
// with this many samples of each half.
constexpr double k_least_samples = 8.0, k_most_samples = 512.0;
// Pixels of one task.
constexpr size_t k_task_pixels = 16;

struct Survey {
  std::vector<PixelPosition> pixels;
  std::vector<PixelSums> sums;
};

// Traces the survey's pixels with `samples` samples of each half.
void trace_survey(const Picture& picture, const TransportContext& context, uint32_t samples, uint32_t replicate,
                  Survey& survey) {
  survey.sums.assign(survey.pixels.size(), {});
  tbb::enumerable_thread_specific<TransportWorker> workers([&] { return TransportWorker(context); });
  const size_t tasks = (survey.pixels.size() + k_task_pixels - 1) / k_task_pixels;
  parallel_for(tasks, [&](size_t task) {
    const size_t begin = task * k_task_pixels, end = std::min(begin + k_task_pixels, survey.pixels.size());
    const auto pixels = std::span<const PixelPosition>(survey.pixels).subspan(begin, end - begin);
    const std::vector<uint32_t> counts(pixels.size(), samples);
    TransportWorker& worker = workers.local();
    for (int half = 0; half < 2; ++half) {
      const auto add = [&](size_t pixel, std::span<const Rgb> radiance, std::span<const FirstHit>) {
        PixelSums& sums = survey.sums[begin + pixel];
        sums.add(half, radiance);
        sums.work += float(double(radiance.size()) * worker.sample_cost().work);
        sums.seconds += double(radiance.size()) * worker.sample_cost().seconds;
      };
      const auto goes_on = [&] { return !picture.stopped(); };
      // Isolated like the tiles of the picture (render_tiles).
      tbb::this_task_arena::isolate([&] {
        trace_pixels(pixels, counts, replicate + uint32_t(half), context.settings.lobe_samples, worker, goes_on, add);
      });
    }
  });
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

// The mean of one half; of both: half < 0.
DVec3 mean_of(const PixelSums& p, int half) {
  return p.count[half] > 0 ? p.radiance[half] / double(p.count[half]) : DVec3(0.0);
}

}  // namespace

RayContext::RayContext(const Picture& picture, const Stage& stage) {
  const std::vector<Field*> none(picture.scene.shapes.size(), nullptr);
  answerer_ = std::make_unique<ShadowAnswerer>(picture.scene, stage.accel, stage.traits, none,
                                               AnswererSettings{picture.settings.isa, 0.0f});
  TransportSettings settings = picture.settings;
  settings.first_hits = settings.count_first_hits = settings.count_reflections = settings.occlusion = false;
  context_ =
      std::make_unique<TransportContext>(picture.scene, stage.accel, stage.camera, *answerer_, settings, stage.lights);
}

SampleCost survey_noise(const Picture& picture, const TransportContext& context) {
  Survey survey;
  const Rect& w = picture.window;
  const int step = 4 * std::clamp(std::min(w.width, w.height) / 32, 1, k_block_step);
  for (int y = 0; y < w.height; y += step) {
    for (int x = 0; x < w.width; x += step) {
      const Rect block{w.x + x, w.y + y, std::min(4, w.width - x), std::min(4, w.height - y)};
      for (const PixelPosition& p : tile_pixels(block)) survey.pixels.push_back(p);
    }
  }
  trace_survey(picture, context, k_noise_samples, k_noise_replicates, survey);
  return cost_of(survey, picture.options.error_measure);
}

FieldError survey_field_error(const Picture& picture, const TransportContext& context, const TransportContext& rays,
                              double samples) {
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
  trace_survey(picture, context, half_samples, k_error_replicates, by_fields);
  trace_survey(picture, rays, half_samples, k_error_replicates, by_rays);
  FieldError error;
  for (size_t i = 0; i < by_fields.pixels.size(); ++i) {
    const PixelSums &f = by_fields.sums[i], &r = by_rays.sums[i];
    // Noise of the halves is independent: the mean of the product is the square of what both share.
    const DVec3 product = (mean_of(f, 0) - mean_of(r, 0)) * (mean_of(f, 1) - mean_of(r, 1));
    error.mean_square += weighted_square(product, r.mean(), picture.options.error_measure);
  }
  error.mean_square = std::max(error.mean_square / double(by_fields.pixels.size()), 0.0);
  error.fields = cost_of(by_fields, picture.options.error_measure);
  error.rays = cost_of(by_rays, picture.options.error_measure);
  return error;
}

}  // namespace fieldtrace
