#include "hybrid/visibility/shape_traits.h"

#include <algorithm>
#include <cmath>

#include "core/mesh/mesh_parts.h"
#include "field/store/field.h"

namespace fieldtrace {
namespace {

// Whether the whole shape lies in one plane.
bool is_flat(const Shape& shape) {
  if (shape.kind == ShapeKind::disk || shape.kind == ShapeKind::rectangle) return true;
  if (shape.kind != ShapeKind::mesh || shape.mesh.triangles.empty()) return false;
  const std::vector<Vec3>& p = shape.mesh.positions;
  // The plane of the largest triangle; every vertex must lie in it up to the rounding of the test itself.
  DVec3 normal(0.0);
  double largest = 0.0;
  for (const UVec3& t : shape.mesh.triangles) {
    const DVec3 n = glm::cross(DVec3(p[t.y]) - DVec3(p[t.x]), DVec3(p[t.z]) - DVec3(p[t.x]));
    if (glm::dot(n, n) > largest) {
      largest = glm::dot(n, n);
      normal = n;
    }
  }
  if (largest == 0.0) return true;
  normal = glm::normalize(normal);
  const DVec3 base = DVec3(p[shape.mesh.triangles[0].x]);
  const Vec3 extent = glm::max(glm::abs(shape.bounds.lower), glm::abs(shape.bounds.upper));
  const double slack = double(gamma_bound(1)) * double(glm::length(extent));
  return std::all_of(p.begin(), p.end(),
                     [&](const Vec3& v) { return std::abs(glm::dot(DVec3(v) - base, normal)) <= slack; });
}

bool suits_field(const Shape& shape) {
  if (shape.kind != ShapeKind::mesh || shape.triangle_count() < k_fewest_field_triangles) return false;
  const float size = k_least_part * field_ball(shape.bounds).radius;
  return share_of_small_parts(shape.mesh, size) <= k_most_small_parts;
}

}  // namespace

std::vector<ShapeTraits> shape_traits(const Scene& scene) {
  std::vector<ShapeTraits> traits;
  for (const Shape& shape : scene.shapes) {
    const bool flat = is_flat(shape);
    traits.push_back({flat, !flat && suits_field(shape)});
  }
  return traits;
}

}  // namespace fieldtrace
