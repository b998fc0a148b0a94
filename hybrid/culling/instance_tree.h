// A bounding volume hierarchy over a scene's instances, to find those that reach into a shaft without testing each.
//
// Split at the median of the longest extent of the centres, down to a few instances: the same scene gives the same
// tree. Memory layout: nodes in depth-first order, each with the node to continue at when its bounds are missed, so
// that a query is one loop without a stack. Space: world. Thread-safety: const after construction.
#pragma once

#include <cstdint>
#include <vector>

#include "core/scene/scene.h"
#include "hybrid/culling/shaft.h"

namespace fieldtrace {

class InstanceTree {
 public:
  explicit InstanceTree(const Scene& scene);

  // Instances except `left_out` whose bounds meet the shaft, in index order. The search ends once limit + 1 are found
  // (always the same ones).
  void find(const Shaft& shaft, uint32_t left_out, size_t limit, std::vector<uint32_t>& instances) const;

  // Bounds of one instance, as find() tests them. `instance` is unchecked.
  const BallAndBox& bounds(uint32_t instance) const { return bounds_[instance]; }

 private:
  struct Node {
    BallAndBox bounds;
    uint32_t next = 0;              // node to continue at when this one is missed
    uint32_t first = 0, count = 0;  // leaves only: their instances in order_
  };

  struct CentreRange {
    DVec3 lower, upper;
  };

  // [begin, end): a range of order_, not empty.
  void build(uint32_t begin, uint32_t end);
  CentreRange centres(uint32_t begin, uint32_t end) const;
  BallAndBox enclose(uint32_t begin, uint32_t end) const;

  std::vector<BallAndBox> bounds_;  // by instance
  std::vector<uint32_t> order_;
  std::vector<Node> nodes_;
};

}  // namespace fieldtrace
