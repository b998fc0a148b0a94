#include "hybrid/visibility/shadow_instance.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "field/query/cone.hd.h"
#include "field/store/risk_classes.h"
#include "hybrid/visibility/shadow_answerer.h"

namespace fieldtrace {
namespace {

// World -> unit space of a ball in object space, composed in double.
void write_unit_transform(const Instance& instance, const Sphere& ball, float out[12]) {
  const double inverse_radius = 1.0 / double(ball.radius);
  for (int column = 0; column < 4; ++column) {
    for (int row = 0; row < 3; ++row) {
      const double shift = column == 3 ? double(ball.centre[row]) : 0.0;
      out[column * 3 + row] = float((double(instance.to_object[column][row]) - shift) * inverse_radius);
    }
  }
}

// Bound on how much the linear part A lengthens a vector: the square root of the largest eigenvalue of A^T A (Smith,
// "Eigenvalues of a symmetric 3 x 3 matrix", CACM 1961), plus a thousandth for its rounding.
float stretch_bound(const float m[12]) {
  const auto column = [&](int i) { return DVec3(m[3 * i], m[3 * i + 1], m[3 * i + 2]); };
  const DVec3 diagonal(glm::dot(column(0), column(0)), glm::dot(column(1), column(1)), glm::dot(column(2), column(2)));
  const DVec3 beside(glm::dot(column(0), column(1)), glm::dot(column(1), column(2)), glm::dot(column(2), column(0)));
  const double mean = (diagonal.x + diagonal.y + diagonal.z) / 3.0;
  const DVec3 d = diagonal - DVec3(mean);
  const double p = std::sqrt((glm::dot(d, d) + 2.0 * glm::dot(beside, beside)) / 6.0);
  double largest = mean;
  if (p > 0.0) {
    const DVec3 b = d / p, c = beside / p;
    const double half_determinant =
        0.5 * (b.x * (b.y * b.z - c.y * c.y) - c.x * (c.x * b.z - c.y * c.z) + c.z * (c.x * c.y - b.y * c.z));
    largest = mean + 2.0 * p * std::cos(std::acos(std::clamp(half_determinant, -1.0, 1.0)) / 3.0);
  }
  return float(std::sqrt(largest) * (1.0 + 0x1p-10));
}

}  // namespace

ShadowInstance make_shadow_instance(const Scene& scene, uint32_t index, const ShapeTraits& traits, Field* field,
                                    const ThesisField* thesis, const AnswererSettings& settings) {
  const Instance& instance = scene.instances[index];
  const Shape& shape = scene.shapes[instance.shape];
  const Sphere ball = field_ball(shape.bounds);
  ShadowInstance o;
  o.field = field;
  o.in_ball = traits.wants_field;
  o.cone.segment.instance = o.box.instance = index;
  o.cone.segment.policy = query_policy(settings.force_undecided ? 0.0f : settings.tolerance);
  // Only depth cells can answer rays that start on the object; without them these rays are traced.
  o.cone.segment.reads_depth = settings.self_to_rays.empty() || !settings.self_to_rays[instance.shape];
  if (field) o.cone.segment.field = field->view();
  if (thesis) o.thesis = thesis_instance_view(*thesis, instance, index);
  write_unit_transform(instance, ball, o.cone.segment.to_unit);
  o.cone.segment.to_unit_stretch = stretch_bound(o.cone.segment.to_unit);
  for (int e = 0; e < 9; ++e) o.cone.from_unit[e] = instance.to_world[e / 3][e % 3] * ball.radius;
  for (int a = 0; a < 3; ++a) o.cone.half_extent[a] = 0.5f * shape.bounds.diagonal()[a] / ball.radius;
  o.answers_cones = field && settings.whole_lights && settings.tolerance > 0.0f && !settings.force_undecided;
  o.cone.chord_share = settings.tolerance < k_estimating_tolerance ? 1.0f : scalar::k_chord_share;
  std::memcpy(o.box.to_object, &instance.to_object, sizeof o.box.to_object);
  o.box.to_object_stretch = stretch_bound(o.box.to_object);
  // Transforming a ray into object space rounds; the box grows by as much.
  const Vec3 extent = glm::max(glm::abs(shape.bounds.lower), glm::abs(shape.bounds.upper));
  const float slack = gamma_bound(8) * glm::length(extent);
  for (int axis = 0; axis < 3; ++axis) {
    o.box.lower[axis] = shape.bounds.lower[axis] - slack;
    o.box.upper[axis] = shape.bounds.upper[axis] + slack;
  }
  o.box.skip_self = traits.is_flat;
  return o;
}

float cells_across(const SegmentTask& segment, const Sphere& light) {
  const float* m = segment.to_unit;
  Vec3 centre(m[9], m[10], m[11]);
  for (int axis = 0; axis < 3; ++axis)
    centre += Vec3(m[3 * axis], m[3 * axis + 1], m[3 * axis + 2]) * light.centre[axis];
  const float sine = light.radius * segment.to_unit_stretch / (glm::length(centre) - 1.0f);
  if (!(sine >= 0.0f && sine < scalar::k_widest_cone_sine)) return k_infinity;
  const float tangent = sine / std::sqrt(1.0f - sine * sine);
  return tangent * segment.field.directions.cells / std::sqrt(k_pi);
}

}  // namespace fieldtrace
