#include "core/mesh/polygon.h"

#include <algorithm>
#include <cmath>

namespace fieldtrace::mesh_readers {
namespace {

using DVec2 = glm::dvec2;

// Ears take time with the square of the corners, and with their cube at worst.
constexpr size_t k_most_corners = 1024;

struct Corner {
  DVec2 at;
  uint32_t vertex;
};

// Twice the area of a triangle, negative if its corners run clockwise.
double turn(const Corner& a, const Corner& b, const Corner& c) {
  const DVec2 u = b.at - a.at, v = c.at - a.at;
  return u.x * v.y - u.y * v.x;
}

DVec3 area_vector(const std::vector<Vec3>& positions, const UVec3& t) {
  const DVec3 a(positions[t.x]), b(positions[t.y]), c(positions[t.z]);
  return glm::cross(b - a, c - a);
}

// Whether no other corner lies in the triangle of corner i and its neighbours, which turns as the polygon does.
bool is_ear(const std::vector<Corner>& corners, size_t i) {
  const size_t n = corners.size();
  const Corner &a = corners[(i + n - 1) % n], &b = corners[i], &c = corners[(i + 1) % n];
  if (!(turn(a, b, c) > 0.0)) return false;
  return std::none_of(corners.begin(), corners.end(), [&](const Corner& p) {
    // Corners that a keyhole passes twice lie at one place.
    if (p.at == a.at || p.at == b.at || p.at == c.at) return false;
    return turn(a, b, p) >= 0.0 && turn(b, c, p) >= 0.0 && turn(c, a, p) >= 0.0;
  });
}

// A corner on the straight line between its neighbours, or a spike: its triangle has no area and covers nothing.
bool is_flat(const std::vector<Corner>& corners, size_t i) {
  const size_t n = corners.size();
  return turn(corners[(i + n - 1) % n], corners[i], corners[(i + 1) % n]) == 0.0;
}

}  // namespace

bool cut_concave(const std::vector<Vec3>& positions, UVec3* fan, size_t count) {
  DVec3 normal(0.0);
  bool has_area = false;
  for (size_t i = 0; i < count; ++i) {
    const DVec3 area = area_vector(positions, fan[i]);
    normal += area;
    has_area |= area != DVec3(0.0);
  }
  if (normal == DVec3(0.0)) return !has_area;
  if (std::all_of(fan, fan + count,
                  [&](const UVec3& t) { return glm::dot(area_vector(positions, t), normal) >= 0.0; })) {
    return true;
  }
  if (count + 2 > k_most_corners) return false;

  // Along the normal's longest axis, counter-clockwise.
  const DVec3 size = glm::abs(normal);
  const int axis = size.x > size.y && size.x > size.z ? 0 : size.y > size.z ? 1 : 2;
  const int x = (axis + (normal[axis] > 0.0 ? 1 : 2)) % 3, y = (axis + (normal[axis] > 0.0 ? 2 : 1)) % 3;
  std::vector<Corner> corners;
  const auto add = [&](uint32_t vertex) {
    const Vec3& p = positions[vertex];
    corners.push_back({{p[x], p[y]}, vertex});
  };
  add(fan[0].x);
  add(fan[0].y);
  for (size_t i = 0; i < count; ++i) add(fan[i].z);

  std::vector<UVec3> cut;
  size_t i = 0, tried = 0;
  while (corners.size() > 3) {
    const size_t n = corners.size();
    i %= n;
    // Flat ones only where there are no ears: their vertices may be a neighbour's, too.
    if (!is_ear(corners, i) && !(tried >= n && is_flat(corners, i))) {
      if (++tried > 2 * n) return false;
      ++i;
      continue;
    }
    cut.emplace_back(corners[(i + n - 1) % n].vertex, corners[i].vertex, corners[(i + 1) % n].vertex);
    corners.erase(corners.begin() + ptrdiff_t(i));
    tried = 0;
  }
  if (turn(corners[0], corners[1], corners[2]) < 0.0) return false;
  cut.emplace_back(corners[0].vertex, corners[1].vertex, corners[2].vertex);
  std::copy(cut.begin(), cut.end(), fan);
  return true;
}

}  // namespace fieldtrace::mesh_readers
