// Lengths within which single precision, and Embree with it, renders a scene rightly; what lies beyond is refused.
//
// Embree accepts rays whose numbers are at most 1.844e18 (its FLT_LARGE) and aborts the program on others; products of
// three lengths that overflow or underflow before that make surfaces invisible. Pictures are invariant under a common
// scale of all lengths within these limits. Thread-safety: pure functions.
#pragma once

#include <vector>

#include "core/platform/error.h"
#include "core/scene/scene.h"

namespace fieldtrace {

// World coordinates. Two points are then less than 2^42 apart, whose cube has a normal reciprocal in single precision,
// as has the volume of an ellipsoid that glows.
inline constexpr double k_largest_coordinate = 0x1p40;
// The largest distance in a scene. Squares of a millionth (2^-20) of it are still above the least normal float, 2^-126,
// with a few bits to spare.
inline constexpr double k_smallest_scene = 0x1p-40;
// Scale factors of a transform: Embree inverts it in single precision by its determinant, a product of three of them.
inline constexpr double k_largest_scale = 0x1p42, k_smallest_scale = 0x1p-42;
// Determinant of a transform's columns, scaled to length 1. Its rounding error in single precision is some gamma(5) <
// 2^-21; relative to this, Embree's inverse is off by .8 % at most.
inline constexpr double k_least_determinant = 0x1p-14;
// A shape's size (its box's diagonal) in its own coordinates. Ray-triangle tests divide by a product of two edges and a
// ray, which is as short as an edge in corners: edges of 2^-14 of this size then have one of 2^-126.
inline constexpr double k_smallest_shape = 0x1p-28;
// Numbers of rays in a shape's own coordinates, where shadow rays are as long as the scene: below Embree's 1.844e18.
inline constexpr double k_largest_ray = 0x1p60;
// Ray-triangle tests multiply an origin, a direction and an edge (Moeller and Trumbore 1997). Sums of a few such
// products stay finite, and their reciprocals normal.
inline constexpr double k_largest_product = 0x1p126;

// Points in a triangle are known to 2^-24 of its edges (barycentric coordinates are floats). From this many times its
// distance to the camera on that is 2^-10 of the distance, about a pixel of a picture 1000 pixels wide.
inline constexpr double k_blurred_triangle = 0x1p14;

// Where the parts of a scene come from; a missing entry is named by nothing.
struct ScenePlaces {
  std::vector<SourceLocation> instances, emitters;  // as Scene::instances and Scene::emitters
  SourceLocation camera, scene;
};

// Throws Error naming the part's place for a scene whose lengths are beyond the limits above. `scene` is placed: its
// transforms are what Embree is given.
void check_scene_limits(const Scene& scene, const ScenePlaces& places);

// Warns of triangles so much larger than their distance from the camera that surfaces and shadows on them are blurred.
void warn_of_blurred_triangles(const Scene& scene, const ScenePlaces& places, const WarningSink& warning);

// The largest distance from the camera at which its rays may start: on the near clipping plane, and on the lens.
double camera_reach(const Camera& camera, const Film& film);

// Throws Error naming `where` for lenses whose rays cannot be computed in single precision.
void check_lens(const Camera& camera, const Film& film, const SourceLocation& where);

}  // namespace fieldtrace
