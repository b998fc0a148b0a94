// Bounds of where the shadow rays towards a light end, for culling.
//
// Space: world. Thread-safety: values and pure functions.
#pragma once

#include <cstdint>

#include "core/math/math.h"
#include "core/scene/scene.h"

namespace fieldtrace {

// Where a batch's rays end: in a box (area and point lights), or at infinity in one direction or in all.
struct LightExtent {
  enum class Kind { bounded, directional, everywhere };
  Kind kind = Kind::bounded;
  Bounds3 bounds;              // bounded
  Sphere ball;                 // bounded: encloses the light, too; tighter for spheres and flat lights
  Vec3 towards = Vec3(0.0f);   // directional: unit, from the shading points to the light
  uint32_t instance = k_none;  // the light's own instance where it cannot block its own samples, else none
};

LightExtent light_extent(const Scene& scene, uint32_t emitter);

// The angular diameter in degrees of a light's ball, seen from a point: 0 for directional lights, 180 for lights all
// around and from within the ball.
float angular_diameter(const LightExtent& light, const Vec3& point);

// The bounding box of a transformed box, widened by the rounding of the transform.
Bounds3 world_bounds(const Bounds3& object_space, const Affine& to_world);

}  // namespace fieldtrace
