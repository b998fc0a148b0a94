#include "hybrid/visibility/shadow_instance.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "field/query/cone.hd.h"
#include "field/store/risk_classes.h"
#include "hybrid/visibility/linear_map.h"
#include "hybrid/visibility/shadow_answerer.h"

namespace fieldtrace {
namespace {

// Whether the plane through the unit ball of `a` across the line to the centre of b's ball parts the two.
bool parts(const ShadowInstance& a, const ShadowInstance& b) {
  const DMat3 to_unit = linear_part(a.cone.segment.to_unit);
  const DVec3 between = to_unit * (b.centre - a.centre);
  const double distance = glm::length(between);
  if (!(distance > 1.0)) return false;
  return distance > 1.0 + glm::length((between / distance) * (to_unit * linear_part(b.cone.from_unit)));
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
  write_unit_transform(instance.to_object, ball, o.cone.segment.to_unit);
  const DMat3 to_unit = linear_part(o.cone.segment.to_unit);
  o.cone.segment.to_unit_stretch = stretch_bound(to_unit);
  o.cone.segment.to_unit_area = area_bound(to_unit);
  o.cone.segment.keeps_angles = keeps_angles(to_unit);
  o.centre = DVec3(transform_point(instance.to_world, ball.centre));
  for (int e = 0; e < 9; ++e) o.cone.from_unit[e] = instance.to_world[e / 3][e % 3] * ball.radius;
  for (int a = 0; a < 3; ++a) o.cone.half_extent[a] = 0.5f * shape.bounds.diagonal()[a] / ball.radius;
  o.answers_cones = field && settings.whole_lights && settings.tolerance > 0.0f && !settings.force_undecided;
  std::memcpy(o.box.to_object, &instance.to_object, sizeof o.box.to_object);
  o.box.to_object_stretch = stretch_bound(linear_part(o.box.to_object));
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

bool may_overlap(const ShadowInstance& a, const ShadowInstance& b) { return !parts(a, b) && !parts(b, a); }

}  // namespace fieldtrace
