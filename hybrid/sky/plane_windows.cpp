#include "hybrid/sky/plane_windows.h"

#include <algorithm>
#include <cmath>

#include "hybrid/sky/affine_rows.h"
#include "hybrid/visibility/linear_map.h"

namespace fieldtrace {
namespace {

// A window covers objects and what lies within so many of their radii, if it is less than this share of the plane.
constexpr float k_window_reach = 2.0f, k_largest_window = 0.25f;
// Of a side of a room, what walls stand on at least: others are screens and furniture.
constexpr float k_least_wall = 0.25f;
// Of lengths: edges that meet; rounding.
constexpr float k_beside = 1e-3f, k_rounding = 1e-5f;

// Of the coordinates of a plane or a box.
Vec3 world_place(const SkyOccluder& o, const DVec3& at) {
  return Vec3(glm::inverse(linear_part(o.to_unit)) * (at - DVec3(o.to_unit[9], o.to_unit[10], o.to_unit[11])));
}

// A stretch of the line on which coordinate `axis` of a plane is `at`, where another one meets it.
struct Cut {
  int axis;
  float at, from, to;
  bool is_at(const Cut& other) const { return axis == other.axis && std::abs(at - other.at) <= k_beside; }
};

// face: corners of a parallelogram, in the plane's coordinates and the height over it. Those that are no higher than
// `least` lie in the plane.
void add_cut(const PlaneCorners& face, const Vec2& per_length, float least, std::vector<Cut>& cuts) {
  float highest = 0.0f;
  for (const Vec3& c : face) highest = std::max(highest, std::abs(c.z));
  if (highest <= least) return;
  const auto side = [&](const Vec3& c) { return std::abs(c.z) <= k_beside * highest ? 0 : c.z < 0.0f ? -1 : 1; };
  std::vector<Vec2> ends;
  constexpr size_t k_ring[5] = {0, 1, 3, 2, 0};
  for (int k = 0; k < 4; ++k) {
    const Vec3 &p = face[k_ring[k]], &q = face[k_ring[k + 1]];
    if (side(p) == 0) ends.push_back(Vec2(p));
    if (side(p) * side(q) < 0) ends.push_back(Vec2(p + (q - p) * (p.z / (p.z - q.z))));
  }
  if (ends.size() != 2) return;
  const Vec2 along = glm::abs(ends[1] - ends[0]) / per_length;
  for (int axis = 0; axis < 2; ++axis) {
    if (!(along[axis] <= k_beside * along[1 - axis])) continue;
    const auto [from, to] = std::minmax(ends[0][1 - axis], ends[1][1 - axis]);
    cuts.push_back({axis, 0.5f * (ends[0][axis] + ends[1][axis]), from, to});
    return;
  }
}

// But for those at the plane's edges, within a texel of `width`.
std::vector<Cut> find_cuts(std::span<const SkyOccluder> all, const SkyOccluder& plane, float width) {
  const Vec2 per_length(glm::length(row_of(plane.to_unit, 0)), glm::length(row_of(plane.to_unit, 1)));
  std::vector<Cut> cuts;
  const auto add = [&](PlaneCorners face) {
    for (Vec3& c : face) c = transform_by(plane.to_unit, c);
    add_cut(face, per_length, k_rounding * plane.ball.radius, cuts);
  };
  for (const SkyOccluder& o : all) {
    if (o.kind == SkyOccluder::Kind::plane && &o != &plane) add(plane_corners(o));
    if (o.kind != SkyOccluder::Kind::box) continue;
    for (int face = 0; face < 6; ++face) {
      PlaneCorners corners;
      for (int k = 0; k < 4; ++k) {
        DVec3 at;
        at[face / 2] = face % 2 == 0 ? 1.0 : -1.0;
        at[(face / 2 + 1) % 3] = k % 2 == 0 ? -1.0 : 1.0, at[(face / 2 + 2) % 3] = k < 2 ? -1.0 : 1.0;
        corners[size_t(k)] = world_place(o, at);
      }
      add(corners);
    }
  }
  const auto is_at_edge = [&](const Cut& c) { return !(std::abs(c.at) <= 1.0f - width); };
  cuts.erase(std::remove_if(cuts.begin(), cuts.end(), is_at_edge), cuts.end());
  return cuts;
}

// The length of the stretches at `wall` that lies between `from` and `to`.
float length_of_wall(std::span<const Cut> cuts, const Cut& wall, float from, float to) {
  std::vector<Vec2> stretches;
  for (const Cut& c : cuts) {
    if (c.is_at(wall)) stretches.emplace_back(std::max(c.from, from), std::min(c.to, to));
  }
  std::sort(stretches.begin(), stretches.end(), [](const Vec2& a, const Vec2& b) { return a.x < b.x; });
  float length = 0.0f, end = from;
  for (const Vec2& s : stretches) {
    length += std::max(s.y - std::max(s.x, end), 0.0f);
    end = std::max(end, s.y);
  }
  return length;
}

// The part of a plane about `middle` between walls.
PlaneWindow room_window(std::vector<Cut> cuts, const Vec2& middle) {
  for (;;) {
    PlaneWindow room;
    for (const Cut& c : cuts) {
      float& lower = room.lower[c.axis];
      float& upper = room.upper[c.axis];
      if (c.at < middle[c.axis]) lower = std::max(lower, c.at);
      if (c.at > middle[c.axis]) upper = std::min(upper, c.at);
    }
    const auto is_no_wall = [&](const Cut& c) {
      if (c.at != room.lower[c.axis] && c.at != room.upper[c.axis]) return false;
      const float from = room.lower[1 - c.axis], to = room.upper[1 - c.axis];
      return length_of_wall(cuts, c, from, to) < k_least_wall * (to - from);
    };
    const auto other = std::find_if(cuts.begin(), cuts.end(), is_no_wall);
    if (other == cuts.end()) return room;
    const Cut at = *other;
    cuts.erase(std::remove_if(cuts.begin(), cuts.end(), [&](const Cut& c) { return c.is_at(at); }), cuts.end());
  }
}

PlaneWindow whole_room(std::span<const SkyOccluder> all, const SkyOccluder& plane, std::span<const Vec3> seen,
                       int texels) {
  std::vector<float> over[2];
  for (const Vec3& p : seen) {
    const Vec3 at = transform_by(plane.to_unit, p);
    if (!(std::abs(at.x) <= 1.0f && std::abs(at.y) <= 1.0f)) continue;
    for (int a = 0; a < 2; ++a) over[a].push_back(at[a]);
  }
  if (over[0].empty()) return {};
  Vec2 middle;
  for (int a = 0; a < 2; ++a) {
    const auto median = over[a].begin() + std::ptrdiff_t(over[a].size() / 2);
    std::nth_element(over[a].begin(), median, over[a].end());
    middle[a] = *median;
  }
  return room_window(find_cuts(all, plane, 2.0f / float(texels)), middle);
}

// The part of a plane about objects and, if wanted, about smaller planes.
PlaneWindow object_window(std::span<const SkyOccluder> all, const SkyOccluder& plane, bool with_planes) {
  PlaneWindow window{Vec2(1.0f), Vec2(-1.0f)};
  const float reach_x = glm::length(row_of(plane.to_unit, 0)), reach_y = glm::length(row_of(plane.to_unit, 1));
  for (const SkyOccluder& o : all) {
    if (o.kind == SkyOccluder::Kind::plane && !(with_planes && o.ball.radius < plane.ball.radius)) continue;
    const Vec3 at = transform_by(plane.to_unit, o.ball.centre);
    const float radius = k_window_reach * o.ball.radius;
    if (std::abs(at.z) > radius) continue;
    window.lower = glm::min(window.lower, Vec2(at.x - radius * reach_x, at.y - radius * reach_y));
    window.upper = glm::max(window.upper, Vec2(at.x + radius * reach_x, at.y + radius * reach_y));
  }
  window.lower = glm::clamp(window.lower, Vec2(-1.0f), Vec2(1.0f));
  window.upper = glm::clamp(window.upper, Vec2(-1.0f), Vec2(1.0f));
  return window;
}

// Of the whole plane; 0 if it is empty.
float share_of(const PlaneWindow& w) {
  const Vec2 size = glm::max(w.upper - w.lower, Vec2(0.0f));
  return 0.25f * size.x * size.y;
}

PlaneWindow overlap(const PlaneWindow& a, const PlaneWindow& b) {
  return {glm::max(a.lower, b.lower), glm::min(a.upper, b.upper)};
}

}  // namespace

PlaneCorners plane_corners(const SkyOccluder& plane) {
  const auto corner = [&](double x, double y) { return world_place(plane, DVec3(x, y, 0.0)); };
  return {corner(-1, -1), corner(1, -1), corner(-1, 1), corner(1, 1)};
}

std::vector<PlaneWindow> plane_windows(std::span<const SkyOccluder> all, const SkyOccluder& plane,
                                       std::span<const Vec3> seen, int texels) {
  const PlaneWindow whole, room = whole_room(all, plane, seen, texels);
  if (share_of(room) < k_largest_window) return {whole, room};
  for (const bool with_planes : {true, false}) {
    const PlaneWindow part = overlap(room, object_window(all, plane, with_planes));
    if (share_of(part) > 0.0f && share_of(part) < k_largest_window) return {whole, part};
  }
  if (share_of(room) < 1.0f) return {whole, room};
  return {whole};
}

}  // namespace fieldtrace
