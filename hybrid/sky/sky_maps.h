// What hides the sky: direction maps of a scene's objects, and how each instance occludes direction cells.
//
// Parallelograms and boxes are known exactly. Other objects are read from direction maps (field/maps) of their shapes
// (mapped_shapes.h). What has none is left to rays: cells that may meet its ball are undecided. Space: world, but for
// the maps.
// Thread-safety: const once baked.
#pragma once

#include <cmath>
#include <memory>
#include <span>
#include <vector>

#include "core/scene/scene.h"
#include "field/maps/cell_task.h"
#include "field/maps/direction_maps.h"
#include "hybrid/sky/mapped_shapes.h"
#include "hybrid/sky/occluder_groups.h"
#include "hybrid/sky/parallelogram.h"

namespace fieldtrace {

// How far the answers of maps are trusted.
struct SkyTolerance {
  float margin = 2.0f;         // texels about a depth within which it is undecided
  float clear_within = 0.25f;  // OwnLines, texels
  float hidden_from = 1.5f;
};

// Far groups are asked for so many directions along each side of a cell.
inline constexpr int k_group_parts = 4;
static_assert(k_group_parts * k_group_parts == k_part_block);

// How an instance hides direction cells.
struct SkyOccluder {
  enum class Kind : uint8_t { plane, box, map, ball };
  Kind kind = Kind::ball;
  bool is_flat = false;  // cannot hide anything from points on it
  bool is_bent = false;  // flat, but not all of its shading normals are the plane's
  uint32_t instance = k_none;
  Sphere ball;             // encloses it
  float half_map = 0.0f;   // half the world extent of its maps
  float to_unit[12] = {};  // world to unit space of the maps, or to the plane's or the box's coordinates; columns
  float height[4] = {};    // of a flat one: world to the distance from its plane; 0 if it has no area
  // Columns: axes of the maps' grid in world space, orthonormal, may mirror; those of the world where there are no
  // maps.
  Mat3 grid = Mat3(1.0f);
  // The same of the direction cells that its points see the sky by: in a crowd the world's, which all share.
  Mat3 cells = Mat3(1.0f);
  MapsView view;
};

class SkyMaps {
 public:
  // Chooses what each instance is. `maps` are those of `shapes`, of D = `directions`.
  SkyMaps(const Scene& scene, std::span<const ShapeTraits> traits, MappedShapes shapes,
          std::vector<std::shared_ptr<DirectionMaps>> maps, int directions, const SkyTolerance& tolerance);

  int directions() const { return directions_; }
  float cell_width() const { return 2.0f * std::sqrt(k_pi) / float(directions_); }  // radians
  const SkyTolerance& tolerance() const { return tolerance_; }
  std::span<const SkyOccluder> occluders() const { return occluders_; }  // by instance
  float median_radius() const { return median_radius_; }                 // of balls about occluders that are no planes
  const MappedShapes& shapes() const { return shapes_; }
  // The frame of direction cell u D + v: columns s, t, c.
  const Mat3& frame(int direction) const { return frames_[size_t(direction)]; }
  // Whether far occluders are read in groups.
  bool is_crowd() const { return place_side_ < k_infinity; }
  // Points of an instance that have the same centre of place() read the same occluders one by one; without a crowd all
  // do.
  Sphere place(uint32_t instance, const Vec3& point) const;
  // As OccluderGroups::find, for directions of parts of a cell; `near` is all occluders if they are no crowd.
  void find(const Sphere& place, const Vec3& from, float distance, std::vector<uint32_t>& near,
            std::vector<GroupLobe>& far) const;
  // Of a crowd: the directions that far groups are asked for, k_group_parts^2 of each cell in turn.
  PartDirections parts() const;
  uint64_t bytes() const;

 private:
  void divide_cells();

  MappedShapes shapes_;
  std::vector<std::shared_ptr<DirectionMaps>> maps_;
  int directions_;
  SkyTolerance tolerance_;
  std::vector<SkyOccluder> occluders_;
  OccluderGroups groups_;                                                           // of a crowd
  AlignedVector<float> part_x_, part_y_, part_z_, middle_x_, middle_y_, middle_z_;  // PartDirections
  GroupGrid grid_;
  float place_side_ = k_infinity, median_radius_ = k_infinity;
  std::vector<Mat3> frames_;
};

}  // namespace fieldtrace
