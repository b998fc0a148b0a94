// Moves a scene that lies far from its file's origin to the origin of the coordinates that are rendered in.
//
// Why: a float coordinate at distance s (in scene sizes) from the origin has lost log2(s) of its 24 bits. Transforms
// are kept in double until here, so a scene of transforms loses nothing. Vertices come as floats: what a mesh file's
// numbers lost when they were read (2^-24 of their distance from the *object's* origin) cannot be won back, but moving
// them near the object's origin keeps further arithmetic from losing more. Thread-safety: pure functions on the
// caller's data.
#pragma once

#include <vector>

#include "core/math/math.h"
#include "core/scene/scene.h"

namespace fieldtrace {

// The parts of a scene that have a place in the world, in double precision, in the file's coordinates.
struct ScenePlacement {
  std::vector<DAffine> instances;  // to_world, one per Scene::instances
  std::vector<DVec3> emitters;     // position, one per Scene::emitters; read for point lights only
  DAffine camera = DAffine(1.0);
};

// A scene (or mesh) is moved when its centre lies farther from the origin than this many of its diagonals: beyond,
// offsets cost more than log2(4) = 2 bits of each coordinate.
inline constexpr double k_recentre_diagonals = 4;

// Moves the vertices of far-off meshes to their object's origin and adjusts `placement.instances`, so that no world
// position changes. The subtraction is exact in the far-off coordinates (Sterbenz' lemma).
void recentre_meshes(Scene& scene, ScenePlacement& placement);

// Fills the float transforms (with their inverses, computed in double), emitter positions and the camera of `scene`
// from `placement`, and Scene::origin. The bounds are those of all instances; a scene without any is left where it is.
// Unchecked: the caller guarantees invertible transforms.
void place_scene(Scene& scene, const ScenePlacement& placement);

}  // namespace fieldtrace
