#include "core/mesh/mesh_grid.h"

#include <fmt/format.h>

namespace fieldtrace::mesh_grid {

void require_range(const char* mesh, const char* option, double value, double least, double most) {
  // Compared in float, the type of most parameters: 1e-6f is slightly below 1e-6.
  if (!(float(value) >= float(least) && float(value) <= float(most))) {
    throw UsageError(fmt::format("{}: {} is {:g}, it must be between {:g} and {:g}", mesh, option, value, least, most));
  }
}

void append(TriangleMesh& mesh, const TriangleMesh& part) {
  const uint32_t base = uint32_t(mesh.positions.size());
  mesh.positions.insert(mesh.positions.end(), part.positions.begin(), part.positions.end());
  mesh.normals.insert(mesh.normals.end(), part.normals.begin(), part.normals.end());
  mesh.texcoords.insert(mesh.texcoords.end(), part.texcoords.begin(), part.texcoords.end());
  for (const UVec3& t : part.triangles) mesh.triangles.push_back(t + UVec3(base));
}

}  // namespace fieldtrace::mesh_grid
