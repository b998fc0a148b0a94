// Internal to the procedural meshes: triangulates a surface given over a grid of (u, v).
//
// Seams: the last column or row of a closed direction repeats the vertices of the first bit for bit, apart from texture
// coordinates, so the mesh is watertight by position. A pole is a single position; each triangle of its fan has a
// separate copy, whose u is the middle of the triangle. Thread-safety: a pure function.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/mesh/mesh.h"
#include "core/mesh/mesh_normals.h"
#include "core/platform/error.h"

namespace fieldtrace::mesh_grid {

// Bounds memory (about 2 GB of mesh) and keeps indices far below 2^32. Shared by all generators.
inline constexpr uint64_t k_max_triangles = uint64_t(1) << 26;

struct GridShape {
  int columns = 0, rows = 0;  // cells along u and v
  bool wrap_u = false, wrap_v = false;
  bool poles = false;  // row 0 and the last row are single points
};

struct SurfacePoint {
  DVec3 position = DVec3(0.0);
  DVec3 normal = DVec3(0.0);  // of any length; ignored with smooth normals
};

enum class GridNormals { given, smooth };

inline void require(bool legal, const std::string& message) {
  if (!legal) throw UsageError(message);
}

// Requires a whole number in [least, most]. `option`: of `fieldtrace mesh`.
inline void require_count(const char* mesh, const char* option, int64_t value, int64_t least, int64_t most) {
  require(value >= least && value <= most, std::string(mesh) + ": " + option + " is " + std::to_string(value) +
                                               ", it must be between " + std::to_string(least) + " and " +
                                               std::to_string(most));
}

inline void require_triangles(const char* mesh, uint64_t count) {
  require(count <= k_max_triangles, std::string(mesh) + ": " + std::to_string(count) + " triangles are more than " +
                                        std::to_string(k_max_triangles) + ", lower the resolution");
}

// Requires a float in [least, most]; NaN is refused.
void require_range(const char* mesh, const char* option, double value, double least, double most);

inline uint64_t triangle_count(const GridShape& g) {
  return 2 * uint64_t(g.columns) * (uint64_t(g.rows) - (g.poles ? 1 : 0));
}

// surface(i, j) -> SurfacePoint at u = i / columns, v = j / rows; called once per distinct point. Triangles run
// anticlockwise seen from the side of d/du x d/dv. Unchecked: columns, rows >= 1 (3 where that direction is closed, 2
// rows with poles), finite points.
template <class Surface>
TriangleMesh build(const GridShape& g, GridNormals normals, const Surface& surface) {
  TriangleMesh mesh;
  std::vector<uint32_t> weld;
  const int first_row = g.poles ? 1 : 0, last_row = g.poles ? g.rows - 1 : g.rows;
  const uint32_t stride = uint32_t(g.columns) + 1;
  const size_t vertices = size_t(last_row - first_row + 1) * stride + (g.poles ? 2 * size_t(g.columns) : 0);
  mesh.positions.reserve(vertices);
  mesh.normals.reserve(vertices);
  mesh.texcoords.reserve(vertices);
  mesh.triangles.reserve(triangle_count(g));
  if (normals == GridNormals::smooth) weld.reserve(vertices);

  const auto add = [&](const SurfacePoint& p, const Vec2& uv) {
    if (normals == GridNormals::smooth) weld.push_back(uint32_t(mesh.positions.size()));
    mesh.positions.push_back(Vec3(p.position));
    mesh.normals.push_back(normals == GridNormals::given ? Vec3(glm::normalize(p.normal)) : Vec3(0.0f));
    mesh.texcoords.push_back(uv);
  };
  const auto add_copy = [&](uint32_t of, const Vec2& uv) {
    if (normals == GridNormals::smooth) weld.push_back(weld[of]);
    mesh.positions.push_back(Vec3(mesh.positions[of]));
    mesh.normals.push_back(Vec3(mesh.normals[of]));
    mesh.texcoords.push_back(uv);
  };

  for (int j = first_row; j <= last_row; ++j) {
    const uint32_t row = uint32_t(j - first_row) * stride;
    const float v = float(j) / float(g.rows);
    for (int i = 0; i <= g.columns; ++i) {
      const Vec2 uv(float(i) / float(g.columns), v);
      if (g.wrap_v && j == g.rows) {
        add_copy(uint32_t(i), uv);
      } else if (g.wrap_u && i == g.columns) {
        add_copy(row, uv);
      } else {
        add(surface(i, j), uv);
      }
    }
  }
  for (int j = first_row; j < last_row; ++j) {
    for (int i = 0; i < g.columns; ++i) {
      const uint32_t a = uint32_t(j - first_row) * stride + uint32_t(i), b = a + 1, c = b + stride, d = a + stride;
      mesh.triangles.push_back({a, b, c});
      mesh.triangles.push_back({a, c, d});
    }
  }
  if (g.poles) {
    for (const bool top : {false, true}) {
      const uint32_t ring = top ? uint32_t(last_row - first_row) * stride : 0;
      const uint32_t pole = uint32_t(mesh.positions.size());
      for (int i = 0; i < g.columns; ++i) {
        const Vec2 uv((float(i) + 0.5f) / float(g.columns), top ? 1.0f : 0.0f);
        if (i == 0) {
          add(surface(0, top ? g.rows : 0), uv);
        } else {
          add_copy(pole, uv);
        }
        const uint32_t a = ring + uint32_t(i), b = a + 1, p = pole + uint32_t(i);
        mesh.triangles.push_back(top ? UVec3(a, b, p) : UVec3(b, a, p));
      }
    }
  }
  if (normals == GridNormals::smooth) mesh.normals = vertex_normals(mesh, weld);
  return mesh;
}

// Appends `part`. Unchecked: both meshes have the same attributes (or `mesh` is empty).
void append(TriangleMesh& mesh, const TriangleMesh& part);

}  // namespace fieldtrace::mesh_grid
