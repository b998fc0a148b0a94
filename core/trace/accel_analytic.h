// Analytic shapes as Embree user geometries: unit sphere, unit disk, unit cylinder (see ShapeKind). Private to the
// acceleration structure.
//
// Intersections are computed in double, so that a hit's only error is that of storing t as a float.
// Thread-safety: creation by one thread; the callbacks are pure.
#pragma once

#include <embree3/rtcore.h>

#include "core/scene/scene.h"

namespace fieldtrace {

// A geometry with one primitive, not yet committed. Unchecked: !is_meshed(kind).
RTCGeometry new_analytic_geometry(RTCDevice device, ShapeKind kind);

// The first t in [t_min, t_max] at which o + t d hits the shape, or -1. `normal` (not normalised, oriented as for
// ShapeKind) is written on a hit. The quadratic is solved at the foot of the perpendicular (Haines, Gunther and
// Akenine-Moller, "Precision Improvements for Ray/Sphere Intersection", Ray Tracing Gems, 2019, chapter 7).
double intersect_analytic(ShapeKind kind, const DVec3& o, const DVec3& d, double t_min, double t_max, DVec3& normal);

}  // namespace fieldtrace
