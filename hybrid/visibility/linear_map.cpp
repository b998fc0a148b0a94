#include "hybrid/visibility/linear_map.h"

#include <algorithm>
#include <cmath>

namespace fieldtrace {

DMat3 linear_part(const float m[12]) {
  return {DVec3(m[0], m[1], m[2]), DVec3(m[3], m[4], m[5]), DVec3(m[6], m[7], m[8])};
}

float stretch_bound(const DMat3& a) {
  const DVec3 diagonal(glm::dot(a[0], a[0]), glm::dot(a[1], a[1]), glm::dot(a[2], a[2]));
  const DVec3 beside(glm::dot(a[0], a[1]), glm::dot(a[1], a[2]), glm::dot(a[2], a[0]));
  const double mean = (diagonal.x + diagonal.y + diagonal.z) / 3.0;
  const DVec3 d = diagonal - DVec3(mean);
  const double p = std::sqrt((glm::dot(d, d) + 2.0 * glm::dot(beside, beside)) / 6.0);
  double largest = mean;
  if (p > 0.0) {
    const DVec3 b = d / p, c = beside / p;
    const double half_determinant =
        0.5 * (b.x * (b.y * b.z - c.y * c.y) - c.x * (c.x * b.z - c.y * c.z) + c.z * (c.x * c.y - b.y * c.z));
    largest = mean + 2.0 * p * std::cos(std::acos(std::clamp(half_determinant, -1.0, 1.0)) / 3.0);
  }
  return float(std::sqrt(largest) * (1.0 + k_stretch_slack));
}

// Areas are the lengths of the cofactor matrix' images.
float area_bound(const DMat3& a) {
  return stretch_bound({glm::cross(a[1], a[2]), glm::cross(a[2], a[0]), glm::cross(a[0], a[1])});
}

bool keeps_angles(const DMat3& a) {
  const double square = glm::dot(a[0], a[0]), slack = k_stretch_slack * square;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j <= i; ++j) {
      if (std::abs(glm::dot(a[i], a[j]) - (i == j ? square : 0.0)) > slack) return false;
    }
  }
  return true;
}

double angle_stretch(const DMat3& a, const DVec3& direction) {
  const double shorter = glm::length(direction) / glm::length(a * direction);
  return std::sqrt(std::abs(glm::determinant(a)) * shorter * shorter * shorter);
}

}  // namespace fieldtrace
