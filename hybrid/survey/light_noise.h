// How much of a picture's noise is that of its light. Thread-safety: called by one thread; tracing is parallel.
#pragma once

#include "hybrid/survey/noise_survey.h"

namespace fieldtrace {

// Compares pixels sampled over the filter with the same pixels sampled at their centres, by one light sample of each
// camera sample: the picture's light samples divide the noise of direct light. Samples of longer and shorter paths are
// the same, so that what only the longer ones bring is known by itself: a ray that meets a surface brings that light
// instead of the sky's, and it may have as much noise alone as both together. Rays count as those of surveys.
class LightNoise {
 public:
  // All that `picture` refers to must outlive it, and `stats`.
  LightNoise(const PictureSurvey& picture, Stats& stats);

  // What there would be without the noise of light. Edges within pixels are left, and longer paths.
  struct Without {
    double gain = most_gain();  // what Monte Carlo's time to an error would be divided by, 1 or more, at most
    double share = 1.0;         // of the mean square of one sample with one light sample, at least
  };
  // If direct light at first surfaces had none, and this share of what other surfaces send to them. The gain is 1 if
  // goes_on() became false meanwhile.
  Without without(double share_of_sent_on) const;
  // The mean square that so many samples of a pixel leave of that: edges and longer paths, as if these fell as fast,
  // and rays to cells that maps do not decide.
  double left_of(double share_of_sent_on, double samples) const;
  static double most_gain();
  // The mean square of the picture where light has noise, without that noise.
  double light() const { return light_; }

 private:
  // What is left where direct light has no noise, and this share of the rest has none.
  double left_at_one_sample(double share_of_sent_on) const;

  PictureSurvey picture_;
  // Mean squares: of all noise; what would be taken away of it if light had none, and if direct light had none.
  double all_ = 0.0, of_light_ = 0.0, of_direct_ = 0.0;
  double light_ = 0.0;
};

}  // namespace fieldtrace
