#include "core/mesh/mesh_parts.h"

#include <algorithm>
#include <bit>
#include <numeric>
#include <vector>

namespace fieldtrace {
namespace {

// Sets of numbers, by the least number of each ("union-find", with path halving).
class Sets {
 public:
  explicit Sets(size_t size) : least_(size) { std::iota(least_.begin(), least_.end(), 0u); }

  uint32_t of(uint32_t i) {
    while (least_[i] != i) i = least_[i] = least_[least_[i]];
    return i;
  }
  void join(uint32_t a, uint32_t b) {
    a = of(a), b = of(b);
    least_[std::max(a, b)] = std::min(a, b);
  }
  // Of each number its set's, counted from 0 in the order of their least numbers.
  std::vector<uint32_t> numbers() {
    std::vector<uint32_t> numbers(least_.size());
    uint32_t count = 0;
    for (uint32_t i = 0; i < numbers.size(); ++i) numbers[i] = of(i) == i ? count++ : numbers[of(i)];
    return numbers;
  }

 private:
  std::vector<uint32_t> least_;
};

void join_triangles(const TriangleMesh& mesh, Sets& parts) {
  for (const UVec3& t : mesh.triangles) {
    parts.join(t.x, t.y);
    parts.join(t.x, t.z);
  }
}

// Vertices at the same place, by a table of open addressing.
void join_places(const TriangleMesh& mesh, Sets& parts) {
  const size_t count = mesh.positions.size();
  constexpr uint32_t k_empty = 0xffffffffu;
  std::vector<uint32_t> table(std::bit_ceil(2 * count + 1), k_empty);
  for (uint32_t i = 0; i < count; ++i) {
    const Vec3 p = mesh.positions[i] + 0.0f;  // -0 is 0
    uint32_t hash = 0;
    for (int c = 0; c < 3; ++c) {
      hash = (hash ^ std::bit_cast<uint32_t>(p[c])) * 0x9e3779b1u;
      hash ^= hash >> 15;
    }
    size_t at = hash & (table.size() - 1);
    while (table[at] != k_empty && mesh.positions[table[at]] != p) at = (at + 1) & (table.size() - 1);
    if (table[at] == k_empty) table[at] = i;
    parts.join(table[at], i);
  }
}

double share_of_small(const TriangleMesh& mesh, Sets& parts, float size) {
  const std::vector<uint32_t> numbers = parts.numbers();
  std::vector<Bounds3> bounds;
  for (uint32_t i = 0; i < numbers.size(); ++i) {
    if (numbers[i] == bounds.size()) bounds.emplace_back();
    bounds[numbers[i]].extend(mesh.positions[i]);
  }
  const auto is_small = [&](const Bounds3& b) { return glm::length(b.diagonal()) < size; };
  if (std::none_of(bounds.begin(), bounds.end(), is_small)) return 0.0;
  double small = 0.0, all = 0.0;
  for (const UVec3& t : mesh.triangles) {
    const DVec3 a(mesh.positions[t.x]), b(mesh.positions[t.y]), c(mesh.positions[t.z]);
    const double area = glm::length(glm::cross(b - a, c - a));
    all += area;
    if (is_small(bounds[numbers[t.x]])) small += area;
  }
  return all > 0.0 ? small / all : 0.0;
}

}  // namespace

void drop_unused_vertices(TriangleMesh& mesh) {
  std::vector<bool> is_used(mesh.positions.size());
  for (const UVec3& t : mesh.triangles)
    for (int c = 0; c < 3; ++c) is_used[t[c]] = true;
  if (std::find(is_used.begin(), is_used.end(), false) == is_used.end()) return;
  std::vector<uint32_t> places(is_used.size());
  uint32_t kept = 0;
  for (size_t i = 0; i < places.size(); ++i) {
    if (!is_used[i]) continue;
    places[i] = kept;
    mesh.positions[kept] = mesh.positions[i];
    if (!mesh.normals.empty()) mesh.normals[kept] = mesh.normals[i];
    if (!mesh.texcoords.empty()) mesh.texcoords[kept] = mesh.texcoords[i];
    ++kept;
  }
  mesh.positions.resize(kept);
  if (!mesh.normals.empty()) mesh.normals.resize(kept);
  if (!mesh.texcoords.empty()) mesh.texcoords.resize(kept);
  for (UVec3& t : mesh.triangles)
    for (int c = 0; c < 3; ++c) t[c] = places[t[c]];
}

double share_of_small_parts(const TriangleMesh& mesh, float size) {
  Sets parts(mesh.positions.size());
  join_triangles(mesh, parts);
  const double share = share_of_small(mesh, parts, size);
  if (share == 0.0) return share;
  // Triangles of faceted meshes may share places alone.
  join_places(mesh, parts);
  return share_of_small(mesh, parts, size);
}

}  // namespace fieldtrace
