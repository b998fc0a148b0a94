// Properties of a whole shape that matter to its shadow rays: whether it is flat, and whether it gets a field. Each
// takes passes over the triangles, so a render computes them once.
//
// Thread-safety: pure.
#pragma once

#include <vector>

#include "core/scene/scene.h"

namespace fieldtrace {

// Objects with fewer triangles are left to exact rays, which cost little more than a look-up there.
inline constexpr size_t k_fewest_field_triangles = 256;

// So are those of which more than this share of the area lies in parts smaller than this, as their boxes' diagonals, in
// radii of the ball: the lines of a cell of 64 x 64 may pass all about such a part, and the cell then calls it empty.
inline constexpr double k_most_small_parts = 0.01;
inline constexpr float k_least_part = 1.0f / 16.0f;

struct ShapeTraits {
  bool is_flat = false;      // cannot block rays that leave it
  bool wants_field = false;  // a mesh that fields suit
};

// By shape of the scene.
std::vector<ShapeTraits> shape_traits(const Scene& scene);

}  // namespace fieldtrace
