// Chi-square goodness of fit of counts over the unit sphere of directions.
#pragma once

#include <cmath>
#include <functional>
#include <vector>

#include "core/math/math.h"

namespace fieldtrace::test {

// Deviation of the statistic from its mean in standard deviations (Wilson and Hilferty, "The Distribution of
// Chi-Square", PNAS 17, 1931). Cells that expect fewer than 5 counts are pooled.
inline double chi_square_deviation(const std::vector<double>& observed, const std::vector<double>& expected) {
  double statistic = 0.0, pooled_observed = 0.0, pooled_expected = 0.0;
  int cells = 0;
  for (size_t i = 0; i < observed.size(); ++i) {
    if (expected[i] < 5.0) {
      pooled_observed += observed[i];
      pooled_expected += expected[i];
      continue;
    }
    statistic += (observed[i] - expected[i]) * (observed[i] - expected[i]) / expected[i];
    ++cells;
  }
  if (pooled_expected >= 5.0) {
    statistic += (pooled_observed - pooled_expected) * (pooled_observed - pooled_expected) / pooled_expected;
    ++cells;
  } else if (pooled_observed > 5.0 + 5.0 * std::sqrt(5.0)) {
    return 100.0;  // samples in cells that expect none
  }
  const double k = std::max(cells - 1, 1);
  return (std::cbrt(statistic / k) - (1.0 - 2.0 / (9.0 * k))) / std::sqrt(2.0 / (9.0 * k));
}

// Cells of equal solid angle: rows in z from -1 to 1, columns in azimuth.
struct SphereHistogram {
  int rows = 32, columns = 32;
  std::vector<double> cells = std::vector<double>(size_t(rows) * columns, 0.0);

  void add(const Vec3& w) {
    const int row = std::min(int(0.5 * (double(w.z) + 1.0) * rows), rows - 1);
    const double turn = std::atan2(w.y, w.x) / (2.0 * 3.14159265358979) + 0.5;
    cells[size_t(row) * columns + std::min(int(turn * columns), columns - 1)] += 1.0;
  }

  // Integrates a solid-angle density over each cell with n x n midpoints and multiplies by `count`.
  void integrate(const std::function<double(const Vec3&)>& density, double count, int n) {
    const double cell = 4.0 * 3.14159265358979 / (double(rows) * columns);
    for (int row = 0; row < rows; ++row) {
      for (int column = 0; column < columns; ++column) {
        double sum = 0.0;
        for (int i = 0; i < n * n; ++i) {
          const double z = 2.0 * (row + (i / n + 0.5) / n) / rows - 1.0;
          const double phi = 2.0 * 3.14159265358979 * ((column + (i % n + 0.5) / n) / columns - 0.5);
          const double r = std::sqrt(std::max(1.0 - z * z, 0.0));
          sum += density(Vec3(float(r * std::cos(phi)), float(r * std::sin(phi)), float(z)));
        }
        cells[size_t(row) * columns + column] = count * cell * sum / (n * n);
      }
    }
  }
};

}  // namespace fieldtrace::test
