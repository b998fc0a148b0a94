#include "hybrid/visibility/linear_map.h"

#include <cmath>

#include "core/math/stretch.h"

namespace fieldtrace {

DMat3 linear_part(const float* m) {
  return {DVec3(m[0], m[1], m[2]), DVec3(m[3], m[4], m[5]), DVec3(m[6], m[7], m[8])};
}

float stretch_bound(const DMat3& a) { return float(largest_stretch(a) * (1.0 + k_stretch_slack)); }

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

std::optional<DMat3> stretch_of(const DMat3& a) {
  const auto norm = [](const DMat3& m) {
    return std::sqrt(glm::dot(m[0], m[0]) + glm::dot(m[1], m[1]) + glm::dot(m[2], m[2]));
  };
  constexpr double k_singular = 1e-18, k_precision = 1e-13;  // the former of the determinant, relative
  constexpr int k_most_steps = 100;
  const double size = norm(a);
  if (!(std::abs(glm::determinant(a)) > k_singular * size * size * size)) return {};
  DMat3 rotation = a;
  for (int step = 0; step < k_most_steps; ++step) {
    const DMat3 inverse = glm::transpose(glm::inverse(rotation));
    const double scale = std::sqrt(norm(inverse) / norm(rotation));
    const DMat3 next = 0.5 * (scale * rotation + inverse / scale);
    const double change = norm(next - rotation);
    rotation = next;
    if (change <= k_precision * norm(rotation)) break;
  }
  const DMat3 stretch = glm::transpose(rotation) * a;
  return 0.5 * (stretch + glm::transpose(stretch)) / std::cbrt(std::abs(glm::determinant(a)));
}

double angle_stretch(const DMat3& a, const DVec3& direction) {
  const double shorter = glm::length(direction) / glm::length(a * direction);
  return std::sqrt(std::abs(glm::determinant(a)) * shorter * shorter * shorter);
}

}  // namespace fieldtrace
