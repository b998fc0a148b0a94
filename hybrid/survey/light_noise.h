// How much of a picture's noise is that of its light. Thread-safety: called by one thread; tracing is parallel.
#pragma once

#include "hybrid/survey/noise_survey.h"

namespace fieldtrace {

// Compares pixels sampled over the filter with the same pixels sampled at their centres, by one light sample of each
// camera sample: the picture's light samples divide the noise of direct light. Rays count as those of surveys.
class LightNoise {
 public:
  // All that `picture` refers to must outlive it, and `stats`.
  LightNoise(const PictureSurvey& picture, Stats& stats);

  // What there would be without the noise of light. Edges within pixels are left, and longer paths.
  struct Without {
    double gain = most_gain();  // what Monte Carlo's time to an error would be divided by, 1 or more, at most
    double share = 1.0;         // of the mean square of one sample with one light sample, at least
  };
  // If light by paths of at most `depth` surfaces and lights (negative: any) had none. The gain is 1 if goes_on()
  // became false meanwhile.
  Without without(int depth) const;
  static double most_gain();
  // Paths of a surface and a light.
  static constexpr int k_direct = 2;

 private:
  double of_light(int depth) const;

  PictureSurvey picture_;
  Stats& stats_;
  double all_;
};

}  // namespace fieldtrace
