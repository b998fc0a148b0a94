#include "hybrid/survey/light_noise.h"

#include <algorithm>
#include <cmath>

namespace fieldtrace {
namespace {

// Maps and what they leave to rays leave this share of the noise at least.
constexpr double k_least_noise_left = 0.02;
// A pixel's filter where all samples are at its centre.
constexpr float k_centre_radius = 1e-3f;

double noise_with_one_light_sample(const PictureSurvey& picture, const Camera& camera, const Film& film, int depth,
                                   Stats& stats) {
  TransportSettings settings = picture.settings;
  settings.max_depth = depth;
  settings.light_samples = settings.open_light_samples = 1;
  return noise_of_few(picture, camera, film, settings, stats).mean_square;
}

// A mean square falls as samples^-k_edge_decay.
double gain_of(double left) { return std::pow(std::max(left, k_least_noise_left), -1.0 / k_edge_decay); }

}  // namespace

double LightNoise::most_gain() { return gain_of(0.0); }

LightNoise::LightNoise(const PictureSurvey& picture, Stats& stats)
    : picture_(picture),
      stats_(stats),
      all_(noise_with_one_light_sample(picture, picture.scene.camera, picture.scene.film, picture.settings.max_depth,
                                       stats)) {}

double LightNoise::of_light(int depth) const {
  Film centre = picture_.scene.film;
  centre.filter = FilterKind::box;
  centre.filter_radius = k_centre_radius;
  Camera pinhole = picture_.scene.camera;
  pinhole.aperture_radius = 0.0f;
  return std::min(noise_with_one_light_sample(picture_, pinhole, centre, depth, stats_), all_);
}

LightNoise::Without LightNoise::without(int depth) const {
  if (!(all_ > 0.0)) return {1.0, 1.0};
  const double light = of_light(depth), left = all_ - light;
  const double shared = 1.0 - 1.0 / double(picture_.settings.light_samples);
  const double averaged = shared > 0.0 ? shared * (depth == k_direct ? light : of_light(k_direct)) : 0.0;
  const double of_picture = all_ - averaged;
  if (!picture_.goes_on()) return {1.0, 1.0};
  return {of_picture > left ? gain_of(left / of_picture) : 1.0, std::max(left / all_, k_least_noise_left)};
}

}  // namespace fieldtrace
