#include "core/mesh/mesh_normals.h"

namespace fieldtrace {

std::vector<Vec3> vertex_normals(const TriangleMesh& mesh, const std::vector<uint32_t>& weld) {
  const auto vertex = [&](uint32_t i) { return weld.empty() ? i : weld[i]; };
  // In double: facets far smaller than the square root of the smallest float must not underflow.
  std::vector<DVec3> sums(mesh.positions.size(), DVec3(0.0));
  std::vector<uint32_t> first(mesh.positions.size(), 0);  // 1 + the first facet of non-zero area; 0: none

  const auto facet = [&](const UVec3& t, DVec3(&p)[3]) {
    for (int c = 0; c < 3; ++c) p[c] = DVec3(mesh.positions[t[c]]);
    return glm::cross(p[1] - p[0], p[2] - p[0]);
  };
  for (size_t i = 0; i < mesh.triangles.size(); ++i) {
    const UVec3& t = mesh.triangles[i];
    DVec3 p[3];
    const DVec3 cross = facet(t, p);
    const double twice_area = glm::length(cross);
    if (!(twice_area > 0.0)) continue;
    const DVec3 n = cross / twice_area;
    for (int c = 0; c < 3; ++c) {
      // The cross product of any two edges has the same length, so one arctangent gives the angle.
      const float dot = float(glm::dot(p[(c + 1) % 3] - p[c], p[(c + 2) % 3] - p[c]) / twice_area);
      const uint32_t v = vertex(t[c]);
      sums[v] += double(std::atan2(1.0f, dot)) * n;
      if (first[v] == 0) first[v] = uint32_t(i) + 1;
    }
  }

  std::vector<Vec3> normals(mesh.positions.size());
  // Residue of exactly cancelling facets: a few roundings of angles (float) that add up to at most 2 pi, and a few
  // around it. Below it the direction is noise.
  constexpr double k_cancelled = double(gamma_bound(8)) * 2.0 * double(k_pi);
  for (size_t i = 0; i < normals.size(); ++i) {
    const uint32_t v = vertex(uint32_t(i));
    DVec3 n = sums[v];
    double length = glm::length(n);
    if (!(length > k_cancelled) && first[v] != 0) {
      DVec3 p[3];
      n = facet(mesh.triangles[first[v] - 1], p);
      length = glm::length(n);
    }
    normals[i] = first[v] != 0 ? glm::normalize(Vec3(n / length)) : Vec3(0.0f, 0.0f, 1.0f);
  }
  return normals;
}

void compute_vertex_normals(TriangleMesh& mesh) { mesh.normals = vertex_normals(mesh); }

}  // namespace fieldtrace
