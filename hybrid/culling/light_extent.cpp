#include "hybrid/culling/light_extent.h"

#include <algorithm>
#include <cmath>

namespace fieldtrace {
namespace {

// Columns this close to perpendicular keep the bound below within its slack of 2^-10.
constexpr float k_right_angle_cosine = 0x1p-11f;

// Whether the columns are perpendicular: the longest is then how far the transform stretches.
bool keeps_right_angles(const Affine& m) {
  const auto cosine = [&](int i, int j) {
    return std::abs(glm::dot(m[i], m[j])) / (glm::length(m[i]) * glm::length(m[j]));
  };
  return std::max({cosine(0, 1), cosine(1, 2), cosine(2, 0)}) < k_right_angle_cosine;
}

// Radius of the ball about the centre of a flat shape: one that spans [-1, 1] along the first two columns, or the unit
// disk.
float flat_radius(ShapeKind kind, const Affine& m) {
  if (kind == ShapeKind::rectangle) return std::max(glm::length(m[0] + m[1]), glm::length(m[0] - m[1]));
  const float mean = 0.5f * (glm::dot(m[0], m[0]) + glm::dot(m[1], m[1]));
  return std::sqrt(mean + std::hypot(0.5f * (glm::dot(m[0], m[0]) - glm::dot(m[1], m[1])), glm::dot(m[0], m[1])));
}

// Whether a ray towards a light point that faces the shading point meets no other part of the light first: true of
// planes, and of convex shapes that emit outwards. Flipped, a sphere or cylinder hides its inside from shading points
// outside.
bool hides_nothing_of_itself(ShapeKind kind, bool flipped) {
  switch (kind) {
    case ShapeKind::rectangle:
    case ShapeKind::disk:
      return true;
    case ShapeKind::sphere:
    case ShapeKind::cylinder:
      return !flipped;
    case ShapeKind::mesh:
      break;
  }
  return false;
}

}  // namespace

Bounds3 world_bounds(const Bounds3& object_space, const Affine& to_world) {
  Bounds3 result;
  result.extend(to_world, object_space);
  // Rounding of the transform, three products and a sum on each coordinate.
  const Vec3 slack = gamma_bound(4) * glm::max(glm::abs(result.lower), glm::abs(result.upper));
  result.lower -= slack;
  result.upper += slack;
  return result;
}

LightExtent light_extent(const Scene& scene, uint32_t emitter) {
  const Emitter& e = scene.emitters[emitter];
  LightExtent extent;
  switch (e.kind) {
    case EmitterKind::area: {
      if (e.instance == k_none) break;
      const Instance& instance = scene.instances[e.instance];
      const Shape& shape = scene.shapes[instance.shape];
      extent.bounds = world_bounds(shape.bounds, instance.to_world);
      extent.ball = {extent.bounds.centre(), 0.5f * glm::length(extent.bounds.diagonal())};
      if (shape.kind == ShapeKind::sphere && keeps_right_angles(instance.to_world)) {
        const Affine& m = instance.to_world;
        extent.ball.radius = std::max({glm::length(m[0]), glm::length(m[1]), glm::length(m[2])}) * (1.0f + 0x1p-10f);
      }
      if (shape.kind == ShapeKind::disk || shape.kind == ShapeKind::rectangle) {
        const float rounding =
            gamma_bound(8) * glm::length(glm::max(glm::abs(extent.bounds.lower), glm::abs(extent.bounds.upper)));
        const float radius = flat_radius(shape.kind, instance.to_world) * (1.0f + 0x1p-10f) + rounding;
        extent.ball.radius = std::min(extent.ball.radius, radius);
      }
      if (hides_nothing_of_itself(shape.kind, instance.flip_normals)) extent.instance = e.instance;
      break;
    }
    case EmitterKind::point:
      extent.bounds = {e.position, e.position};
      extent.ball = {e.position, 0.0f};
      break;
    case EmitterKind::directional:
      extent.kind = LightExtent::Kind::directional;
      extent.towards = -e.direction;
      break;
    case EmitterKind::constant:
    case EmitterKind::environment:
      extent.kind = LightExtent::Kind::everywhere;
      break;
  }
  return extent;
}

float angular_diameter(const LightExtent& light, const Vec3& point) {
  if (light.kind == LightExtent::Kind::everywhere) return 180.0f;
  if (light.kind == LightExtent::Kind::directional) return 0.0f;
  const float distance = glm::length(light.ball.centre - point);
  if (distance <= light.ball.radius) return 180.0f;
  return 2.0f * std::asin(light.ball.radius / distance) * (180.0f / k_pi);
}

}  // namespace fieldtrace
