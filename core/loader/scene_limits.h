// Ranges of lengths within which single precision, and Embree with it, renders a scene correctly; anything beyond is
// refused.
//
// Embree accepts rays with components of at most 1.844e18 (its FLT_LARGE) and aborts the program on others; products of
// three lengths that overflow or underflow before that make surfaces invisible. Images are invariant under a common
// scale of all lengths within these limits. Thread-safety: pure functions.
#pragma once

#include <vector>

#include "core/loader/scene_tree.h"
#include "core/platform/error.h"
#include "core/scene/scene.h"

namespace fieldtrace {

// Largest world coordinate. Two points are then less than 2^42 apart, and the cube of that has a normal reciprocal in
// single precision, as has the volume of an ellipsoidal emitter.
inline constexpr double k_largest_coordinate = 0x1p40;
// Smallest diameter of a scene. Squares of a millionth (2^-20) of it are still above the least normal float, 2^-126,
// with a few bits to spare.
inline constexpr double k_smallest_scene = 0x1p-40;
// Scale factors of a transform: Embree inverts it in single precision through its determinant, a product of three of
// them.
inline constexpr double k_largest_scale = 0x1p42, k_smallest_scale = 0x1p-42;
// Determinant of a transform as a share of the sum of its six terms' magnitudes, which is the same for all scales along
// the shape's axes and along the world's. Its rounding error in single precision is about gamma(5) < 2^-21 of that sum,
// so Embree's inverse is off by .8 % at most. It holds for spheres, disks and cylinders too: Embree transforms the rays
// that reach core/trace/accel_analytic.h.
inline constexpr double k_least_determinant = 0x1p-14;
// Factor by which rounding errors grow on a ray's way to object space and back. It is the same for all scales along the
// shape's axes, but not along the world's after a rotation: a ball at a distance is off by 2^-24 of that times this,
// here two pixels of an image 1000 pixels wide.
inline constexpr double k_largest_condition = 0x1p15;
// Smallest size of a shape (its box's diagonal) in object space. Ray-triangle tests divide by a product of two edges
// and a ray, which in corners is as short as an edge: edges of 2^-14 of this size then give a product of 2^-126.
inline constexpr double k_smallest_shape = 0x1p-28;
// Largest ray component in object space, where shadow rays are as long as the scene: below Embree's 1.844e18.
inline constexpr double k_largest_ray = 0x1p60;
// Largest product of an origin, a direction and an edge in ray-triangle tests (Moeller and Trumbore 1997). Sums of a
// few such products stay finite, and their reciprocals normal.
inline constexpr double k_largest_product = 0x1p126;

// Points in a triangle are known to 2^-24 of its edges (barycentric coordinates are floats). For edges this many times
// the distance to the camera, that is 2^-10 of the distance, about a pixel of an image 1000 pixels wide.
inline constexpr double k_blurred_triangle = 0x1p14;

// Where the parts of a scene were defined, for messages. A missing entry means an unknown place.
struct ScenePlaces {
  std::vector<SourceLocation> instances, emitters;  // as Scene::instances and Scene::emitters
  SourceLocation camera, scene;
};

// Throws Error naming the part's place if the scene's lengths exceed the limits above. `scene` must have been placed:
// its transforms are those passed to Embree.
void check_scene_limits(const Scene& scene, const ScenePlaces& places);

// What rays that are not the renderer's own may be, so that they are within the limits above in the space of every
// shape: the largest coordinate that they start at (0 or less: there is none), and the lengths of their directions.
struct RayLimits {
  double largest_coordinate, longest_direction, shortest_direction;
};
RayLimits ray_limits(const Scene& scene);

// Warns of triangles so large compared with their distance from the camera that surfaces and shadows on them blur; an
// Error in strict mode.
void warn_of_blurred_triangles(const Scene& scene, const ScenePlaces& places, const Diagnostics& diagnostics);

// Upper bound on the distance from the camera at which its rays start, on the near clipping plane and on the lens.
double camera_reach(const Camera& camera, const Film& film);

// Throws Error naming `where` for a lens whose rays single precision cannot represent.
void check_lens(const Camera& camera, const Film& film, const SourceLocation& where);

}  // namespace fieldtrace
