// What further camera samples of a picture will cost, and what noise they will leave. Thread-safety: values.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

namespace fieldtrace {

// Where samples are nets in two dimensions, noise falls as n^-3 as far as the picture is smooth (Owen, "Scrambled net
// variance for integrals of smooth functions", 1997), and as n^-1.5 along edges (Wang and He, "On the convergence rate
// of randomized quasi-Monte Carlo for discontinuous functions", 2015): that is what is left in the end, and further
// samples are expected to gain no more.
inline constexpr double k_smooth_decay = 3.0, k_edge_decay = 1.5;
inline double later_decay(double decay) { return std::min(decay, k_edge_decay); }
// How fast noise is believed to have fallen at most. Halves that share answers do not tell all of it.
inline double most_decay(bool shares_answers) { return shares_answers ? k_edge_decay : k_smooth_decay; }

// The noise of n samples, if n / 2 leave `half` more, and n / 4 `quarter` more than these. Where it falls no faster
// than along edges, it falls as a power of n; else it is a part that falls so and one that falls as n^-3. It is
// believed to have fallen by `most` as a power at most, and by 1 at least.
inline double noise_left(double half, double quarter, double most = k_smooth_decay) {
  const double edges = std::exp2(k_edge_decay), smooth = std::exp2(k_smooth_decay);
  const double fall = std::clamp(quarter, 2.0 * half, std::exp2(most) * half);
  if (!(fall > edges * half)) return half > 0.0 ? half * half / (fall - half) : 0.0;
  const double even = std::min((fall - edges * half) / ((smooth - edges) * (smooth - 1.0)), half / (smooth - 1.0));
  return even + (half - (smooth - 1.0) * even) / (edges - 1.0);
}

// The power of two that is nearest to n > 0 by ratio.
inline double nearest_power(double n) { return std::exp2(std::nearbyint(std::log2(n))); }

// Of uniform samples, as few of them showed it. Errors are mean squares over pixels and channels.
struct NoiseForecast {
  double samples = 1.0, mean_square = 0.0;    // of each pixel, and the noise that they had left
  double decay = 1.0;                         // it fell as samples^-decay: 1 to k_smooth_decay
  double work = 1.0, seconds = 0.0;           // of one sample and its rays; of one thread
  double quarter = 0.0, quarter_error = 0.0;  // the noise that a quarter of them left, and its standard error

  double mean_square_of(double n) const {
    return mean_square * std::pow(samples / n, n > samples ? later_decay(decay) : decay);
  }
  // Infinite where `error` is not above 0.
  double samples_to(double error) const {
    if (!(error > 0.0)) return std::numeric_limits<double>::infinity();
    return samples * std::pow(mean_square / error, 1.0 / (mean_square > error ? later_decay(decay) : decay));
  }
  double work_to(double error) const { return std::max(samples_to(error), 1.0) * work; }
};

}  // namespace fieldtrace
