// An object seen along every cell of a grid of directions: depth maps, and mipmaps of their coverage.
//
// For a direction c of the chart (field/chart/chart.hd.h, D x D cells, number u D + v), parallel lines along c, one for
// each of T x T texels of [-1, 1]^2 in the frame (s, t) of c, look down at the object from its +c side. The depth of
// the highest hit tells what hides light that arrives along -c from a point anywhere on the line; the mipmaps of
// coverage tell what share of a wide footprint is hidden from points below the object.
//
// Unlike a field (field/store/field.h) these are baked whole and certify nothing: what is read is an estimate.
// Space: unit space, as fields. Memory layout: maps_view.h. Thread-safety: const once finished.
#pragma once

#include <atomic>
#include <cstdint>

#include "core/math/math.h"
#include "core/platform/aligned_vector.h"
#include "core/trace/accel.h"
#include "field/bake/bake.h"
#include "field/maps/maps_view.h"

namespace fieldtrace {

struct MapSize {
  int directions = 32;  // D, a multiple of 4 in [4, 128]
  int texels = 64;      // T, a power of two in [8, 256]
  uint64_t maps() const { return uint64_t(directions) * uint64_t(directions); }
  uint64_t lines() const { return maps() * uint64_t(texels) * uint64_t(texels); }
  bool operator==(const MapSize&) const = default;
};

bool valid_map_size(const MapSize& size);

class DirectionMaps {
 public:
  // Empty maps of an object within `ball` (object space). Throws std::bad_alloc.
  DirectionMaps(const Sphere& ball, const MapSize& size);

  static uint64_t bytes_of(const MapSize& size);
  const Sphere& ball() const { return ball_; }
  const MapSize& size() const { return size_; }
  uint64_t bytes() const { return bytes_of(size_); }
  MapsView view() const;

  // The depths of one direction, row by row (maps_view.h). To be filled for all before finish().
  uint16_t* depths(int direction) { return &depth_[size_t(direction) * texels_of_map()]; }
  const uint16_t* depths(int direction) const { return &depth_[size_t(direction) * texels_of_map()]; }
  // Makes the coverage of one direction from its depths.
  void finish(int direction);

 private:
  size_t texels_of_map() const { return size_t(size_.texels) * size_t(size_.texels); }

  Sphere ball_;
  MapSize size_;
  AlignedVector<uint16_t> depth_;
  AlignedVector<uint8_t> coverage_;
};

// Traces all lines of object `shape` of `accel`, in parallel. `to_object`: from the space of the maps' ball to the
// object's, if the object is seen deformed. Returns false if `stop` (may be null) was set meanwhile;
// the maps are then incomplete.
bool bake_maps(DirectionMaps& maps, const Accel& accel, uint32_t shape, const DMat3& to_object,
               const std::atomic<bool>* stop, BakeCounters& counters);

}  // namespace fieldtrace
