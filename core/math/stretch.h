// How much linear maps lengthen vectors. Pure functions.
#pragma once

#include <algorithm>
#include <cmath>

#include "core/math/math.h"

namespace fieldtrace {

// The largest singular value: the root of the largest eigenvalue of m^T m, in trigonometric form (O. K. Smith,
// "Eigenvalues of a symmetric 3 x 3 matrix", CACM 4(4), 1961).
inline double largest_stretch(const DMat3& m) {
  const DMat3 square = glm::transpose(m) * m;
  const double mean = (square[0][0] + square[1][1] + square[2][2]) / 3;
  DMat3 rest = square;
  double sum = 0;
  for (int i = 0; i < 3; ++i) {
    rest[i][i] -= mean;
    sum += glm::dot(rest[i], rest[i]);
  }
  const double spread = std::sqrt(sum / 6);
  if (!(spread > 0)) return std::sqrt(mean);
  const double cosine = std::clamp(glm::determinant(rest / spread) / 2, -1.0, 1.0);
  return std::sqrt(mean + 2 * spread * std::cos(std::acos(cosine) / 3));
}

}  // namespace fieldtrace
