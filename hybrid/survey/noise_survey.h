// How noisy pictures are, as a few single pixels tell.
//
// Determinism: as pictures. Thread-safety: called by one thread; tracing is parallel.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "core/camera/camera.h"
#include "core/trace/accel.h"
#include "hybrid/film/film_sums.h"
#include "hybrid/film/noise_forecast.h"
#include "hybrid/film/noise_sums.h"
#include "hybrid/path/tiles.h"
#include "hybrid/path/transport_context.h"
#include "hybrid/stats/stats.h"

namespace fieldtrace {

// The first numbers of the two sequences of surveys of noise, of what fields err by, of the noise of one sample, and of
// survey_few(). No round uses them.
inline constexpr uint32_t k_noise_replicates = 0x80000000u, k_error_replicates = 0x80000002u;
inline constexpr uint32_t k_one_replicates = 0x80000004u, k_few_samples_replicates = 0x80000006u;

// Pixels, and what two independent sequences of samples of each add up to.
struct NoiseSurvey {
  std::vector<PixelPosition> pixels;
  std::vector<SequencePair> sums = {};
};

// Single pixels, one in each part of the window, which columns and rows divide evenly; about `wanted`, as far as it has
// so many.
std::vector<PixelPosition> survey_pixels(const Rect& window, uint32_t seed, double wanted);

using GoesOn = std::function<bool()>;

// Traces the survey's pixels with `samples` samples of each sequence; these have the numbers `replicate` and the next.
// Rays count as those of surveys, bakes as bakes. False if goes_on() became false meanwhile.
bool trace_survey(const TransportContext& context, uint32_t samples, uint32_t replicate, const GoesOn& goes_on,
                  NoiseSurvey& survey, Stats& stats);

// What the samples of one sequence leave, and how that falls with their number: halves and quarters of a sequence tell
// what a half and a quarter of it leave more, if it has quarters. It is believed to have fallen by `most` as a power at
// most.
NoiseForecast noise_of(const NoiseSurvey& survey, ErrorMeasure measure, double most);

// The samples of each sequence by which survey_few() tells the noise of a picture of so many pixels and samples of a
// pixel: as many as the picture's, or less where they would take long. With more samples light makes more of the noise.
uint32_t few_samples_of(double pixels, int samples);

// A picture whose noise by rays is told by a few samples.
struct PictureSurvey {
  const Scene& scene;
  const Accel& accel;
  std::span<const ShapeTraits> traits;
  const std::shared_ptr<const LightTable>& lights;
  const TransportSettings& settings;  // of the picture
  Rect window;
  uint32_t samples = 1;  // few_samples_of() the picture: of each pixel, or one in each of as many times the pixels
  ErrorMeasure measure = ErrorMeasure::absolute;
  GoesOn goes_on = [] { return true; };
};

// How the samples of a survey lie: all in about a thousand pixels, or one in each of more.
enum class SurveySpread : uint8_t { few_pixels, one_of_each };

// The picture's survey by rays with `settings`, seen by `camera` on `film`. Whatever the seed of `settings`, the
// samples are the same. No pixels if goes_on() became false meanwhile.
NoiseSurvey survey_few(const PictureSurvey& picture, const Camera& camera, const Film& film, TransportSettings settings,
                       SurveySpread spread, Stats& stats);

}  // namespace fieldtrace
