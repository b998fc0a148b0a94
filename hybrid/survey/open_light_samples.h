// How many light samples a camera sample takes where a light may be hidden.
//
// Most light samples are settled without a ray: no object can stand in their way, or fields answer them. The noise of
// light lies in the rest. More of these are taken while they lower the picture's noise by more than their rays cost; a
// survey tells by how much (docs/decisions/054-light-samples-by-noise.md).
#pragma once

#include "hybrid/survey/noise_survey.h"

namespace fieldtrace {

// Light samples for each camera sample, at most, unless more are requested: a survey of half as many tells.
inline constexpr int k_most_open_samples = 8;

// Of suns cut out of skies that maps answer for: their rays are few beside what the cells of the sky cost.
inline constexpr int k_open_sun_samples = 4;

// What a camera sample leaves and costs with n light samples where lights may be hidden. Thread-safety: pure.
struct NoiseByLightSamples {
  double light = 0.0, rest = 0.0;          // mean squares: light / n + rest
  double rays_of_light = 0.0, rays = 0.0;  // rays_of_light * n + rays, beside the camera's

  // Those that take the least time to an error: `fewest` times a power of two.
  int best(int fewest) const;
};

// By pictures with `picture.settings.light_samples` and with k_most_open_samples / 2 times as many, or that many. No
// noise if goes_on() became false meanwhile. Thread-safety: called by one thread; tracing is parallel.
NoiseByLightSamples noise_by_light_samples(const PictureSurvey& picture, Stats& stats);

}  // namespace fieldtrace
