// Internal to mesh_io.cpp: the parsers of the mesh formats. Both take the whole file in memory and throw Error.
// Thread-safety: pure functions.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "core/mesh/mesh.h"
#include "core/platform/error.h"

namespace fieldtrace::mesh_readers {

// The parsed mesh. Indices are in range and positions finite; triangles may be degenerate; if the file has normals,
// vertices without one have a zero normal.
struct RawMesh {
  TriangleMesh mesh;
  uint64_t short_polygons = 0;  // polygons of fewer than three corners, which are dropped
};

RawMesh read_obj(const std::string& path, std::string_view text);
RawMesh read_ply(const std::string& path, std::string_view bytes, const WarningSink& warning);

// A piece of input for messages: at most 40 characters, with unprintable ones replaced.
std::string quote(std::string_view text);

// Vertex indices are 32 bits wide.
inline constexpr uint64_t k_max_vertices = 0xfffffffeu;

}  // namespace fieldtrace::mesh_readers
