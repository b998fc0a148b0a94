// How many light samples a camera sample takes where a light may be hidden.
//
// Most light samples are settled without a ray: no object can stand in their way, or fields answer them. The noise of
// light lies in the rest, which are few, and each costs less than another camera sample. So more of them are taken
// until they cost as much as camera samples do (docs/decisions/028-open-lights.md). Thread-safety: pure.
#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>

namespace fieldtrace {

// Shadow rays for each camera sample, at most, unless more light samples are requested.
inline constexpr double k_open_rays = 2.0;
// Light samples for each camera sample, likewise: with more, edges make most of the noise.
inline constexpr int k_most_open_samples = 4;

// Of suns cut out of skies that maps answer for: their rays are few beside what the cells of the sky cost.
inline constexpr int k_open_sun_samples = 4;

// `light_samples`: requested. `open_rays`: shadow rays that one light sample for each camera sample sends, over all
// lights, as a survey of the picture counts them. A power of two, or `light_samples`.
inline int open_light_samples(int light_samples, double open_rays) {
  const double most = std::min(k_open_rays / std::max(open_rays, 1e-6), double(k_most_open_samples));
  return std::max(light_samples, most >= 1.0 ? int(std::bit_floor(uint32_t(most))) : 1);
}

}  // namespace fieldtrace
