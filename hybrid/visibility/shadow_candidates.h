// Conservative culling: which instances can stand between a group of shading points and a light.
//
// Space: world. Thread-safety: const after construction.
#pragma once

#include <cstdint>
#include <vector>

#include "core/math/math.h"
#include "core/scene/scene.h"
#include "hybrid/visibility/instance_tree.h"
#include "hybrid/visibility/light_extent.h"

namespace fieldtrace {

class ShadowCandidates {
 public:
  explicit ShadowCandidates(const Scene& scene) : tree_(scene) {}

  // Instances whose bounding ball and box meet the hull of `shading_points` and the light, in index order. Stops after
  // `limit` + 1 of them, which the caller treats as candidate overflow.
  void select(const Bounds3& shading_points, const LightExtent& light, size_t limit,
              std::vector<uint32_t>& instances) const {
    tree_.find(Shaft(shading_points, light), light.instance, limit, instances);
  }
  // Whether select() would find an instance for a shaft; what it finds for a subset of the shading points, it finds for
  // all.
  bool meets(const Shaft& shaft, uint32_t instance) const { return shaft.meets(tree_.bounds(instance)); }

 private:
  InstanceTree tree_;
};

}  // namespace fieldtrace
