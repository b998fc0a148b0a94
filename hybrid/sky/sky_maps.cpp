#include "hybrid/sky/sky_maps.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "field/bake/cell_lines.h"
#include "field/store/field.h"
#include "hybrid/culling/light_extent.h"
#include "hybrid/visibility/linear_map.h"

namespace fieldtrace {
namespace {
// Side of the cubes that large instances are cut into, in radii of an instance.
constexpr float k_place_side = 1.6f;

// World to coordinates in which `origin` is 0 and the columns of `axes` are the unit vectors, both in the space that
// `from_world` leads to.
void write_coordinates(const DAffine& from_world, const DVec3& origin, const DMat3& axes, float out[12]) {
  const DMat3 inverse = glm::inverse(axes);
  for (int column = 0; column < 4; ++column) {
    DVec3 value(from_world[column]);
    if (column == 3) value -= origin;
    value = inverse * value;
    for (int row = 0; row < 3; ++row) out[column * 3 + row] = float(value[row]);
  }
}

// Of the vertices, about the centre of their box.
Sphere tight_ball(const Shape& shape) {
  Sphere ball = field_ball(shape.bounds);
  if (shape.kind != ShapeKind::mesh) return ball;
  float squared = 0.0f;
  for (const Vec3& p : shape.mesh.positions) {
    const Vec3 from = p - ball.centre;
    squared = std::max(squared, glm::dot(from, from));
  }
  ball.radius = std::min(std::sqrt(squared) * (1.0f + gamma_bound(16)), ball.radius);
  return ball;
}

Sphere world_ball(const Instance& instance, const Sphere& ball) {
  return {transform_point(instance.to_world, ball.centre), ball.radius * stretch_bound(linear_part(instance.to_world))};
}

// Whether shading normals of a flat mesh are not its plane's, but for rounding.
bool is_bent(const TriangleMesh& mesh) {
  constexpr float k_rounding = 1e-5f;
  for (const UVec3& t : mesh.triangles) {
    const Vec3 a = mesh.positions[t.x], n = glm::cross(mesh.positions[t.y] - a, mesh.positions[t.z] - a);
    if (!(glm::length(n) > 0.0f)) continue;
    const Vec3 plane = glm::normalize(n);
    return std::any_of(mesh.normals.begin(), mesh.normals.end(), [&](const Vec3& normal) {
      return std::abs(glm::dot(glm::normalize(normal), plane)) < 1.0f - k_rounding;
    });
  }
  return false;
}

// A flat shape's plane, in object space.
struct ShapePlane {
  DVec3 point = DVec3(0.0), x = DVec3(1.0, 0.0, 0.0), y = DVec3(0.0, 1.0, 0.0);  // x and y lie in it
};

// That of the largest triangle; of disks and rectangles the plane z = 0.
ShapePlane plane_of(const Shape& shape) {
  ShapePlane plane;
  double largest = -1.0;
  for (const UVec3& t : shape.mesh.triangles) {
    const DVec3 point(shape.mesh.positions[t.x]);
    const DVec3 x = DVec3(shape.mesh.positions[t.y]) - point, y = DVec3(shape.mesh.positions[t.z]) - point;
    const double area = glm::length(glm::cross(x, y));
    if (area > largest) largest = area, plane = {point, x, y};
  }
  return plane;
}

void write_height(const ShapePlane& plane, const Affine& to_world, float height[4]) {
  const DMat3 linear = linear_part(to_world);
  const DVec3 n = glm::cross(linear * plane.x, linear * plane.y);
  if (!(glm::length(n) > 0.0)) return;
  const DVec3 unit = glm::normalize(n);
  for (int a = 0; a < 3; ++a) height[a] = float(unit[a]);
  height[3] = float(-glm::dot(unit, linear * plane.point + DVec3(to_world[3])));
}

// The lower one of two; infinite of none.
float median(std::vector<float> values) {
  if (values.empty()) return k_infinity;
  const auto middle = values.begin() + ptrdiff_t((values.size() - 1) / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

SkyMaps::SkyMaps(const Scene& scene, std::span<const ShapeTraits> traits, MappedShapes shapes,
                 std::vector<std::shared_ptr<DirectionMaps>> maps, int directions, const SkyTolerance& tolerance)
    : shapes_(std::move(shapes)),
      maps_(std::move(maps)),
      directions_(directions),
      tolerance_(tolerance),
      occluders_(scene.instances.size()) {
  frames_.reserve(size_t(directions) * size_t(directions));
  for (int i = 0; i < directions * directions; ++i) {
    const CellFrame f = cell_frame(i / directions, i % directions, directions);
    frames_.push_back(Mat3(f.s, f.t, f.c));
  }
  const bool crowd = scene.instances.size() > k_crowd;
  std::vector<Sphere> balls;
  for (const Shape& shape : scene.shapes) balls.push_back(tight_ball(shape));
  std::vector<uint8_t> bent;
  for (size_t s = 0; s < scene.shapes.size(); ++s) bent.push_back(traits[s].is_flat && is_bent(scene.shapes[s].mesh));
  const PlaneShapes planes = plane_shapes(scene, traits);
  std::vector<ShapePlane> flat;  // by shape, of those that are
  for (size_t s = 0; s < scene.shapes.size(); ++s) {
    flat.push_back(traits[s].is_flat ? plane_of(scene.shapes[s]) : ShapePlane());
  }
  for (uint32_t i = 0; i < occluders_.size(); ++i) {
    const Instance& instance = scene.instances[i];
    SkyOccluder& o = occluders_[i];
    o.instance = i;
    o.is_flat = traits[instance.shape].is_flat;
    o.is_bent = bent[instance.shape] != 0;
    o.ball = world_ball(instance, balls[instance.shape]);
    if (o.is_flat) write_height(flat[instance.shape], instance.to_world, o.height);
    if (const auto& plane = planes.parallelograms[instance.shape]) {
      o.kind = SkyOccluder::Kind::plane;
      const Parallelogram here = in_world(*plane, instance.to_world);
      write_coordinates(DAffine(1.0), here.centre, here.axes, o.to_unit);
      continue;
    }
    if (planes.boxes[instance.shape]) {
      o.kind = SkyOccluder::Kind::box;
      const Bounds3& box = scene.shapes[instance.shape].bounds;
      const DVec3 centre = 0.5 * (DVec3(box.lower) + DVec3(box.upper)), half = DVec3(box.upper) - centre;
      const DMat3 linear = linear_part(instance.to_world);
      write_coordinates(DAffine(1.0), linear * centre + DVec3(instance.to_world[3]),
                        DMat3(linear[0] * half.x, linear[1] * half.y, linear[2] * half.z), o.to_unit);
      continue;
    }
    const uint32_t mapped = shapes_.of_instance[i];
    if (mapped == k_none) continue;
    const Sphere& ball = shapes_.shapes[mapped].ball;
    const DMat3 stretch = shapes_.shapes[mapped].stretch;
    const DAffine to_object(instance.to_object);
    const DAffine to_stretched(stretch * to_object[0], stretch * to_object[1], stretch * to_object[2],
                               stretch * to_object[3]);
    write_coordinates(to_stretched, DVec3(ball.centre), DMat3(double(ball.radius)), o.to_unit);
    o.kind = SkyOccluder::Kind::map;
    o.view = maps_[mapped]->view();
    const DMat3 to_unit = linear_part(o.to_unit);
    o.half_map = float(1.0 / std::cbrt(std::abs(glm::determinant(to_unit))));
    if (o.half_map < o.ball.radius) {
      o.ball = {Vec3(glm::inverse(to_unit) * -DVec3(o.to_unit[9], o.to_unit[10], o.to_unit[11])), o.half_map};
    }
    // Rows of a rotation are the columns of its inverse.
    const DMat3 rotation = glm::transpose(to_unit) / std::cbrt(std::abs(glm::determinant(to_unit)));
    o.grid = Mat3(rotation);
    if (!crowd) o.cells = o.grid;
  }
  std::vector<float> radii, of_objects;
  for (const SkyOccluder& o : occluders_) {
    radii.push_back(o.ball.radius);
    if (o.kind != SkyOccluder::Kind::plane) of_objects.push_back(o.ball.radius);
  }
  median_radius_ = median(of_objects.empty() ? radii : of_objects);
  if (!crowd) return;
  groups_ = OccluderGroups(scene, occluders_, directions);
  divide_cells();
  place_side_ = k_place_side * median(radii);
}

void SkyMaps::divide_cells() {
  float least = 1.0f;
  for (int cell = 0; cell < directions_ * directions_; ++cell) {
    Vec3 parts[k_part_block], sum(0.0f);
    for (int k = 0; k < k_part_block; ++k) {
      const float x = (float(k / k_group_parts) + 0.5f) / float(k_group_parts);
      const float y = (float(k % k_group_parts) + 0.5f) / float(k_group_parts);
      parts[k] = direction_in_cell(cell / directions_, cell % directions_, x, y, directions_);
      sum += parts[k];
    }
    const Vec3 middle = glm::normalize(sum);
    middle_x_.push_back(middle.x), middle_y_.push_back(middle.y), middle_z_.push_back(middle.z);
    for (const Vec3& d : parts) {
      least = std::min(least, glm::dot(d, middle));
      part_x_.push_back(d.x), part_y_.push_back(d.y), part_z_.push_back(d.z);
    }
  }
  constexpr float k_rounding = 1e-4f;
  grid_ = {cell_width(), cell_width() / float(k_group_parts), std::acos(least) + k_rounding};
}

PartDirections SkyMaps::parts() const {
  return {part_x_.data(),   part_y_.data(),   part_z_.data(),           middle_x_.data(),
          middle_y_.data(), middle_z_.data(), int32_t(middle_x_.size())};
}

Sphere SkyMaps::place(uint32_t instance, const Vec3& point) const {
  const Sphere& ball = occluders_[instance].ball;
  if (!is_crowd()) return ball;
  const float radius = 0.5f * std::sqrt(3.0f) * place_side_;
  if (ball.radius <= radius) return ball;
  return {(glm::floor(point / place_side_) + 0.5f) * place_side_, radius};
}

void SkyMaps::find(const Sphere& place, const Vec3& from, float distance, std::vector<uint32_t>& near,
                   std::vector<GroupLobe>& far) const {
  if (is_crowd()) {
    groups_.find(place, from, grid_, distance, near, far);
    return;
  }
  near.resize(occluders_.size());
  std::iota(near.begin(), near.end(), 0u);
  far.clear();
}

uint64_t SkyMaps::bytes() const {
  uint64_t bytes = groups_.bytes();
  for (const auto& maps : maps_) bytes += maps ? maps->bytes() : 0;
  return bytes;
}

}  // namespace fieldtrace
