// What the shadow answerer's kernels need to know about an instance. Plain data.
#pragma once

#include <optional>

#include "field/query/segment_kernels.h"
#include "field/store/field.h"
#include "field/thesis/thesis_field.h"
#include "hybrid/visibility/shape_traits.h"

namespace fieldtrace {

struct AnswererSettings;

struct ShadowInstance {
  bool in_ball = false;        // culled by the field's ball, else by the bounding box
  bool answers_cones = false;  // answers whole lights
  Field* field = nullptr;      // answers rays that cross the ball; null: exact rays
  // Thesis' chart: answers every ray; `field` is then null.
  std::optional<ThesisInstanceView> thesis;
  ConeTask cone;  // for the ball
  DVec3 centre;   // of the ball, world space
  BoxTask box;
};

// `index` is the instance's; `traits` are those of its shape. `field` is its field, or null; `thesis` likewise.
ShadowInstance make_shadow_instance(const Scene& scene, uint32_t index, const ShapeTraits& traits, Field* field,
                                    const ThesisField* thesis, const AnswererSettings& settings);

// The width of a light's ball in mean direction cells of a field (2 sqrt(pi) / D), seen from the nearest point of the
// object's ball; infinity for lights too near or too wide for whole answers. In unit space the ball is an ellipsoid;
// the width is that of the ball about it.
float cells_across(const SegmentTask& segment, const Sphere& light);

// False where a plane across the line of the centres, in the unit space of one of them, parts the two instances' balls
// (ellipsoids in world space). True for others, and for balls that overlap.
bool may_overlap(const ShadowInstance& a, const ShadowInstance& b);

}  // namespace fieldtrace
