#include "hybrid/sky/parallelogram.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "hybrid/visibility/linear_map.h"

namespace fieldtrace {

// The flat convex hull of a mesh is tried as a parallelogram along two of its first triangle's edges; the
// triangles must have its area and its corners.
std::optional<Parallelogram> parallelogram(const Shape& shape, const ShapeTraits& traits) {
  if (!traits.is_flat || !is_meshed(shape.kind) || shape.mesh.triangles.empty()) return {};
  const std::vector<Vec3>& p = shape.mesh.positions;
  const UVec3& first = shape.mesh.triangles[0];
  double area = 0.0;
  for (const UVec3& t : shape.mesh.triangles) {
    area += 0.5 * glm::length(glm::cross(DVec3(p[t.y]) - DVec3(p[t.x]), DVec3(p[t.z]) - DVec3(p[t.x])));
  }
  for (int k = 0; k < 3; ++k) {
    const DVec3 origin(p[first[k]]), x = DVec3(p[first[(k + 1) % 3]]) - origin,
                                     y = DVec3(p[first[(k + 2) % 3]]) - origin, normal = glm::cross(x, y);
    if (!(glm::length(normal) > 0.0)) return {};
    const DMat3 to_plane = glm::inverse(DMat3(x, y, glm::normalize(normal)));
    DVec3 lower(1e300), upper(-1e300);
    for (const Vec3& v : p) {
      const DVec3 at = to_plane * (DVec3(v) - origin);
      lower = glm::min(lower, at), upper = glm::max(upper, at);
    }
    const double whole = glm::length(normal) * (upper.x - lower.x) * (upper.y - lower.y);
    constexpr double k_error = 1e-5;
    if (upper.z - lower.z > k_error * std::sqrt(whole) || std::abs(area - whole) > k_error * whole) continue;
    // Triangles that cover each other, such as the two faces of a leaf, may have that area, too, but not these corners.
    const auto has_corner = [&](double x_of_corner, double y_of_corner) {
      const auto is_there = [&](uint32_t vertex) {
        const DVec3 at = to_plane * (DVec3(p[vertex]) - origin);
        return std::abs(at.x - x_of_corner) <= k_error * (upper.x - lower.x) &&
               std::abs(at.y - y_of_corner) <= k_error * (upper.y - lower.y);
      };
      return std::any_of(shape.mesh.triangles.begin(), shape.mesh.triangles.end(),
                         [&](const UVec3& t) { return is_there(t.x) || is_there(t.y) || is_there(t.z); });
    };
    if (!has_corner(lower.x, lower.y) || !has_corner(upper.x, lower.y) || !has_corner(lower.x, upper.y) ||
        !has_corner(upper.x, upper.y))
      continue;
    const DVec3 middle = 0.5 * (lower + upper);
    return Parallelogram{
        origin + x * middle.x + y * middle.y,
        DMat3(x * (0.5 * (upper.x - lower.x)), y * (0.5 * (upper.y - lower.y)), glm::normalize(normal))};
  }
  return {};
}

// A shear gives the image of the plane another normal.
Parallelogram in_world(const Parallelogram& object, const Affine& to_world) {
  const DMat3 linear = linear_part(to_world);
  const DVec3 x = linear * object.axes[0], y = linear * object.axes[1];
  return {linear * object.centre + DVec3(to_world[3]), DMat3(x, y, glm::normalize(glm::cross(x, y)))};
}

}  // namespace fieldtrace
