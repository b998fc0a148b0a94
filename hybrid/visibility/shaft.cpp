#include "hybrid/visibility/shaft.h"

#include <algorithm>

namespace fieldtrace {
namespace {

// Where the balls' radii differ by more than this share of the distance between their centres, the shaft becomes a
// cylinder of the larger radius: the cone's rim would be rounded too much (1 - k^2 cancels), and one ball hides most of
// the other anyway.
constexpr double k_widest = 0.99;

bool overlap(const Bounds3& a, const Bounds3& b) {
  return glm::all(glm::lessThanEqual(a.lower, b.upper)) && glm::all(glm::lessThanEqual(b.lower, a.upper));
}

}  // namespace

Shaft::Shaft(const Bounds3& shading_points, const LightExtent& light) : kind_(light.kind) {
  const DVec3 lower(shading_points.lower), upper(shading_points.upper);
  origin_ = 0.5 * (lower + upper);
  radius_ = 0.5 * glm::length(upper - lower);
  if (kind_ == LightExtent::Kind::directional) {
    // Rounding leaves the direction within gamma(3) of unit length.
    along_ = glm::normalize(DVec3(light.towards));
    length_ = double(k_infinity);
    extent_ = radius_;
  }
  if (kind_ != LightExtent::Kind::bounded) return;
  box_ = shading_points;
  box_.extend(light.bounds);
  const DVec3 axis = DVec3(light.ball.centre) - origin_;
  const double light_radius = double(light.ball.radius);
  length_ = glm::length(axis);
  if (length_ > 0.0) along_ = axis / length_;
  if (std::abs(light_radius - radius_) < k_widest * length_) {
    widening_ = (light_radius - radius_) / length_;
    lean_ = widening_ / std::sqrt(1.0 - widening_ * widening_);
  } else {
    radius_ = std::max(radius_, light_radius);
  }
  extent_ = length_ + radius_ + light_radius;
}

bool Shaft::meets(const BallAndBox& object, double rounding) const {
  if (kind_ == LightExtent::Kind::everywhere) return true;
  if (kind_ == LightExtent::Kind::bounded && !overlap(box_, object.box)) return false;
  const DVec3 v = object.centre - origin_;
  const double along = glm::dot(v, along_);
  const double across = glm::length(v - along * along_);
  // The shaft is the union of the balls about the axis points s with radius radius + widening s. The one nearest to the
  // object's centre minimises sqrt(across^2 + (s - along)^2) - widening s, which is convex in s.
  const double s = std::clamp(along + lean_ * across, 0.0, length_);
  const double gap = std::sqrt(across * across + (s - along) * (s - along)) - widening_ * s;
  const double sum = glm::length(v) + object.radius + extent_;
  // Negated, so that bounds that are not finite pass.
  return !(gap > object.radius + radius_ + rounding * sum);
}

}  // namespace fieldtrace
