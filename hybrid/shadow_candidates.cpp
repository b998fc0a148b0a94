#include "hybrid/shadow_candidates.h"

#include <algorithm>

namespace fieldtrace {
namespace {

Bounds3 transformed_bounds(const Bounds3& b, const Affine& to_world) {
  Bounds3 result;
  for (int c = 0; c < 8; ++c) result.extend(transform_point(to_world, b.corner(c)));
  // Rounding of the transform, three products and a sum on each coordinate.
  const Vec3 slack = gamma_bound(4) * glm::max(glm::abs(result.lower), glm::abs(result.upper));
  result.lower -= slack;
  result.upper += slack;
  return result;
}

bool overlap(const Bounds3& a, const Bounds3& b) {
  return glm::all(glm::lessThanEqual(a.lower, b.upper)) && glm::all(glm::lessThanEqual(b.lower, a.upper));
}

// Columns this near to perpendicular leave the bound below within its slack of 2^-10.
constexpr float k_right_angle_cosine = 0x1p-11f;

// Whether the columns are perpendicular: then the longest is how far the transform stretches.
bool keeps_right_angles(const Affine& m) {
  const auto cosine = [&](int i, int j) {
    return std::abs(glm::dot(m[i], m[j])) / (glm::length(m[i]) * glm::length(m[j]));
  };
  return std::max({cosine(0, 1), cosine(1, 2), cosine(2, 0)}) < k_right_angle_cosine;
}

// Whether a ray towards a point that faces the receiver meets nothing of the light before: planes, and convex shapes
// that emit outwards. Turned inwards, a sphere or cylinder hides its inside from receivers outside.
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

LightExtent light_extent(const Scene& scene, uint32_t emitter) {
  const Emitter& e = scene.emitters[emitter];
  LightExtent extent;
  switch (e.kind) {
    case EmitterKind::area: {
      if (e.instance == k_none) break;
      const Instance& instance = scene.instances[e.instance];
      const Shape& shape = scene.shapes[instance.shape];
      extent.bounds = transformed_bounds(shape.bounds, instance.to_world);
      extent.ball = {extent.bounds.centre(), 0.5f * glm::length(extent.bounds.diagonal())};
      if (shape.kind == ShapeKind::sphere && keeps_right_angles(instance.to_world)) {
        const Affine& m = instance.to_world;
        extent.ball.radius = std::max({glm::length(m[0]), glm::length(m[1]), glm::length(m[2])}) * (1.0f + 0x1p-10f);
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

ShadowCandidates::ShadowCandidates(const Scene& scene) {
  for (const Instance& instance : scene.instances) {
    const Bounds3 b = transformed_bounds(scene.shapes[instance.shape].bounds, instance.to_world);
    bounds_.push_back(b);
    const Vec3 c = b.centre();
    cx_.push_back(c.x);
    cy_.push_back(c.y);
    cz_.push_back(c.z);
    radius_.push_back(0.5f * glm::length(b.diagonal()) * (1.0f + gamma_bound(8)));
  }
}

void ShadowCandidates::select(const Bounds3& receivers, const LightExtent& light, size_t limit,
                              std::vector<uint32_t>& instances) const {
  instances.clear();
  const Vec3 a = receivers.centre();
  const float receiver_radius = 0.5f * glm::length(receivers.diagonal());
  const bool bounded = light.kind == LightExtent::Kind::bounded;
  // The hull lies within this distance of the axis from a.
  const float hull_radius = bounded ? std::max(receiver_radius, light.ball.radius) : receiver_radius;
  Bounds3 box = receivers;
  if (bounded) box.extend(light.bounds);
  const Vec3 axis = bounded ? light.ball.centre - a : light.towards;
  const float axis_squared = glm::dot(axis, axis);
  const float inverse = axis_squared > 0.0f ? 1.0f / axis_squared : 0.0f;
  const float t_end = bounded ? 1.0f : k_infinity;
  for (uint32_t i = 0; i < radius_.size() && instances.size() <= limit; ++i) {
    if (i == light.instance) continue;
    if (light.kind != LightExtent::Kind::everywhere) {
      const Vec3 from_a = Vec3(cx_[i], cy_[i], cz_[i]) - a;
      const float t = std::clamp(glm::dot(from_a, axis) * inverse, 0.0f, t_end);
      const Vec3 gap = from_a - t * axis;
      const float reach = radius_[i] + hull_radius;
      if (glm::dot(gap, gap) > reach * reach * (1.0f + gamma_bound(16))) continue;
      if (bounded && !overlap(box, bounds_[i])) continue;
    }
    instances.push_back(i);
  }
}

}  // namespace fieldtrace
