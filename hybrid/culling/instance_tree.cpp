#include "hybrid/culling/instance_tree.h"

#include <algorithm>
#include <cmath>

namespace fieldtrace {
namespace {

// Instances in a leaf. Testing a node costs as much as testing an instance, so small leaves cull more for the same
// price.
constexpr uint32_t k_leaf_size = 2;

// A radius computed in double with a few roundings encloses its object after this factor: 8 of 2^-53, with room.
constexpr double k_enclosing = 1.0 + 0x1p-49;

bool is_finite(const Bounds3& b) {
  return std::isfinite(glm::dot(DVec3(b.lower), DVec3(1.0))) && std::isfinite(glm::dot(DVec3(b.upper), DVec3(1.0)));
}

BallAndBox instance_bounds(const Scene& scene, const Instance& instance) {
  BallAndBox b;
  b.box = world_bounds(scene.shapes[instance.shape].bounds, instance.to_world);
  if (is_finite(b.box)) {
    const DVec3 lower(b.box.lower), upper(b.box.upper);
    b.centre = 0.5 * (lower + upper);
    b.radius = 0.5 * glm::length(upper - lower) * k_enclosing;
  } else {
    // Beyond the range of floats: the object may be anywhere.
    b.radius = double(k_infinity);
    b.box = {Vec3(-k_infinity), Vec3(k_infinity)};
  }
  return b;
}

}  // namespace

InstanceTree::InstanceTree(const Scene& scene) {
  bounds_.reserve(scene.instances.size());
  for (const Instance& instance : scene.instances) bounds_.push_back(instance_bounds(scene, instance));
  order_.resize(bounds_.size());
  for (uint32_t i = 0; i < order_.size(); ++i) order_[i] = i;
  if (!order_.empty()) build(0, uint32_t(order_.size()));
}

InstanceTree::CentreRange InstanceTree::centres(uint32_t begin, uint32_t end) const {
  CentreRange range;
  range.lower = range.upper = bounds_[order_[begin]].centre;
  for (uint32_t i = begin + 1; i < end; ++i) {
    range.lower = glm::min(range.lower, bounds_[order_[i]].centre);
    range.upper = glm::max(range.upper, bounds_[order_[i]].centre);
  }
  return range;
}

BallAndBox InstanceTree::enclose(uint32_t begin, uint32_t end) const {
  BallAndBox all;
  const CentreRange range = centres(begin, end);
  all.centre = 0.5 * (range.lower + range.upper);
  for (uint32_t i = begin; i < end; ++i) {
    const BallAndBox& b = bounds_[order_[i]];
    all.box.extend(b.box);
    all.radius = std::max(all.radius, glm::length(b.centre - all.centre) + b.radius);
  }
  all.radius *= k_enclosing;
  return all;
}

void InstanceTree::build(uint32_t begin, uint32_t end) {
  const size_t node = nodes_.size();
  nodes_.push_back({enclose(begin, end), 0, begin, end - begin});
  if (end - begin > k_leaf_size) {
    nodes_[node].count = 0;
    const CentreRange range = centres(begin, end);
    const DVec3 extent = range.upper - range.lower;
    const int axis = extent.x >= extent.y && extent.x >= extent.z ? 0 : extent.y >= extent.z ? 1 : 2;
    const uint32_t middle = begin + (end - begin) / 2;
    std::nth_element(order_.begin() + begin, order_.begin() + middle, order_.begin() + end,
                     [&](uint32_t a, uint32_t b) {
                       const double x = bounds_[a].centre[axis], y = bounds_[b].centre[axis];
                       return x != y ? x < y : a < b;
                     });
    build(begin, middle);
    build(middle, end);
  }
  nodes_[node].next = uint32_t(nodes_.size());
}

void InstanceTree::find(const Shaft& shaft, uint32_t left_out, size_t limit, std::vector<uint32_t>& instances) const {
  instances.clear();
  for (uint32_t n = 0; n < nodes_.size();) {
    const Node& node = nodes_[n];
    if (!shaft.meets_some(node.bounds)) {
      n = node.next;
      continue;
    }
    for (uint32_t i = node.first; i < node.first + node.count; ++i) {
      const uint32_t instance = order_[i];
      if (instance == left_out || !shaft.meets(bounds_[instance])) continue;
      instances.push_back(instance);
      if (instances.size() > limit) {
        std::sort(instances.begin(), instances.end());
        return;
      }
    }
    ++n;
  }
  std::sort(instances.begin(), instances.end());
}

}  // namespace fieldtrace
