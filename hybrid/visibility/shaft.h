// The space that shadow rays from a group of shading points to a light can cross, and whether objects reach into it.
//
// A shaft is the hull of two balls, one around the shading points and one around the light; for a directional light an
// infinite cylinder; for light from everywhere all of space. Towards a bounded light, the box around both bounds it as
// well. Space: world, computed in double: coordinates are floats, so no square overflows, and the rounding is far below
// theirs. Thread-safety: const after construction.
#pragma once

#include "core/math/math.h"
#include "hybrid/visibility/light_extent.h"

namespace fieldtrace {

// Conservative bounds, in double, of one object or several.
struct BallAndBox {
  DVec3 centre = DVec3(0.0);
  double radius = 0.0;
  Bounds3 box;
};

class Shaft {
 public:
  Shaft(const Bounds3& shading_points, const LightExtent& light);

  // Whether an object's ball and box both reach into the shaft. Never false for an object that meets a ray.
  bool meets(const BallAndBox& object) const { return meets(object, k_rounding); }
  // The same for bounds of several objects: never false where meets() is true for any of them.
  bool meets_some(const BallAndBox& objects) const { return meets(objects, 2.0 * k_rounding); }

 private:
  // The test below is some 40 roundings of 2^-53 deep, each relative to the distances that enter it: less than 2^-46 of
  // their sum. An object's bounds lie within those of its group, and so does its sum: with twice the allowance the
  // group's test passes wherever the object's does.
  static constexpr double k_rounding = 0x1p-46;

  bool meets(const BallAndBox& object, double rounding) const;

  LightExtent::Kind kind_;
  DVec3 origin_, along_ = DVec3(0.0);  // centre of the shading points' ball; unit vector to the light
  double length_ = 0.0;                // from ball to ball
  double radius_ = 0.0;                // of the shading points' ball
  double widening_ = 0.0;              // growth of the radius per distance along the axis, in (-1, 1)
  double lean_ = 0.0;                  // how far up the axis the nearest ball lies, per distance from the axis
  double extent_ = 0.0;                // sum of the shaft's distances, for bounding the rounding
  Bounds3 box_;
};

}  // namespace fieldtrace
