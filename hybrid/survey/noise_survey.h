// How noisy pictures are, as a few single pixels tell.
//
// Determinism: as pictures. Thread-safety: called by one thread; tracing is parallel.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "hybrid/film/film_sums.h"
#include "hybrid/film/noise_forecast.h"
#include "hybrid/film/noise_sums.h"
#include "hybrid/path/tiles.h"
#include "hybrid/path/transport_context.h"
#include "hybrid/stats/stats.h"

namespace fieldtrace {

// The first numbers of the two sequences of surveys of noise, of what fields err by, of the noise of one sample, and of
// that of light. No round uses them.
inline constexpr uint32_t k_noise_replicates = 0x80000000u, k_error_replicates = 0x80000002u;
inline constexpr uint32_t k_one_replicates = 0x80000004u, k_light_noise_replicates = 0x80000006u;

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

}  // namespace fieldtrace
