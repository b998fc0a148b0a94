#include "hybrid/culling/shaft.h"

namespace fieldtrace {
namespace {

bool overlap(const Bounds3& a, const Bounds3& b) {
  return glm::all(glm::lessThanEqual(a.lower, b.upper)) && glm::all(glm::lessThanEqual(b.lower, a.upper));
}

scalar::Vec3Lanes<double> doubles(const DVec3& v) { return {v.x, v.y, v.z}; }

template <class Value>
void set(Value (&to)[3], const glm::vec<3, Value>& v) {
  for (int a = 0; a < 3; ++a) to[a] = v[a];
}

}  // namespace

Shaft::Shaft(const Bounds3& shading_points, const LightExtent& light) : kind_(light.kind) {
  const DVec3 lower(shading_points.lower), upper(shading_points.upper);
  if (kind_ == LightExtent::Kind::bounded) {
    box_ = shading_points;
    box_.extend(light.bounds);
    hull_ = scalar::hull_to_light<double>(doubles(lower), doubles(upper), doubles(light.ball.centre),
                                          double(light.ball.radius));
    return;
  }
  const double radius = 0.5 * glm::length(upper - lower);
  hull_ = {doubles(0.5 * (lower + upper)), {0.0, 0.0, 0.0}, 0.0, radius, 0.0, 0.0, 0.0};
  if (kind_ != LightExtent::Kind::directional) return;
  // Rounding leaves the direction within gamma(3) of unit length.
  hull_.along = doubles(glm::normalize(DVec3(light.towards)));
  hull_.length = double(k_infinity);
  hull_.extent = radius;
}

bool Shaft::meets(const BallAndBox& object, double rounding) const {
  if (kind_ == LightExtent::Kind::everywhere) return true;
  if (kind_ == LightExtent::Kind::bounded && !overlap(box_, object.box)) return false;
  return !scalar::misses_ball<double>(hull_, doubles(object.centre), object.radius, rounding);
}

ShaftTask shaft_task(const LightExtent& light, const BallAndBox& object) {
  ShaftTask task;
  set(task.light_centre, DVec3(light.ball.centre)), task.light_radius = double(light.ball.radius);
  set(task.light_lower, light.bounds.lower), set(task.light_upper, light.bounds.upper);
  set(task.object_centre, object.centre), task.object_radius = object.radius;
  set(task.object_lower, object.box.lower), set(task.object_upper, object.box.upper);
  task.rounding = Shaft::k_rounding;
  return task;
}

}  // namespace fieldtrace
