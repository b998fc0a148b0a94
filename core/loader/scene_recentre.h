// Moves a scene that lies far from its file's origin to the origin of the rendering coordinates.
//
// A float coordinate at distance s (in scene sizes) from the origin has lost log2(s) of its 24 bits. Transforms are
// kept in double until here, so a scene positioned by transforms loses nothing. Vertices are read as floats: what they
// lost on reading (2^-24 of their distance from the *object's* origin) cannot be recovered, but moving them near the
// object's origin keeps further arithmetic from losing more. Thread-safety: pure functions on the caller's data.
#pragma once

#include <limits>
#include <vector>

#include "core/math/math.h"
#include "core/scene/scene.h"

namespace fieldtrace {

// The positioned parts of a scene, in double precision and in the file's coordinates.
struct ScenePlacement {
  std::vector<DAffine> instances;  // to_world, one per Scene::instances
  std::vector<DVec3> emitters;     // position, one per Scene::emitters; read for point lights only
  DAffine camera = DAffine(1.0);
};

// A scene (or mesh) is moved if its centre lies farther from the origin than this many of its diagonals; beyond,
// offsets cost more than log2(4) = 2 bits of each coordinate.
inline constexpr double k_recentre_diagonals = 4;

// Bounds3 in double precision.
struct DBounds {
  DVec3 lower = DVec3(std::numeric_limits<double>::infinity());
  DVec3 upper = DVec3(-std::numeric_limits<double>::infinity());

  void extend(const DVec3& p) {
    lower = glm::min(lower, p);
    upper = glm::max(upper, p);
  }
  void extend(const DAffine& a, const Bounds3& b) {
    for (int c = 0; c < 8; ++c) extend(transform_point(a, DVec3(b.corner(c))));
  }
  bool empty() const { return !(lower.x <= upper.x); }
  DVec3 centre() const { return 0.5 * lower + 0.5 * upper; }
  bool far_off() const { return !empty() && glm::length(centre()) > k_recentre_diagonals * glm::length(upper - lower); }
};

// Of all instances, in the file's coordinates.
DBounds world_bounds(const Scene& scene, const ScenePlacement& placement);

// Moves the vertices of distant meshes to their object's origin and adjusts `placement.instances`, so that no world
// position changes. The subtraction is exact for distant coordinates (Sterbenz' lemma).
void recentre_meshes(Scene& scene, ScenePlacement& placement);

// Fills the float transforms of `scene` (with their inverses, computed in double), its emitter positions, its camera
// and Scene::origin from `placement`. The bounds are those of all instances; a scene without any is not moved.
// Unchecked: the caller guarantees invertible transforms.
void place_scene(Scene& scene, const ScenePlacement& placement);

}  // namespace fieldtrace
