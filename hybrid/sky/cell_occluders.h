// What may hide which direction cells from a batch of shading points of one instance, set up once for the batch.
//
// Cells under the horizons of all points are left out, and occluders from cells that they cannot reach into; neither
// changes what any point sees by more than about 1e-4 of the sky. Space: world. Thread-safety: belongs to one thread.
#pragma once

#include <span>
#include <vector>

#include "core/light/shading_points.h"
#include "field/maps/cell_kernels.h"
#include "hybrid/sky/sky.h"

namespace fieldtrace {

// Whether a ray from within `from` at most `angle` (radians) off the unit `axis` may meet `ball`.
bool meets_cone(const Sphere& ball, const Sphere& from, const Vec3& axis, float angle);

// What a task refers to of the points' own object.
struct OwnObject {
  OwnLines lines;
  MapRadiance radiance;
};

// What see() works with, resized by it.
struct CellScratch {
  AlignedVector<int32_t> undecided;
  AlignedVector<float> own_hidden, own_near;
};

// A ball about all points.
Sphere ball_about(const ShadingPointBatch& points);

// A batch's points and padding as kernels take them; refers to the batch. grazing: CellPoints::grazing of all.
CellPoints cell_points(const ShadingPointBatch& points, float grazing = 0.0f);

class CellOccluders {
 public:
  // `points` is not empty, all of one instance and one place(); `sky` must outlive what is found.
  void find(const Sky& sky, const ShadingPointBatch& points, const Sphere& place);

  const Sphere& ball() const { return ball_; }  // about the points
  // Cells that may be above a point's horizon; what follows is indexed by their places here.
  std::span<const uint32_t> cells() const { return lit_; }
  // Whether nothing can hide the cell.
  bool is_clear(size_t k) const {
    return !own_ && !bent_ && maps_[k].empty() && planes_[k].empty() && balls_[k].empty() && clear_[k] == 1.0f;
  }
  // The unit direction of the centre of the cell's light.
  Vec3 direction(size_t k) const { return grid_ * light_->directions[lit_[k]]; }
  const SkyCell& cell(size_t k) const { return light_->cells[lit_[k]]; }
  // The task refers to this object and to `own`.
  CellTask task(size_t k, OwnObject& own) const;

  // The kernel of tasks.
  CellKernel kernel_for(Isa isa) const {
    return distance_ < k_infinity ? cell_kernels(isa).see_cell_within : cell_kernels(isa).see_cell;
  }

  // Adds what all cells hide from `points`, those of find() padded to a multiple of k_batch_padding, to `sums`, and
  // calls undecided(task, k, i) for each cell k that is undecided for a point i. Returns the look-ups that it took.
  template <class F>
  uint64_t see(Isa isa, const CellPoints& points, const CellSums& sums, CellScratch& scratch,
               const F& undecided) const {
    const CellKernel kernel = kernel_for(isa);
    scratch.undecided.resize(size_t(points.size) + k_batch_padding);
    scratch.own_hidden.resize(size_t(points.size)), scratch.own_near.resize(size_t(points.size));
    const OwnShares kept = {scratch.own_hidden.data(), scratch.own_near.data()};
    uint64_t lookups = 0;
    size_t kept_of = lit_.size();  // a cell whose shares are kept
    for (size_t k = 0; k < lit_.size(); ++k) {
      if (is_clear(k)) continue;
      OwnObject own;
      CellTask cell = task(k, own);
      const bool is_kept = cell.own && reads_own_alike(kept_of, k);
      if (cell.own && !is_kept && reads_own_alike(k, k + 1)) {
        cell_kernels(isa).see_own(own.lines, points, kept);
        kept_of = k;
      }
      if (is_kept || kept_of == k) cell.own_shares = &kept;
      const int open = kernel(cell, points, sums, scratch.undecided.data());
      lookups += uint64_t(cell.map_count + (cell.own && !is_kept)) * count_;
      for (int j = 0; j < open; ++j) {
        const auto i = uint32_t(scratch.undecided[size_t(j)]);
        if (i >= count_) break;  // padding
        undecided(cell, k, i);
      }
    }
    return lookups;
  }

 private:
  void bound(const ShadingPointBatch& points);
  void find_lit();
  bool is_reached(const SkyOccluder& occluder) const;
  // Whether cells a and b are parts of one, and read the same place of the map of the points' own object.
  bool reads_own_alike(size_t a, size_t b) const;
  bool find_seen_faces(const SkyOccluder& box, const ShadingPointBatch& points);
  void add(const SkyOccluder& occluder, const ShadingPointBatch& points);
  void add_plane(size_t k, const PlaneLines& plane, const PlaneRadiance* radiance);
  // Marks the cells whose direction, in the grid, has at least the product `least` with `to`.
  void find_facing(Vec3 to, float least);
  template <class F>
  void for_facing(const F& each) const;
  void insert(size_t k, const SkyOccluder& occluder, const MapLines& lines);
  void add_far();

  const SkyMaps* sky_ = nullptr;
  const SkyCells* light_ = nullptr;
  const IndirectLight* indirect_ = nullptr;
  const SkyOccluder* own_ = nullptr;  // the points' own object, if it can hide anything from them
  bool bent_ = false;                 // CellTask::bent
  float distance_ = k_infinity;       // Sky::distance()
  Mat3 grid_ = Mat3(1.0f);
  size_t count_ = 0;  // of points
  Sphere ball_;
  Vec3 mean_normal_ = Vec3(0.0f);
  float normal_sine_ = 0.0f, normal_cosine_ = 1.0f;  // of the angle between it and the farthest normal
  std::vector<uint32_t> lit_;
  std::vector<float> lit_x_, lit_y_, lit_z_;  // their directions, in the grid
  std::vector<float> clear_;                  // CellTask::clear: 0 where a parallelogram hides all
  std::vector<uint32_t> near_;
  std::vector<GroupLobe> lobes_;
  AlignedVector<float> far_clear_;  // share that these leave of each part of a cell
  AlignedVector<int32_t> far_blocks_;
  std::vector<uint8_t> faces_;
  struct SeenFace {
    int face;
    PlaneLines plane;
  };
  std::vector<SeenFace> seen_faces_;  // of a box
  std::vector<std::vector<MapLines>> maps_;
  std::vector<std::vector<MapRadiance>> radiance_;  // of these, if indirect_
  std::vector<std::vector<PlaneLines>> planes_;
  std::vector<std::vector<BallLines>> balls_;
};

}  // namespace fieldtrace
