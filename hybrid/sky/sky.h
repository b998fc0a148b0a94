// A sky, what hides it, and what comes back from there: the radiance of direction cells in the grid of each instance.
// Thread-safety: const.
#pragma once

#include <algorithm>
#include <deque>
#include <mutex>

#include "hybrid/sky/indirect_light.h"
#include "hybrid/sky/sky_maps.h"
#include "hybrid/sky/sky_radiance.h"

namespace fieldtrace {

// Cells whose light varies are divided so often along each side.
inline constexpr int k_cell_parts = 2;

class Sky {
 public:
  // `maps` must outlive this. What lies farther than `distance` (world units) hides nothing.
  Sky(const SkyMaps& maps, SkyRadiance radiance, float distance = k_infinity)
      : maps_(maps),
        distance_(distance),
        radiance_(std::move(radiance)),
        world_(radiance_.cells(Mat3(1.0f), maps.directions(), k_cell_parts)),
        grids_(maps.is_crowd() ? 0 : maps.occluders().size()) {}

  const SkyMaps& maps() const { return maps_; }
  float distance() const { return distance_; }
  const SkyRadiance& radiance() const { return radiance_; }
  // What objects send back; null: not known.
  const IndirectLight* indirect() const { return indirect_.get(); }
  void set_indirect(std::shared_ptr<const IndirectLight> indirect) { indirect_ = std::move(indirect); }
  // By the cells of the instance's grid (SkyOccluder::cells).
  const SkyCells& cells_of(uint32_t instance) const {
    const SkyOccluder& o = maps_.occluders()[instance];
    if (o.cells == Mat3(1.0f)) return world_;
    Grid& grid = grids_[instance];
    std::call_once(grid.once, [&] { grid.cells = radiance_.cells(o.cells, maps_.directions(), k_cell_parts); });
    return grid.cells;
  }

 private:
  struct Grid {
    std::once_flag once;
    SkyCells cells;
  };

  const SkyMaps& maps_;
  float distance_;
  SkyRadiance radiance_;
  std::shared_ptr<const IndirectLight> indirect_;
  SkyCells world_;
  mutable std::deque<Grid> grids_;  // by instance
};

}  // namespace fieldtrace
