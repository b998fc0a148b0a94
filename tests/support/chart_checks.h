// What the property tests of every chart have in common: conversions, difficult directions, and how cells fill their
// map.
//
// Thread-safety: pure functions.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "core/math/math.h"
#include "core/simd/lanes.hd.h"

namespace fieldtrace::test {

using Lanes3 = scalar::Vec3Lanes<float>;

inline Lanes3 lanes(const Vec3& v) { return {v.x, v.y, v.z}; }
inline DVec3 exact(const Lanes3& v) { return {v.x, v.y, v.z}; }

// Angle between two vectors, in radians.
inline double angle(const DVec3& a, const DVec3& b) {
  return std::atan2(glm::length(glm::cross(a, b)), glm::dot(a, b));
}

// The spacing of floats at a vector's length.
inline double ulp_of(const Vec3& v) { return std::ldexp(1.0, std::ilogb(glm::length(v)) - 23); }

// Error of a round trip between a direction and its map: the series are off by 8e-7 rad at most, and each way rounds a
// dozen times by 2^-24; the sum stays below this.
inline constexpr double k_round_trip_bound = 2e-6;

// Directions where the maps fold or divide by small numbers: poles, axes, seams, tiny and denormal components.
inline std::vector<Vec3> special_directions() {
  std::vector<Vec3> all;
  const std::array<float, 9> tiny = {0.0f, -0.0f, 1e-45f, 1e-40f, 1e-38f, 1e-30f, 1e-20f, 1e-10f, 1e-4f};
  for (int axis = 0; axis < 3; ++axis) {
    for (const float sign : {1.0f, -1.0f}) {
      for (const float a : tiny) {
        for (const float b : tiny) {
          for (const float flip : {1.0f, -1.0f}) {
            Vec3 d(0.0f);
            d[axis] = sign;  // 1 + 1e-8 rounds to 1, so that these are unit
            d[(axis + 1) % 3] = a * flip;
            d[(axis + 2) % 3] = b;
            all.push_back(d);
          }
        }
      }
    }
  }
  const float h = 0.70710678f;
  for (const float x : {h, -h}) {
    for (const float y : {h, -h}) {
      all.insert(all.end(), {Vec3(x, y, 0.0f), Vec3(x, y, -0.0f), Vec3(x, 0.0f, y), Vec3(0.0f, x, y)});
    }
  }
  return all;
}

// The border of cell (i, j) of an n x n square [-1, 1]^2 as a closed polygon of 4 * `steps` points, counterclockwise
// from the cell's lower corner, which is repeated at the end. `map(u, v)`: the point of the map.
template <class Map>
std::vector<DVec3> cell_border(int i, int j, int n, int steps, const Map& map) {
  std::vector<DVec3> points;
  for (int s = 0; s <= 4 * steps; ++s) {
    const double x = double(s % steps) / steps;
    const int side = s / steps % 4;
    const auto [du, dv] = side == 0   ? std::pair(x, 0.0)
                          : side == 1 ? std::pair(1.0, x)
                          : side == 2 ? std::pair(1.0 - x, 1.0)
                                      : std::pair(0.0, 1.0 - x);
    points.push_back(map(float((i + du) * 2.0 / n - 1.0), float((j + dv) * 2.0 / n - 1.0)));
  }
  return points;
}

// Expects counts of equally likely cells, `per_cell` on average, to vary neither more nor less than chance: chi-square
// within 5 standard deviations.
inline void expect_even(const std::vector<int>& counts, int per_cell) {
  double chi2 = 0.0;
  for (const int c : counts) chi2 += double(c - per_cell) * double(c - per_cell) / per_cell;
  const double freedom = double(counts.size()) - 1.0;
  EXPECT_LT(std::abs(chi2 - freedom), 5.0 * std::sqrt(2.0 * freedom));
}

// Deviation from a right-handed orthonormal frame: the largest error of a length, an angle or the product.
inline double frame_error(const DVec3& x, const DVec3& y, const DVec3& z) {
  return std::max({std::abs(glm::dot(x, x) - 1.0), std::abs(glm::dot(y, y) - 1.0), std::abs(glm::dot(z, z) - 1.0),
                   std::abs(glm::dot(x, y)), std::abs(glm::dot(x, z)), std::abs(glm::dot(y, z)),
                   glm::length(glm::cross(x, y) - z)});
}

}  // namespace fieldtrace::test
