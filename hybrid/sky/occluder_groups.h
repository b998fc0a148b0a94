// A tree over what hides the sky, whose nodes know how much a group of occluders hides as seen from afar. What is seen
// of a crowd then costs by what is near: far instances are read as one.
//
// A node's opacity, the part of its box's projection that it covers, is known for k_group_directions^2 directions.
// Where the projections of its children overlap, what they cover is independent of each other. What it hides is taken
// as an elliptic lobe of the extent of its box and of the directions that it is asked for. Memory layout: nodes in
// depth-first order, 2 n - 1 for n occluders. Space: world. Thread-safety: const.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/scene/scene.h"
#include "field/maps/group_lobe.h"

namespace fieldtrace {

inline constexpr int k_group_directions = 8;

struct SkyOccluder;

// The directions that lobes are asked for, radians.
struct GroupGrid {
  float cell_width = 0.0f, part_width = 0.0f;  // of direction cells, and between parts of them
  float block_radius = 0.0f;                   // about the middle of a block of parts (GroupLobe::least_middle)
};

class OccluderGroups {
 public:
  OccluderGroups() = default;
  // `frames`: of D x D direction cells, by whose numbers the occluders have maps.
  OccluderGroups(const Scene& scene, std::span<const SkyOccluder> occluders, int directions);

  // The occluders that points within `place` must read one by one, and lobes that stand for all others, as seen from
  // `from`: of groups whose radius subtends less than a cell's width for the place's points. What lies farther than
  // `most_distance` from all of the place is left out; what may reach across it is near.
  void find(const Sphere& place, const Vec3& from, const GroupGrid& grid, float most_distance,
            std::vector<uint32_t>& near, std::vector<GroupLobe>& far) const;
  uint64_t bytes() const { return nodes_.capacity() * sizeof(Node); }

 private:
  struct Node {
    Vec3 centre, half;       // of its box
    float radius = 0.0f;     // about the centre; infinite where something is known by rays alone
    bool is_planes = false;  // parallelograms alone
    uint32_t next = 0;       // node after its descendants
    uint32_t occluder = 0;   // leaves only
    uint16_t opacity[k_group_directions * k_group_directions] = {};  // of k_opaque
  };

  using Leaves = std::span<Node>;
  // Appends the tree over `leaves`, not empty, and sorts them.
  void build(Leaves leaves);

  std::vector<Node> nodes_;
};

}  // namespace fieldtrace
