#include "hybrid/sky/sky_maps.h"

#include <cmath>

#include "field/bake/cell_lines.h"
#include "field/store/field.h"
#include "hybrid/visibility/light_extent.h"
#include "hybrid/visibility/linear_map.h"

namespace fieldtrace {
namespace {

// World to coordinates in which `origin` is 0 and the columns of `axes` are the unit vectors, both in the space that
// `from_world` leads to.
void write_coordinates(const Affine& from_world, const DVec3& origin, const DMat3& axes, float out[12]) {
  const DMat3 inverse = glm::inverse(axes);
  for (int column = 0; column < 4; ++column) {
    DVec3 value(from_world[column]);
    if (column == 3) value -= origin;
    value = inverse * value;
    for (int row = 0; row < 3; ++row) out[column * 3 + row] = float(value[row]);
  }
}

Sphere world_ball(const Instance& instance, const Sphere& ball) {
  const DMat3 to_world(DVec3(instance.to_world[0]), DVec3(instance.to_world[1]), DVec3(instance.to_world[2]));
  return {transform_point(instance.to_world, ball.centre), ball.radius * stretch_bound(to_world)};
}

}  // namespace

// The flat convex hull of a mesh is tried as a parallelogram along two of its first triangle's edges; the
// triangles must have its area.
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
    const DVec3 middle = 0.5 * (lower + upper);
    return Parallelogram{
        origin + x * middle.x + y * middle.y,
        DMat3(x * (0.5 * (upper.x - lower.x)), y * (0.5 * (upper.y - lower.y)), glm::normalize(normal))};
  }
  return {};
}

SkyMaps::SkyMaps(const Scene& scene, std::span<const ShapeTraits> traits,
                 std::vector<std::unique_ptr<DirectionMaps>> shapes, int directions, const SkyTolerance& tolerance)
    : shapes_(std::move(shapes)), directions_(directions), tolerance_(tolerance), occluders_(scene.instances.size()) {
  frames_.reserve(size_t(directions) * size_t(directions));
  for (int i = 0; i < directions * directions; ++i) {
    const CellFrame f = cell_frame(i / directions, i % directions, directions);
    frames_.push_back(Mat3(f.s, f.t, f.c));
  }
  std::vector<std::optional<Parallelogram>> planes;  // by shape, as many instances may share one
  for (size_t s = 0; s < scene.shapes.size(); ++s) planes.push_back(parallelogram(scene.shapes[s], traits[s]));
  for (uint32_t i = 0; i < occluders_.size(); ++i) {
    const Instance& instance = scene.instances[i];
    const Shape& shape = scene.shapes[instance.shape];
    SkyOccluder& o = occluders_[i];
    o.instance = i;
    o.is_flat = traits[instance.shape].is_flat;
    o.ball = world_ball(instance, field_ball(shape.bounds));
    if (const auto& plane = planes[instance.shape]) {
      o.kind = SkyOccluder::Kind::plane;
      // In world space: a shear gives the image of the plane another normal.
      const DAffine to_world(instance.to_world);
      const DMat3 linear(to_world[0], to_world[1], to_world[2]);
      const DVec3 x = linear * plane->axes[0], y = linear * plane->axes[1];
      const DMat3 axes(x, y, glm::normalize(glm::cross(x, y)));
      write_coordinates(Affine(1.0f), linear * plane->centre + to_world[3], axes, o.to_unit);
      continue;
    }
    const DirectionMaps* const maps = shapes_[instance.shape].get();
    if (!maps) continue;
    const double radius = double(maps->ball().radius);
    write_coordinates(instance.to_object, DVec3(maps->ball().centre), DMat3(radius), o.to_unit);
    const DMat3 to_unit = linear_part(o.to_unit);
    if (!keeps_angles(to_unit)) continue;
    o.kind = SkyOccluder::Kind::map;
    o.view = maps->view();
    // Rows of a rotation are the columns of its inverse.
    const DMat3 rotation = glm::transpose(to_unit) / std::cbrt(std::abs(glm::determinant(to_unit)));
    o.grid = Mat3(rotation);
  }
}

uint64_t SkyMaps::bytes() const {
  uint64_t bytes = 0;
  for (const auto& maps : shapes_) bytes += maps ? maps->bytes() : 0;
  return bytes;
}

}  // namespace fieldtrace
