// Meshes that are a parallelogram. Thread-safety: pure functions.
#pragma once

#include <optional>

#include "core/scene/scene.h"
#include "hybrid/visibility/shape_traits.h"

namespace fieldtrace {

// In object space: its centre, and its half axes and a unit normal as columns.
struct Parallelogram {
  DVec3 centre;
  DMat3 axes;
};

// The parallelogram that a mesh is, of any number of triangles, which needs no maps; nothing for other shapes.
std::optional<Parallelogram> parallelogram(const Shape& shape, const ShapeTraits& traits);

// The same in world space, where the normal is not finite if it has no area.
Parallelogram in_world(const Parallelogram& object, const Affine& to_world);

}  // namespace fieldtrace
