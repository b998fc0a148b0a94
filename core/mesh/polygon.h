// Polygons of mesh files, cut into triangles.
#pragma once

#include <vector>

#include "core/math/math.h"

namespace fieldtrace::mesh_readers {

// Cuts a polygon of count + 2 corners anew if it is concave, by its ears (G. H. Meisters, "Polygons Have Ears", 1975).
// `fan` holds its `count` triangles around the first corner, which convex polygons keep. Returns whether the triangles
// cover the polygon; if not, because it crosses itself or has more than 1,024 corners, the fan stays.
bool cut_concave(const std::vector<Vec3>& positions, UVec3* fan, size_t count);

}  // namespace fieldtrace::mesh_readers
