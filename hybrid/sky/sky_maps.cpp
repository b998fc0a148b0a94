#include "hybrid/sky/sky_maps.h"

#include <cmath>

#include "core/simd/vec_lanes.h"
#include "field/bake/cell_lines.h"
#include "field/chart/chart.hd.h"
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

// The parallelogram that an instance is, in world space: its centre, half axes, and their normal, which a shear makes
// another one than the shape's. False for other shapes.
bool parallelogram(const Shape& shape, const DAffine& to_world, DVec3& centre, DMat3& axes) {
  if (!is_meshed(shape.kind) || shape.mesh.triangles.size() != 2) return false;
  const auto& triangles = shape.mesh.triangles;
  const auto vertex = [&](int t, int k) { return DVec3(shape.mesh.positions[triangles[size_t(t)][k]]); };
  // The corners of the first triangle off the shared edge, and of the second.
  for (int k = 0; k < 3; ++k) {
    const DVec3 apex = vertex(0, k), a = vertex(0, (k + 1) % 3), b = vertex(0, (k + 2) % 3);
    const double scale = glm::length(a - apex) + glm::length(b - apex), error = 1e-6 * scale;
    for (int j = 0; j < 3; ++j) {
      const DVec3 other = vertex(1, j), c = vertex(1, (j + 1) % 3), d = vertex(1, (j + 2) % 3);
      const bool shares = (glm::length(c - a) < error && glm::length(d - b) < error) ||
                          (glm::length(c - b) < error && glm::length(d - a) < error);
      if (!shares || !(glm::length(apex + other - a - b) < error)) continue;
      const DMat3 linear(to_world[0], to_world[1], to_world[2]);
      centre = linear * (0.5 * (a + b)) + to_world[3];
      const DVec3 x = linear * (0.5 * (a - apex)), y = linear * (0.5 * (b - apex)), z = glm::cross(x, y);
      if (!(glm::length(z) > 0.0)) return false;
      axes = DMat3(x, y, glm::normalize(z));
      return true;
    }
  }
  return false;
}

Sphere world_ball(const Instance& instance, const Sphere& ball) {
  const DMat3 to_world(DVec3(instance.to_world[0]), DVec3(instance.to_world[1]), DVec3(instance.to_world[2]));
  return {transform_point(instance.to_world, ball.centre), ball.radius * stretch_bound(to_world)};
}

}  // namespace

SkyMaps::SkyMaps(const Scene& scene, std::span<const ShapeTraits> traits,
                 std::vector<std::unique_ptr<DirectionMaps>> shapes, int directions, const SkyTolerance& tolerance)
    : shapes_(std::move(shapes)),
      directions_(directions),
      tolerance_(tolerance),
      radiance_(scene),
      occluders_(scene.instances.size()),
      world_cells_(radiance_.cells(Mat3(1.0f), directions)),
      grids_(scene.instances.size()) {
  frames_.reserve(size_t(directions) * size_t(directions));
  for (int i = 0; i < directions * directions; ++i) {
    const CellFrame f = cell_frame(i / directions, i % directions, directions);
    frames_.push_back(Mat3(f.s, f.t, f.c));
  }
  for (uint32_t i = 0; i < occluders_.size(); ++i) {
    const Instance& instance = scene.instances[i];
    const Shape& shape = scene.shapes[instance.shape];
    SkyOccluder& o = occluders_[i];
    o.instance = i;
    o.is_flat = traits[instance.shape].is_flat;
    o.ball = world_ball(instance, field_ball(shape.bounds));
    DVec3 centre;
    DMat3 axes;
    if (parallelogram(shape, DAffine(instance.to_world), centre, axes)) {
      o.kind = SkyOccluder::Kind::plane;
      write_coordinates(Affine(1.0f), centre, axes, o.to_unit);
      continue;
    }
    o.kind = SkyOccluder::Kind::ball;
    const DirectionMaps* const maps = shapes_[instance.shape].get();
    if (!maps) continue;
    const double radius = double(maps->ball().radius);
    write_coordinates(instance.to_object, DVec3(maps->ball().centre), DMat3(radius), o.to_unit);
    const DMat3 to_unit = linear_part(o.to_unit);
    o.keeps_angles = keeps_angles(to_unit);
    if (!o.keeps_angles) continue;
    o.kind = SkyOccluder::Kind::map;
    o.maps = maps;
    o.view = maps->view();
    // Rows of a rotation are the columns of its inverse.
    const DMat3 rotation = glm::transpose(to_unit) / std::cbrt(std::abs(glm::determinant(to_unit)));
    o.grid = Mat3(rotation);
  }
}

bool SkyMaps::has_own_grid(uint32_t instance) const { return occluders_[instance].kind == SkyOccluder::Kind::map; }

const Mat3& SkyMaps::grid_of(uint32_t instance) const { return occluders_[instance].grid; }

const SkyCells& SkyMaps::cells_of(uint32_t instance) const {
  if (!has_own_grid(instance)) return world_cells_;
  Grid& grid = grids_[instance];
  std::call_once(grid.once, [&] { grid.cells = radiance_.cells(occluders_[instance].grid, directions_); });
  return grid.cells;
}

int SkyMaps::cell_at(const Vec3& direction) const {
  scalar::CellAddress<float> cell;
  scalar::find_direction_cell(lanes(direction), make_axis(directions_), cell);
  return cell.u * directions_ + cell.v;
}

uint64_t SkyMaps::bytes() const {
  uint64_t bytes = 0;
  for (const auto& maps : shapes_) bytes += maps ? maps->bytes() : 0;
  return bytes;
}

}  // namespace fieldtrace
