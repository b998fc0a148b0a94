#include "hybrid/survey/light_noise.h"

#include <algorithm>
#include <cmath>

#include "core/camera/camera.h"
#include "hybrid/path/ray_context.h"

namespace fieldtrace {
namespace {

// Pixels that tell; maps and what they leave to rays leave this share of the noise at least.
constexpr double k_light_noise_pixels = 1024.0, k_least_noise_left = 0.02;
// A pixel's filter where all samples are at its centre.
constexpr float k_centre_radius = 1e-3f;

// The mean square that one sample of a pixel leaves; 0 if goes_on() became false.
double noise_of_one(const LightNoiseInput& input, const Camera& of, const Film& film, int depth, Stats& stats) {
  const CameraSampler camera(of, film);
  TransportSettings settings = input.settings;
  settings.max_depth = depth;
  settings.first_hits = false;
  settings.seed = 0;  // whether maps are made does not depend on the picture's
  settings.light_samples = settings.open_light_samples = 1;
  const RayContext rays(input.scene, input.accel, input.traits, camera, settings, input.lights, false);
  NoiseSurvey survey = {survey_pixels(input.window, settings.seed, k_light_noise_pixels)};
  if (!trace_survey(rays.context(), 1, k_light_noise_replicates, input.goes_on, survey, stats)) return 0.0;
  return noise_of(survey, input.measure, 1.0).mean_square;
}

// A mean square falls as samples^-k_edge_decay.
double gain_of(double left) { return std::pow(std::max(left, k_least_noise_left), -1.0 / k_edge_decay); }

}  // namespace

double LightNoise::most_gain() { return gain_of(0.0); }

LightNoise::LightNoise(const LightNoiseInput& input, Stats& stats)
    : input_(input),
      stats_(stats),
      all_(noise_of_one(input, input.scene.camera, input.scene.film, input.settings.max_depth, stats)) {}

double LightNoise::of_light(int depth) const {
  Film centre = input_.scene.film;
  centre.filter = FilterKind::box;
  centre.filter_radius = k_centre_radius;
  Camera pinhole = input_.scene.camera;
  pinhole.aperture_radius = 0.0f;
  return noise_of_one(input_, pinhole, centre, depth, stats_);
}

double LightNoise::gain_without(int depth) const {
  if (!(all_ > 0.0) || !input_.goes_on()) return 1.0;
  const double light = of_light(depth);
  const double shared = 1.0 - 1.0 / double(input_.settings.light_samples);
  const double averaged = shared > 0.0 ? shared * (depth == k_direct ? light : of_light(k_direct)) : 0.0;
  const double of_picture = all_ - averaged;
  return of_picture > 0.0 ? gain_of((all_ - light) / of_picture) : most_gain();
}

}  // namespace fieldtrace
