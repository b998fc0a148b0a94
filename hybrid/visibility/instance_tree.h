// A tree of bounds over a scene's instances, to find those that reach into a shaft without asking each.
//
// Halves at the median along the longest extent of the centres, down to a few instances: the same scene gives the same
// tree. Memory layout: nodes in depth-first order, each with the place to go on from when its bounds are missed, so
// that a query is one loop without a stack. Space: world. Thread-safety: const after construction.
#pragma once

#include <cstdint>
#include <vector>

#include "core/scene/scene.h"
#include "hybrid/visibility/shaft.h"

namespace fieldtrace {

class InstanceTree {
 public:
  explicit InstanceTree(const Scene& scene);

  // Instances but `left_out` whose bounds meet the shaft, in index order. Once more than `limit` are found, the search
  // ends with limit + 1 of them (always the same ones).
  void find(const Shaft& shaft, uint32_t left_out, size_t limit, std::vector<uint32_t>& instances) const;

  // Bounds of one instance, as find() tests them. `instance` is unchecked.
  const BallAndBox& bounds(uint32_t instance) const { return bounds_[instance]; }

 private:
  struct Node {
    BallAndBox bounds;
    uint32_t next = 0;              // node to go on from when this one is missed
    uint32_t first = 0, count = 0;  // instances in order_, if any: a leaf
  };

  struct CentreRange {
    DVec3 lower, upper;
  };

  // [begin, end) of order_, not empty.
  void build(uint32_t begin, uint32_t end);
  CentreRange centres(uint32_t begin, uint32_t end) const;
  BallAndBox enclose(uint32_t begin, uint32_t end) const;

  std::vector<BallAndBox> bounds_;  // by instance
  std::vector<uint32_t> order_;
  std::vector<Node> nodes_;
};

}  // namespace fieldtrace
