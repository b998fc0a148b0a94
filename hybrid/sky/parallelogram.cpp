#include "hybrid/sky/parallelogram.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "field/maps/cell_task.h"
#include "hybrid/visibility/linear_map.h"

namespace fieldtrace {
namespace {

// Of sizes and areas, relative.
constexpr double k_error = 1e-5;

// The axis along which all corners of a triangle have the same coordinate; -1 if there is none, or more than one.
int normal_axis(const Vec3& a, const Vec3& b, const Vec3& c) {
  int axis = -1;
  for (int k = 0; k < 3; ++k) {
    if (a[k] != b[k] || a[k] != c[k]) continue;
    if (axis >= 0) return -1;
    axis = k;
  }
  return axis;
}

bool is_corner(const Bounds3& box, const Vec3& p) {
  for (int k = 0; k < 3; ++k) {
    if (p[k] != box.lower[k] && p[k] != box.upper[k]) return false;
  }
  return true;
}

BoxFaces faces_of(const Bounds3& box) {
  BoxFaces faces;
  const DVec3 centre = 0.5 * (DVec3(box.lower) + DVec3(box.upper)), half = DVec3(box.upper) - centre;
  for (int axis = 0; axis < 3; ++axis) {
    const int b = (axis + 1) % 3, c = (axis + 2) % 3;
    for (int s = 0; s < 2; ++s) {
      DVec3 normal(0.0), x(0.0), y(0.0);
      normal[axis] = s == 0 ? 1.0 : -1.0, x[b] = half[b], y[c] = half[c];
      faces[size_t(2 * axis + s)] = {centre + normal * half[axis], DMat3(x, y, normal)};
    }
  }
  return faces;
}

}  // namespace

std::optional<BoxFaces> box_faces(const Shape& shape, const ShapeTraits& traits) {
  if (traits.is_flat || !is_meshed(shape.kind)) return {};
  const TriangleMesh& mesh = shape.mesh;
  const Bounds3& box = shape.bounds;
  int triangles[6] = {}, missing[6] = {};  // of each face: the exclusive or of the corners that triangles lack
  for (const UVec3& t : mesh.triangles) {
    const Vec3 p[3] = {mesh.positions[t.x], mesh.positions[t.y], mesh.positions[t.z]};
    const int axis = normal_axis(p[0], p[1], p[2]);
    if (axis < 0 || !std::all_of(p, p + 3, [&](const Vec3& v) { return is_corner(box, v); })) return {};
    const int face = 2 * axis + (p[0][axis] == box.upper[axis] ? 0 : 1), b = (axis + 1) % 3, c = (axis + 2) % 3;
    // Of all four corners the exclusive or is 0.
    for (const Vec3& v : p) missing[face] ^= (v[b] == box.upper[b] ? 1 : 0) + (v[c] == box.upper[c] ? 2 : 0);
    triangles[face] += 1;
    for (int k = 0; k < 3 && !mesh.normals.empty(); ++k) {
      if (!(std::abs(glm::normalize(mesh.normals[t[k]])[axis]) >= 1.0 - k_error)) return {};
    }
  }
  // Two halves along a diagonal lack opposite corners.
  for (int face = 0; face < 6; ++face) {
    if (triangles[face] != 2 || missing[face] != 3) return {};
  }
  return faces_of(box);
}

bool lies_in_box(const Scene& scene, const Instance& instance, const Vec3& point) {
  const Bounds3& box = scene.shapes[instance.shape].bounds;
  const Vec3 at = transform_point(instance.to_object, point);
  return glm::all(glm::lessThan(box.lower, at)) && glm::all(glm::lessThan(at, box.upper));
}

PlaneShapes plane_shapes(const Scene& scene, std::span<const ShapeTraits> traits) {
  PlaneShapes result;
  for (size_t s = 0; s < scene.shapes.size(); ++s) {
    result.parallelograms.push_back(parallelogram(scene.shapes[s], traits[s]));
    result.boxes.push_back(box_faces(scene.shapes[s], traits[s]));
  }
  constexpr int k_facing = 3;  // faces of a box that a point sees
  size_t planes = 0;
  for (const Instance& i : scene.instances) {
    planes += result.parallelograms[i.shape] ? 1 : result.boxes[i.shape] ? k_facing : 0;
  }
  if (planes > size_t(k_most_planes) || scene.instances.size() > k_crowd) {
    result.boxes.assign(scene.shapes.size(), std::nullopt);
    return result;
  }
  for (const Instance& i : scene.instances) {
    if (!result.boxes[i.shape]) continue;
    const auto holds = [&](const Vec3& p) { return lies_in_box(scene, i, p); };
    const bool holds_others =
        holds(scene.camera.to_world[3]) ||
        std::any_of(scene.instances.begin(), scene.instances.end(), [&](const Instance& o) {
          return &o != &i && holds(transform_point(o.to_world, scene.shapes[o.shape].bounds.centre()));
        });
    if (holds_others || !(std::abs(glm::determinant(linear_part(i.to_world))) > 0.0)) result.boxes[i.shape].reset();
  }
  return result;
}

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
