// Meshes that are a parallelogram or a box, which need no maps. Thread-safety: pure functions.
#pragma once

#include <array>
#include <optional>
#include <span>
#include <vector>

#include "core/scene/scene.h"
#include "hybrid/visibility/shape_traits.h"

namespace fieldtrace {

// With more instances than this they are a crowd: the cost of a point must not grow with their number.
inline constexpr size_t k_crowd = 64;

// In object space: its centre, and its half axes and a unit normal as columns.
struct Parallelogram {
  DVec3 centre;
  DMat3 axes;
};

// The parallelogram that a mesh is, of any number of triangles, which needs no maps; nothing for other shapes.
std::optional<Parallelogram> parallelogram(const Shape& shape, const ShapeTraits& traits);

// The faces of a box along the axes of object space: face 2 a + s at the upper (s = 0) or lower end of axis a, with its
// half axes along axes a + 1 and a + 2 and its normal outwards.
using BoxFaces = std::array<Parallelogram, 6>;

// The box that a mesh of twelve triangles is, if it is its bounds'; its shading normals must be those of its faces.
std::optional<BoxFaces> box_faces(const Shape& shape, const ShapeTraits& traits);

// Whether a point lies within the box of an instance's shape, in the shape's own space.
bool lies_in_box(const Scene& scene, const Instance& instance, const Vec3& point);

// What the shapes of a scene are. Boxes count as such only where planes are few, not in crowds, and while neither the
// camera nor the middle of an instance lies within one.
struct PlaneShapes {
  std::vector<std::optional<Parallelogram>> parallelograms;  // by shape
  std::vector<std::optional<BoxFaces>> boxes;                // likewise
  bool has(uint32_t shape) const { return parallelograms[shape] || boxes[shape]; }
};
PlaneShapes plane_shapes(const Scene& scene, std::span<const ShapeTraits> traits);

// The same in world space, where the normal is not finite if it has no area.
Parallelogram in_world(const Parallelogram& object, const Affine& to_world);

}  // namespace fieldtrace
