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

// What a parser found. Indices are in range and positions finite; triangles may be degenerate; a vertex for which a
// file with normals gives none has a zero normal.
struct RawMesh {
  TriangleMesh mesh;
  uint64_t short_polygons = 0;  // polygons of fewer than three corners, left out
};

RawMesh read_obj(const std::string& path, std::string_view text);
RawMesh read_ply(const std::string& path, std::string_view bytes, const WarningSink& warning);

// A piece of input for a message: at most 40 characters, unprintable ones replaced.
std::string quote(std::string_view text);

// Vertices and indices are counted in 32 bits.
inline constexpr uint64_t k_max_vertices = 0xfffffffeu;

}  // namespace fieldtrace::mesh_readers
