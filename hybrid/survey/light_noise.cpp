#include "hybrid/survey/light_noise.h"

#include <algorithm>
#include <cmath>

namespace fieldtrace {
namespace {

// Maps and what they leave to rays leave this share of the noise at least.
constexpr double k_least_noise_left = 0.02;
// Of all noise, what rays to undecided cells leave.
constexpr double k_noise_by_maps = 0.0005;
// A pixel's filter where all samples are at its centre.
constexpr float k_centre_radius = 1e-3f;
// Paths of a surface and a light.
constexpr int k_direct = 2;

// By paths of at most `depth` surfaces and lights.
NoiseSurvey survey_with_one_light_sample(const PictureSurvey& picture, const Camera& camera, const Film& film,
                                         int depth, Stats& stats) {
  TransportSettings settings = picture.settings;
  settings.max_depth = depth;
  settings.light_samples = settings.open_light_samples = 1;
  return survey_few(picture, camera, film, settings, SurveySpread::one_of_each, stats);
}

NoiseSurvey survey_centres(const PictureSurvey& picture, int depth, Stats& stats) {
  Film centre = picture.scene.film;
  centre.filter = FilterKind::box;
  centre.filter_radius = k_centre_radius;
  Camera pinhole = picture.scene.camera;
  pinhole.aperture_radius = 0.0f;
  return survey_with_one_light_sample(picture, pinhole, centre, depth, stats);
}

// The noise of what one survey has and another, of the same samples, has not.
double noise_of_difference(const NoiseSurvey& all, const NoiseSurvey& part, ErrorMeasure measure) {
  if (all.sums.size() != part.sums.size()) return 0.0;  // cut short
  const auto apart = [](const SequencePair& pair) { return pair[0].mean() - pair[1].mean(); };
  double sum = 0.0;
  for (size_t i = 0; i < all.sums.size(); ++i) {
    const DVec3 value = 0.5 * (all.sums[i][0].mean() + all.sums[i][1].mean());
    const DVec3 difference = apart(all.sums[i]) - apart(part.sums[i]);
    sum += 0.5 * weighted_square(difference * difference, value, measure);
  }
  return sum / double(std::max<size_t>(all.sums.size(), 1));
}

// Of what is noisy, by two independent sequences.
double noiseless_square(const NoiseSurvey& survey, ErrorMeasure measure) {
  double sum = 0.0;
  for (const SequencePair& pair : survey.sums) {
    const DVec3 a = pair[0].mean(), b = pair[1].mean();
    if (a != b) sum += weighted_square(a * b, 0.5 * (a + b), measure);
  }
  return sum / double(std::max<size_t>(survey.sums.size(), 1));
}

// A mean square falls as samples^-k_edge_decay.
double gain_of(double left) { return std::pow(std::max(left, k_least_noise_left), -1.0 / k_edge_decay); }

}  // namespace

double LightNoise::most_gain() { return gain_of(0.0); }

LightNoise::LightNoise(const PictureSurvey& picture, Stats& stats) : picture_(picture) {
  const int depth = picture.settings.max_depth;
  const auto mean_square = [&](const NoiseSurvey& survey) {
    return noise_of(survey, picture.measure, 1.0).mean_square;
  };
  all_ = mean_square(survey_with_one_light_sample(picture, picture.scene.camera, picture.scene.film, depth, stats));
  if (!(all_ > 0.0)) return;
  const NoiseSurvey centres = survey_centres(picture, depth, stats);
  light_ = noiseless_square(centres, picture.measure);
  of_light_ = of_direct_ = std::min(mean_square(centres), all_);
  if (depth >= 0 && depth <= k_direct) return;
  const double sent_on = noise_of_difference(centres, survey_centres(picture, k_direct, stats), picture.measure);
  of_direct_ = std::max(of_light_ - sent_on, 0.0);
}

double LightNoise::left_at_one_sample(double share_of_sent_on) const {
  return all_ - of_direct_ - share_of_sent_on * (of_light_ - of_direct_);
}

LightNoise::Without LightNoise::without(double share_of_sent_on) const {
  if (!(all_ > 0.0) || !picture_.goes_on()) return {1.0, 1.0};
  const double left = left_at_one_sample(share_of_sent_on);
  const double of_picture = all_ - of_direct_ * (1.0 - 1.0 / double(picture_.settings.light_samples));
  return {of_picture > left ? gain_of(left / of_picture) : 1.0, std::max(left / all_, k_least_noise_left)};
}

double LightNoise::left_of(double share_of_sent_on, double samples) const {
  const double edges = std::max(left_at_one_sample(share_of_sent_on), 0.0);
  return edges / std::pow(samples, k_edge_decay) + k_noise_by_maps * all_ / samples;
}

}  // namespace fieldtrace
