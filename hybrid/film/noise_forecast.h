// What further camera samples of a picture will cost, and what noise they will leave. Thread-safety: values.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

namespace fieldtrace {

// How much faster than that of random samples noise may be expected to fall (SampleAllocation::decay()).
inline constexpr double k_most_decay = 2.0;

// What edges leave falls as n^-1.5 where samples are nets in two dimensions (Wang and He, "On the convergence rate of
// randomized quasi-Monte Carlo for discontinuous functions", 2015); they are what is left in the end.
inline constexpr double k_edge_decay = 1.5;

// The decay to expect of further samples, where it was `decay` so far.
inline double later_decay(double decay) { return decay > k_edge_decay ? 0.5 * (decay + k_edge_decay) : decay; }

// The power of two that is nearest to n > 0 by ratio.
inline double nearest_power(double n) { return std::exp2(std::nearbyint(std::log2(n))); }

// Of uniform samples, as few of them showed it. Errors are mean squares over pixels and channels.
struct NoiseForecast {
  double samples = 1.0, mean_square = 0.0;    // of each pixel, and the noise that they had left
  double decay = 1.0;                         // it fell as samples^-decay: 1 for random samples, more for stratified
  double work = 1.0, seconds = 0.0;           // of one sample and its rays; of one thread
  double quarter = 0.0, quarter_error = 0.0;  // the noise that a quarter of them left, and its standard error

  double mean_square_of(double n) const { return mean_square * std::pow(samples / n, later_decay(decay)); }
  // Infinite where `error` is not above 0.
  double samples_to(double error) const {
    return error > 0.0 ? samples * std::pow(mean_square / error, 1.0 / later_decay(decay))
                       : std::numeric_limits<double>::infinity();
  }
  double work_to(double error) const { return std::max(samples_to(error), 1.0) * work; }
};

}  // namespace fieldtrace
