// Internal to mesh_io.cpp: the parsers of the mesh formats. Both take the whole file in memory and throw Error.
// Thread-safety: pure functions.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "core/mesh/mesh.h"
#include "core/mesh/polygon.h"
#include "core/platform/error.h"

namespace fieldtrace::mesh_readers {

// The parsed mesh. Indices are in range and positions finite; triangles may be degenerate; if the file has normals,
// vertices without one have a zero normal.
struct RawMesh {
  TriangleMesh mesh;
  uint64_t short_polygons = 0;  // polygons of fewer than three corners, which are dropped
  uint64_t uncut_polygons = 0;  // those that cut_concave() leaves as they are

  // `count` triangles from `first` on are a polygon, around its first corner; positions are known.
  void end_polygon(size_t first, size_t count) {
    if (count > 1) uncut_polygons += !cut_concave(mesh.positions, &mesh.triangles[first], count);
  }
};

RawMesh read_obj(const std::string& path, std::string_view text);
RawMesh read_ply(const std::string& path, std::string_view bytes, const WarningSink& warning);

// Takes the next word off `line`; empty at the end. is_blank(c): whether a character parts words.
template <class IsBlank>
std::string_view next_word(std::string_view& line, const IsBlank& is_blank) {
  size_t begin = 0;
  while (begin < line.size() && is_blank(line[begin])) ++begin;
  size_t end = begin;
  while (end < line.size() && !is_blank(line[end])) ++end;
  const std::string_view word = line.substr(begin, end - begin);
  line.remove_prefix(end);
  return word;
}

// A piece of input for messages: at most 40 characters, with unprintable ones replaced.
std::string quote(std::string_view text);

// Vertex indices are 32 bits wide.
inline constexpr uint64_t k_max_vertices = 0xfffffffeu;

}  // namespace fieldtrace::mesh_readers
