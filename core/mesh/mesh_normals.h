// Smooth vertex normals of a triangle mesh.
//
// Source: G. Thuermer and C. A. Wuethrich, "Computing Vertex Normals from Polygonal Facets", Journal of Graphics
// Tools 3(1), 1998: each facet counts with the angle that it spans at the vertex. Mitsuba 3 does the same for meshes
// without normals. Thread-safety: pure functions. Memory layout: see core/mesh/mesh.h.
#pragma once

#include <cstdint>
#include <vector>

#include "core/mesh/mesh.h"

namespace fieldtrace {

// Angle-weighted normals in object space, one per position, unit length, on the side from which the triangles run
// anticlockwise. A vertex whose facets cancel out takes the normal of its first facet of non-zero area; one without
// such a facet takes +z. `weld` is empty, or holds for each position the index of the position that stands for it
// (vertices that only texture coordinates set apart): welded vertices get one normal. Unchecked: indices in range,
// finite positions, weld empty or one entry per position.
std::vector<Vec3> vertex_normals(const TriangleMesh& mesh, const std::vector<uint32_t>& weld = {});

// Replaces mesh.normals by vertex_normals(mesh).
void compute_vertex_normals(TriangleMesh& mesh);

}  // namespace fieldtrace
