// Measures of triangle meshes for tests: topology by position, area, volume, normals.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <numeric>
#include <vector>

#include "core/mesh/mesh.h"

namespace fieldtrace::mesh_checks {

// For each position the index of the first bit-identical one (-0 counts as 0).
inline std::vector<uint32_t> weld_positions(const TriangleMesh& mesh) {
  std::vector<uint32_t> order(mesh.positions.size()), weld(order.size());
  std::iota(order.begin(), order.end(), 0u);
  const auto key = [&](uint32_t i) {
    const Vec3 p = mesh.positions[i] + 0.0f;
    return std::array<float, 3>{p.x, p.y, p.z};
  };
  std::stable_sort(order.begin(), order.end(), [&](uint32_t a, uint32_t b) { return key(a) < key(b); });
  for (size_t i = 0; i < order.size(); ++i) {
    const bool same = i > 0 && key(order[i]) == key(order[i - 1]);
    weld[order[i]] = same ? weld[order[i - 1]] : order[i];
  }
  return weld;
}

struct Topology {
  int64_t vertices = 0, edges = 0, faces = 0;
  int64_t border_edges = 0;  // edges of one triangle
  int64_t bad_edges = 0;     // edges that two triangles run along in the same direction, or of three triangles
  int64_t degenerate = 0;    // triangles with two equal positions
  int64_t euler() const { return vertices - edges + faces; }
  bool closed() const { return border_edges == 0 && bad_edges == 0 && degenerate == 0; }
};

inline Topology topology(const TriangleMesh& mesh) {
  const std::vector<uint32_t> weld = weld_positions(mesh);
  Topology t;
  std::vector<uint64_t> edges;  // smaller vertex, larger vertex, direction
  std::vector<uint32_t> used;
  edges.reserve(mesh.triangles.size() * 3);
  for (const UVec3& f : mesh.triangles) {
    const uint32_t v[3] = {weld[f.x], weld[f.y], weld[f.z]};
    if (v[0] == v[1] || v[1] == v[2] || v[2] == v[0]) ++t.degenerate;
    for (int c = 0; c < 3; ++c) {
      const uint32_t a = v[c], b = v[(c + 1) % 3];
      used.push_back(a);
      edges.push_back(uint64_t(std::min(a, b)) << 33 | uint64_t(std::max(a, b)) << 1 | uint64_t(a > b));
    }
  }
  std::sort(edges.begin(), edges.end());
  std::sort(used.begin(), used.end());
  t.vertices = std::unique(used.begin(), used.end()) - used.begin();
  t.faces = int64_t(mesh.triangles.size());
  for (size_t i = 0; i < edges.size();) {
    size_t end = i;
    while (end < edges.size() && edges[end] >> 1 == edges[i] >> 1) ++end;
    ++t.edges;
    if (end - i == 1) {
      ++t.border_edges;
    } else if (end - i != 2 || edges[i] == edges[i + 1]) {
      ++t.bad_edges;
    }
    i = end;
  }
  return t;
}

inline double area(const TriangleMesh& mesh) {
  double sum = 0.0;
  for (const UVec3& t : mesh.triangles) {
    const DVec3 a(mesh.positions[t.x]), b(mesh.positions[t.y]), c(mesh.positions[t.z]);
    sum += 0.5 * glm::length(glm::cross(b - a, c - a));
  }
  return sum;
}

// Signed: positive where triangles are anticlockwise seen from outside. Meaningful for closed meshes.
inline double volume(const TriangleMesh& mesh) {
  double sum = 0.0;
  for (const UVec3& t : mesh.triangles) {
    const DVec3 a(mesh.positions[t.x]), b(mesh.positions[t.y]), c(mesh.positions[t.z]);
    sum += glm::dot(a, glm::cross(b, c)) / 6.0;
  }
  return sum;
}

inline bool finite(const TriangleMesh& mesh) {
  double sum = 0.0;  // not finite if any term is not
  for (const Vec3& p : mesh.positions) sum += 0.0 * (double(p.x) + double(p.y) + double(p.z));
  for (const Vec3& n : mesh.normals) sum += 0.0 * (double(n.x) + double(n.y) + double(n.z));
  for (const Vec2& t : mesh.texcoords) sum += 0.0 * (double(t.x) + double(t.y));
  return sum == 0.0;
}

// Largest deviation of a normal's length from 1.
inline double unit_error(const TriangleMesh& mesh) {
  double worst = 0.0;
  for (const Vec3& n : mesh.normals) worst = std::max(worst, std::abs(glm::length(DVec3(n)) - 1.0));
  return worst;
}

// Share of triangle corners whose normal lies on the triangle's front side; degenerate triangles are left out.
inline double agreeing_corners(const TriangleMesh& mesh) {
  int64_t agree = 0, all = 0;
  for (const UVec3& t : mesh.triangles) {
    const DVec3 a(mesh.positions[t.x]), b(mesh.positions[t.y]), c(mesh.positions[t.z]);
    const DVec3 n = glm::cross(b - a, c - a);
    if (glm::length(n) == 0.0) continue;
    for (int k = 0; k < 3; ++k) {
      ++all;
      agree += glm::dot(n, DVec3(mesh.normals[t[k]])) > 0.0;
    }
  }
  return all ? double(agree) / double(all) : 1.0;
}

inline double farthest(const TriangleMesh& mesh) {
  double r = 0.0;
  for (const Vec3& p : mesh.positions) r = std::max(r, double(glm::length(p)));
  return r;
}

}  // namespace fieldtrace::mesh_checks
