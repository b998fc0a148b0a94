#include "core/light/light_irradiance.h"

#include <cmath>

namespace fieldtrace {
namespace {

DVec3 vec(const float (&v)[3]) { return {v[0], v[1], v[2]}; }

std::optional<float> of_sphere(const Light& light, const DVec3& point, const DVec3& geometric, const DVec3& shading) {
  const DVec3 to_centre = vec(light.centre) - point;
  const double squared = glm::dot(to_centre, to_centre), radius = double(light.radius);
  const double height = glm::dot(shading, to_centre);
  if (!(squared > radius * radius) || !(height > radius) || !(glm::dot(geometric, to_centre) > radius)) return {};
  return float(double(k_pi) * radius * radius * height / (squared * std::sqrt(squared)));
}

std::optional<float> of_rectangle(const Light& light, const DVec3& point, const DVec3& geometric,
                                  const DVec3& shading) {
  const DVec3 centre = vec(light.centre) - point, x = vec(light.axis[0]), y = vec(light.axis[1]);
  if (!(glm::dot(vec(light.normal), centre) < 0.0)) return {};  // behind the light
  DVec3 corner[4] = {centre - x - y, centre + x - y, centre + x + y, centre - x + y};
  for (DVec3& c : corner) {
    if (!(glm::dot(shading, c) > 0.0) || !(glm::dot(geometric, c) > 0.0)) return {};
    c = glm::normalize(c);
  }
  double sum = 0.0;
  for (int i = 0; i < 4; ++i) {
    const DVec3 cross = glm::cross(corner[i], corner[(i + 1) % 4]);
    const double sine = glm::length(cross);
    if (!(sine > 0.0)) return {};
    sum += std::atan2(sine, glm::dot(corner[i], corner[(i + 1) % 4])) / sine * glm::dot(cross, shading);
  }
  return float(0.5 * std::abs(sum));
}

}  // namespace

std::optional<float> whole_irradiance(const Light& light, const Vec3& point, const Vec3& geometric,
                                      const Vec3& shading) {
  switch (light.kind) {
    case LightKind::sphere:
      return of_sphere(light, DVec3(point), DVec3(geometric), DVec3(shading));
    case LightKind::rectangle:
      return of_rectangle(light, DVec3(point), DVec3(geometric), DVec3(shading));
    default:
      return {};
  }
}

}  // namespace fieldtrace
