#include "hybrid/sky/occluder_groups.h"

#include <algorithm>
#include <cmath>

#include "core/math/frame.h"
#include "field/bake/cell_lines.h"
#include "hybrid/culling/light_extent.h"
#include "hybrid/sky/sky_maps.h"
#include "hybrid/visibility/linear_map.h"

namespace fieldtrace {
namespace {

// Standard deviation of a lobe about a point, in distances of the directions that it is asked for: these then add up to
// its light whatever their place.
constexpr float k_lobe_width = 0.4f;
// Part of a place's radius that adds to what a group subtends.
constexpr float k_place_part = 0.5f;
// Groups of parallelograms that hide more than this of their box are walls: their parts adjoin, and are read one by
// one, as shares of groups multiply.
constexpr float k_solid = 0.9f;
// Texel 0 of a coarsest level of 1 x 1 texels is the lowest byte of its last entry (maps_view.h).
constexpr int k_last_entry = 3 * 4;

constexpr float k_opaque = 65535.0f;
uint16_t opacity_code(float opacity) { return uint16_t(std::clamp(opacity, 0.0f, 1.0f) * k_opaque + 0.5f); }
float opacity_of(uint16_t code) { return float(code) / k_opaque; }

// Area of a box's projection along unit d; of several, by the mean of their components' sizes, the mean.
float projected_area(const Vec3& half, const Vec3& d) {
  return 4.0f * (half.y * half.z * std::abs(d.x) + half.z * half.x * std::abs(d.y) + half.x * half.y * std::abs(d.z));
}

// Mean coverage of [-1, 1]^2 by one map: the only texel of the coarsest level.
float mean_coverage(const MapsView& view, int map) {
  return float(view.coverage[map * view.coverage_bytes + view.level_begin[view.levels - 1] + k_last_entry]) / 255.0f;
}

// Area that an occluder hides along unit d: parallel projections of an object and its image are images of each other.
float covered_area(const SkyOccluder& o, const DMat3& to_unit, const Vec3& d, int directions) {
  const DVec3 u = to_unit * DVec3(d);
  const double length = glm::length(u), scale = length / std::abs(glm::determinant(to_unit));
  if (o.kind == SkyOccluder::Kind::plane) return float(scale * 4.0 * std::abs(u.z) / length);
  return float(scale * 4.0) * mean_coverage(o.view, direction_cell(Vec3(u / length), directions));
}

// Directions of each cell. Its middle alone may lie along a plane, which then hides nothing.
constexpr int k_per_cell = 4;
struct GroupDirections {
  Vec3 in_cell[k_group_directions * k_group_directions][k_per_cell];
  Vec3 mean_size[k_group_directions * k_group_directions];  // mean of their components' absolute values
};

const GroupDirections& group_directions() {
  static const GroupDirections all = [] {
    GroupDirections of;
    for (int k = 0; k < k_group_directions * k_group_directions; ++k) {
      of.mean_size[k] = Vec3(0.0f);
      for (int i = 0; i < k_per_cell; ++i) {
        const float x = i % 2 == 0 ? 0.25f : 0.75f, y = i < 2 ? 0.25f : 0.75f;
        const Vec3 d = direction_in_cell(k / k_group_directions, k % k_group_directions, x, y, k_group_directions);
        of.in_cell[k][i] = d;
        of.mean_size[k] += glm::abs(d) / float(k_per_cell);
      }
    }
    return of;
  }();
  return all;
}

// Of a box of the half extents `half`, radians, as seen along unit d, that takes `solid_angle`.
GroupLobe lobe_of(const Vec3& d, const Vec3& half, float solid_angle, const GroupGrid& grid) {
  const float width = k_lobe_width * grid.part_width;
  const Frame frame = frame_about(d);
  const Vec3 variance = half * half / 3.0f;
  const float ss = glm::dot(frame.s * frame.s, variance) + width * width;
  const float tt = glm::dot(frame.t * frame.t, variance) + width * width;
  const float st = glm::dot(frame.s * frame.t, variance);
  const float determinant = ss * tt - st * st;
  // Along an axis of q the lobe's variance is 7 / 36 of the square of its reach, and it takes 3 / 4 of the ellipse.
  constexpr float k_reach = 36.0f / 7.0f;
  const Vec3 x = std::sqrt(tt / (k_reach * determinant)) * (frame.s - (st / tt) * frame.t);
  const Vec3 y = std::sqrt(1.0f / (k_reach * tt)) * frame.t;
  const float largest = 0.5f * (ss + tt) + std::sqrt(0.25f * (ss - tt) * (ss - tt) + st * st);
  const float reach = std::asin(std::min(std::sqrt(k_reach * largest), 1.0f));
  GroupLobe lobe;
  for (int a = 0; a < 3; ++a) lobe.direction[a] = d[a], lobe.x[a] = x[a], lobe.y[a] = y[a];
  lobe.height = std::min(solid_angle / (0.75f * k_pi * k_reach * std::sqrt(determinant)), 1.0f);
  lobe.least_middle = std::cos(std::min(reach + grid.block_radius, k_pi));
  return lobe;
}

}  // namespace

OccluderGroups::OccluderGroups(const Scene& scene, std::span<const SkyOccluder> occluders, int directions) {
  std::vector<Node> leaves(occluders.size());
  for (uint32_t i = 0; i < leaves.size(); ++i) {
    const SkyOccluder& o = occluders[i];
    const Instance& instance = scene.instances[i];
    const Bounds3 box = world_bounds(scene.shapes[instance.shape].bounds, instance.to_world);
    Node& leaf = leaves[i];
    leaf.centre = box.centre(), leaf.half = 0.5f * box.diagonal();
    leaf.occluder = i;
    leaf.is_planes = o.kind == SkyOccluder::Kind::plane;
    const bool is_known = leaf.is_planes || o.view.coverage;
    leaf.radius = is_known ? glm::length(leaf.half) : k_infinity;
    if (!is_known) continue;
    const DMat3 to_unit = linear_part(o.to_unit);
    for (int k = 0; k < k_group_directions * k_group_directions; ++k) {
      const float area = projected_area(leaf.half, group_directions().mean_size[k]);
      float covered = 0.0f;
      for (const Vec3& d : group_directions().in_cell[k]) covered += covered_area(o, to_unit, d, directions);
      leaf.opacity[k] = opacity_code(area > 0.0f ? covered / (area * float(k_per_cell)) : 0.0f);
    }
  }
  nodes_.reserve(leaves.empty() ? 0 : 2 * leaves.size() - 1);
  if (!leaves.empty()) build(leaves);
}

void OccluderGroups::build(Leaves leaves) {
  const size_t at = nodes_.size();
  nodes_.push_back(leaves[0]);
  if (leaves.size() > 1) {
    Bounds3 centres;
    for (const Node& leaf : leaves) centres.extend(leaf.centre);
    const Vec3 extent = centres.diagonal();
    const int axis = extent.x >= extent.y && extent.x >= extent.z ? 0 : extent.y >= extent.z ? 1 : 2;
    const size_t middle = leaves.size() / 2;
    std::nth_element(leaves.begin(), leaves.begin() + middle, leaves.end(), [&](const Node& a, const Node& b) {
      return a.centre[axis] != b.centre[axis] ? a.centre[axis] < b.centre[axis] : a.occluder < b.occluder;
    });
    const size_t first = nodes_.size();
    build(leaves.first(middle));
    const size_t second = nodes_.size();
    build(leaves.subspan(middle));
    const Node &a = nodes_[first], &b = nodes_[second];
    Node& node = nodes_[at];
    Bounds3 box;
    for (const Node* child : {&a, &b}) box.extend(child->centre - child->half), box.extend(child->centre + child->half);
    node.centre = box.centre(), node.half = 0.5f * box.diagonal();
    node.is_planes = a.is_planes && b.is_planes;
    node.radius = std::isfinite(a.radius + b.radius) ? glm::length(node.half) : k_infinity;
    for (int k = 0; k < k_group_directions * k_group_directions; ++k) {
      const Vec3& d = group_directions().mean_size[k];
      const float area = projected_area(node.half, d);
      if (!(area > 0.0f)) continue;
      const float of_a = projected_area(a.half, d) / area, of_b = projected_area(b.half, d) / area;
      const float opacity_a = opacity_of(a.opacity[k]), opacity_b = opacity_of(b.opacity[k]);
      const float both = opacity_a * opacity_b * std::max(of_a + of_b - 1.0f, 0.0f);
      node.opacity[k] = opacity_code(opacity_a * of_a + opacity_b * of_b - both);
    }
  }
  nodes_[at].next = uint32_t(nodes_.size());
}

void OccluderGroups::find(const Sphere& place, const Vec3& from, const GroupGrid& grid, float most_distance,
                          std::vector<uint32_t>& near, std::vector<GroupLobe>& far) const {
  near.clear(), far.clear();
  for (uint32_t i = 0; i < nodes_.size();) {
    const Node& node = nodes_[i];
    const float distance = glm::length(node.centre - place.centre), reach = node.radius + place.radius;
    if (distance - reach > most_distance) {
      i = node.next;
      continue;
    }
    if (distance + reach <= most_distance && node.radius + k_place_part * place.radius <= grid.cell_width * distance) {
      const Vec3 to = node.centre - from;
      const float length = glm::length(to);
      const Vec3 d = to / length;
      const float opacity = opacity_of(node.opacity[direction_cell(d, k_group_directions)]);
      if (!(node.is_planes && opacity > k_solid)) {
        i = node.next;
        const float solid_angle = opacity * projected_area(node.half, d) / (length * length);
        if (solid_angle > 0.0f) far.push_back(lobe_of(d, node.half / length, solid_angle, grid));
        continue;
      }
    }
    if (node.next == i + 1) near.push_back(node.occluder);
    ++i;
  }
}

}  // namespace fieldtrace
