// Weights of samples that two strategies could have made (E. Veach, L. Guibas, "Optimally Combining Sampling Techniques
// for Monte Carlo Rendering", SIGGRAPH 1995). Thread-safety: pure functions.
#pragma once

namespace fieldtrace {

// Of a sample of the density `density` that the other strategy makes with the density `other`, by the power heuristic;
// both include their numbers of samples.
inline float power_heuristic(float density, float other) {
  // The quotient first: squares of the densities of tiny lights overflow.
  const float ratio = other / density;
  return 1.0f / (1.0f + ratio * ratio);
}

}  // namespace fieldtrace
