// Triangle mesh files: Wavefront OBJ and Stanford PLY in, PLY out; and validation of every mesh.
//
// Formats: OBJ: polygons, normals, texture coordinates, negative indices; groups and objects are merged,
// materials, lines and free-form surfaces ignored. PLY: ascii, binary little and big endian; x y z, nx ny nz, (u v) or
// (s t) or (texture_u texture_v); faces vertex_indices or vertex_index; anything else is skipped. Bad input
// throws Error with the file's name and, for text formats, the line.
// Thread-safety: all functions may be called from any thread. Memory layout: see core/mesh/mesh.h.
#pragma once

#include <optional>
#include <string>

#include "core/mesh/mesh.h"
#include "core/mesh/mesh_normals.h"
#include "core/platform/error.h"

namespace fieldtrace {

enum class MeshFormat { obj, ply };

// The defaults match those of Mitsuba 3's `obj` and `ply` plugins, except that the plugins also compute missing normals
// (`compute_normals`). face_normals and flip_tex_coords are named as there.
struct MeshLoadOptions {
  std::optional<MeshFormat> format = std::nullopt;  // unset: by the file's ending
  bool face_normals = false;                        // drop the file's normals and compute none
  bool compute_normals = false;  // a file without normals gets compute_vertex_normals(); face_normals takes precedence
  std::optional<bool> flip_tex_coords = std::nullopt;  // v becomes 1 - v; unset: yes for OBJ, no for PLY, as in Mitsuba
};

// Loads `path` and validates it; positions and normals are in object space, as in the file. A polygon of n corners
// becomes n - 2 triangles, around its first corner if it is convex. PLY keeps the order of the file's vertices; OBJ
// makes one vertex of each distinct position/texture/normal triple, in order of first use. If only some of
// an OBJ file's corners have a normal, the others get computed ones, with a warning. Throws Error: missing or
// unreadable file, unknown extension, malformed content, premature end of file, index out of range, positions that are
// not finite, no triangles.
TriangleMesh load_mesh(const std::string& path, const MeshLoadOptions& options = {}, const WarningSink& warning = {});

// Makes a mesh safe to render, or throws Error naming `name`:
// - attribute arrays of the wrong length, positions that are not finite, indices out of range, no triangles: Error;
// - triangles of zero area (repeated corners included) are dropped with one counted warning, Error if none remain;
// - vertices that no triangle uses are dropped;
// - normals are made unit length; ones that are zero or not finite are recomputed, with one counted warning;
// - texture coordinates that are not finite become 0, with one counted warning.
void validate_mesh(TriangleMesh& mesh, const std::string& name, const WarningSink& warning = {});

// Writes positions, normals (nx ny nz) and texture coordinates (s t) where the mesh has them, and triangles, as binary
// PLY, little endian. The file is written under a temporary name in the same folder and renamed into place. Throws
// Error if it cannot be written. Unchecked: the mesh has passed validate_mesh.
void save_ply(const std::string& path, const TriangleMesh& mesh);

}  // namespace fieldtrace
