#include "hybrid/survey/frame_by_maps.h"

#include <algorithm>
#include <cmath>

#include "hybrid/film/noise_forecast.h"

namespace fieldtrace {
namespace {

// Maps of D x D directions err by k_map_error (8 / D)^k_map_error_decay of the light, times the root of the share that
// is hidden (root mean square).
constexpr double k_map_error = 0.035, k_map_error_decay = 2.0;
// Reads in the time of a ray.
constexpr double k_reads_a_ray = 200.0;

}  // namespace

double FrameByMaps::worth_of_finer(int directions, double tolerance) const {
  const double strict = std::min(tolerance, 1.0);
  const auto mean_square = [&](double side) {
    const double error = k_map_error * std::pow(8.0 / side, k_map_error_decay) / strict;
    return noise + error * error * hidden;
  };
  const double d = directions, fine = mean_square(d), coarse = mean_square(0.5 * d);
  // A mean square falls as samples^-k_edge_decay.
  const double gain = fine > 0.0 ? std::pow(coarse / fine, 1.0 / k_edge_decay) : 1.0;
  return rays * (gain - 1.0) - (d * d - 0.25 * d * d) * reads / k_reads_a_ray;
}

}  // namespace fieldtrace
