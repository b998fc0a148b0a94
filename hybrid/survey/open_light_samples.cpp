#include "hybrid/survey/open_light_samples.h"

#include <algorithm>
#include <cmath>

namespace fieldtrace {
namespace {

// What a camera sample costs beside the shadow rays that it sends, in these: its ray is one of a coherent packet. And
// what NoiseForecast::work counts for that.
constexpr double k_camera_rays = 0.5, k_camera_work = 2.0;

}  // namespace

int NoiseByLightSamples::best(int fewest) const {
  // A mean square falls as samples^-k_edge_decay.
  const auto time = [&](int n) {
    return std::pow(rest + light / n, 1.0 / k_edge_decay) * (k_camera_rays + rays + rays_of_light * n);
  };
  int n = fewest;
  while (2 * n <= k_most_open_samples && time(2 * n) < time(n)) n *= 2;
  return n;
}

NoiseByLightSamples noise_by_light_samples(const PictureSurvey& picture, Stats& stats) {
  TransportSettings settings = picture.settings;
  const int few = settings.light_samples, many = std::min(few * k_most_open_samples / 2, k_most_open_samples);
  const auto of = [&](int n) {
    settings.open_light_samples = n;
    const NoiseSurvey survey =
        survey_few(picture, picture.scene.camera, picture.scene.film, settings, SurveySpread::few_pixels, stats);
    return noise_of(survey, picture.measure, 1.0);
  };
  if (2 * few > k_most_open_samples) return {};
  const NoiseForecast with_few = of(few), with_many = of(many);
  if (!picture.goes_on()) return {};
  NoiseByLightSamples n;
  n.light = std::max(with_few.mean_square - with_many.mean_square, 0.0) / (1.0 / few - 1.0 / many);
  n.rest = std::max(with_few.mean_square - n.light / few, 0.0);
  n.rays_of_light = std::max(with_many.work - with_few.work, 0.0) / (many - few);
  n.rays = std::max(with_few.work - k_camera_work - n.rays_of_light * few, 0.0);
  return n;
}

}  // namespace fieldtrace
