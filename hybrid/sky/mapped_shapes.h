// The shapes that direction maps are made of: one for all instances that differ by turns, mirrors and even scaling;
// instances that are deformed otherwise have maps of the deformed shape.
//
// Thread-safety: pure functions.
#pragma once

#include <span>
#include <vector>

#include "core/scene/scene.h"
#include "hybrid/visibility/shape_traits.h"

namespace fieldtrace {

struct MappedShape {
  uint32_t shape = k_none;
  DMat3 stretch = DMat3(1.0);  // from object space: symmetric, of determinant 1
  Sphere ball;                 // encloses the deformed shape
  bool is_deformed() const { return stretch != DMat3(1.0); }
};

struct MappedShapes {
  std::vector<MappedShape> shapes;
  std::vector<uint32_t> of_instance;  // index into shapes; k_none: it needs no maps, or can have none
};

// All that a scene's instances need, but for parallelograms and boxes (plane_shapes()). Instances share one if their
// deformations differ by less than about 1/1000. At most k_most_deformed are deformed; instances with others, or almost
// flattened, have none.
inline constexpr size_t k_most_deformed = 64;
MappedShapes mapped_shapes(const Scene& scene, std::span<const ShapeTraits> traits);

// The median radius of the instances that have maps, world units; 0 if there are none.
float median_radius(const Scene& scene, const MappedShapes& mapped);

}  // namespace fieldtrace
