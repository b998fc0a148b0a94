// The space that shadow rays from a group of shading points to a light can cross, and whether objects reach into it.
//
// A shaft is the hull of two balls, one around the shading points and one around the light; for a directional light an
// infinite cylinder; for light from everywhere all of space. Towards a bounded light, the box around both bounds it as
// well. Space: world, computed in double: coordinates are floats, so no square overflows, and the rounding is far below
// theirs. Thread-safety: const after construction.
#pragma once

#include "core/math/math.h"
#include "hybrid/culling/light_extent.h"
#include "hybrid/culling/shaft.hd.h"
#include "hybrid/culling/shaft_kernels.h"

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

  // The test below is some 40 roundings of 2^-53 deep, each relative to the distances that enter it: less than 2^-46 of
  // their sum. An object's bounds lie within those of its group, and so does its sum: with twice the allowance the
  // group's test passes wherever the object's does.
  static constexpr double k_rounding = 0x1p-46;

 private:
  bool meets(const BallAndBox& object, double rounding) const;

  LightExtent::Kind kind_;
  scalar::BallHull<double> hull_;  // a cylinder of length infinity for a directional light
  Bounds3 box_;
};

// What shaft_kernel() is asked, of a bounded light: the test that Shaft::meets() makes of one shading point.
ShaftTask shaft_task(const LightExtent& light, const BallAndBox& object);

}  // namespace fieldtrace
