// How much of a picture's noise is that of its light. Thread-safety: called by one thread; tracing is parallel.
#pragma once

#include <memory>
#include <span>

#include "core/trace/accel.h"
#include "hybrid/path/transport_context.h"
#include "hybrid/survey/noise_survey.h"

namespace fieldtrace {

struct LightNoiseInput {
  const Scene& scene;
  const Accel& accel;
  std::span<const ShapeTraits> traits;
  const std::shared_ptr<const LightTable>& lights;
  const TransportSettings& settings;  // of the picture
  const Rect& window;
  ErrorMeasure measure = ErrorMeasure::absolute;
  GoesOn goes_on = [] { return true; };
};

// Compares pixels sampled over the filter with the same pixels sampled at their centres, by one light sample a camera
// sample: the picture's light samples divide the noise of direct light. Rays count as those of surveys.
class LightNoise {
 public:
  // All that `input` refers to must outlive it, and `stats`.
  LightNoise(const LightNoiseInput& input, Stats& stats);

  // By what Monte Carlo's time to an error would be divided at most if light by paths of at most `depth` surfaces and
  // lights (negative: any) had no noise, were its samples as dear as they are: 1 or more. Edges within pixels are left,
  // and longer paths. 1 if goes_on() became false meanwhile.
  double gain_without(int depth) const;
  static double most_gain();
  // Paths of a surface and a light.
  static constexpr int k_direct = 2;
  // The mean square that one sample of a pixel leaves, with one light sample.
  double of_all() const { return all_; }

 private:
  double of_light(int depth) const;

  LightNoiseInput input_;
  Stats& stats_;
  double all_;
};

}  // namespace fieldtrace
