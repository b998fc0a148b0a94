// Indexed triangle meshes in object space.
//
// Memory layout: one array per attribute; normals and texture coordinates are empty or one per position.
// Thread-safety: a value; const use from any number of threads.
#pragma once

#include <string>
#include <vector>

#include "core/math/math.h"

namespace fieldtrace {

struct TriangleMesh {
  std::vector<Vec3> positions;
  std::vector<Vec3> normals;    // shading normals, unit length; empty: use the geometric normal
  std::vector<Vec2> texcoords;  // empty: barycentric coordinates are used as (u, v)
  std::vector<UVec3> triangles;

  Bounds3 bounds() const {
    Bounds3 b;
    for (const Vec3& p : positions) b.extend(p);
    return b;
  }
};

}  // namespace fieldtrace
