// Smooth vertex normals of a triangle mesh.
//
// Source: G. Thuermer and C. A. Wuethrich, "Computing Vertex Normals from Polygonal Facets", Journal of Graphics Tools
// 3(1), 1998: facets are weighted by the angle that they span at the vertex. Mitsuba 3 does the same for meshes without
// normals. Thread-safety: pure functions. Memory layout: see core/mesh/mesh.h.
#pragma once

#include <cstdint>
#include <vector>

#include "core/mesh/mesh.h"

namespace fieldtrace {

// Angle-weighted unit normals in object space, one per position, on the side from which the triangles run
// anticlockwise. A vertex whose facets cancel out takes the normal of its first facet of non-zero area, or +z if there
// is none. `weld` is empty, or maps each position to the index of its representative (for vertices that differ in
// texture coordinates only): welded vertices share one normal. Unchecked: indices in range, finite positions, weld
// empty or one entry per position.
std::vector<Vec3> vertex_normals(const TriangleMesh& mesh, const std::vector<uint32_t>& weld = {});

// Replaces mesh.normals with vertex_normals(mesh).
void compute_vertex_normals(TriangleMesh& mesh);

}  // namespace fieldtrace
