// What further camera samples of a picture will cost, and what noise they will leave. Thread-safety: values.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

namespace fieldtrace {

// Noise is expected to fall as n^-1.5 at best, as fast as what edges leave where samples are nets in two dimensions
// (Wang and He, "On the convergence rate of randomized quasi-Monte Carlo for discontinuous functions", 2015): that is
// what is left in the end, however fast the rest fell.
inline constexpr double k_most_decay = 1.5;

// The power of two that is nearest to n > 0 by ratio.
inline double nearest_power(double n) { return std::exp2(std::nearbyint(std::log2(n))); }

// Of uniform samples, as few of them showed it. Errors are mean squares over pixels and channels.
struct NoiseForecast {
  double samples = 1.0, mean_square = 0.0;    // of each pixel, and the noise that they had left
  double decay = 1.0;                         // it fell as samples^-decay: 1 for random samples, more for stratified
  double work = 1.0, seconds = 0.0;           // of one sample and its rays; of one thread
  double quarter = 0.0, quarter_error = 0.0;  // the noise that a quarter of them left, and its standard error

  double mean_square_of(double n) const { return mean_square * std::pow(samples / n, decay); }
  // Infinite where `error` is not above 0.
  double samples_to(double error) const {
    return error > 0.0 ? samples * std::pow(mean_square / error, 1.0 / decay) : std::numeric_limits<double>::infinity();
  }
  double work_to(double error) const { return std::max(samples_to(error), 1.0) * work; }
};

}  // namespace fieldtrace
