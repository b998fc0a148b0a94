// Properties of a whole shape that matter to its shadow rays: whether it is flat, and whether it gets a field. Each
// takes a pass over the triangles, so a render computes them once.
//
// Thread-safety: pure.
#pragma once

#include <vector>

#include "core/scene/scene.h"

namespace fieldtrace {

// Objects with fewer triangles are left to exact rays, which cost little more than a look-up there.
inline constexpr size_t k_fewest_field_triangles = 256;

struct ShapeTraits {
  bool is_flat = false;      // cannot block rays that leave it
  bool wants_field = false;  // a mesh of k_fewest_field_triangles or more that is not flat
};

// By shape of the scene.
std::vector<ShapeTraits> shape_traits(const Scene& scene);

}  // namespace fieldtrace
