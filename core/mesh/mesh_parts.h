// Which vertices of a mesh hang together, and which nothing needs. Space: the mesh's. Thread-safety: pure functions.
#pragma once

#include "core/mesh/mesh.h"

namespace fieldtrace {

// Drops vertices that no triangle uses: they would count towards bounds. Unchecked: indices must be in range.
void drop_unused_vertices(TriangleMesh& mesh);

// The share of the mesh's area, [0, 1], that lies in parts whose boxes have diagonals below `size`. A part is what
// triangles connect that share vertices, or places of vertices. 0 if the mesh has no area.
double share_of_small_parts(const TriangleMesh& mesh, float size);

}  // namespace fieldtrace
