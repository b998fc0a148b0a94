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
// From this hidden share of the sky on, what is hidden is corrected, from twice as much fully.
inline constexpr float k_least_enclosed = 0.25f;

class Sky {
 public:
  // `maps` must outlive this.
  Sky(const SkyMaps& maps, const Scene& lights)
      : maps_(maps),
        radiance_(lights),
        world_(radiance_.cells(Mat3(1.0f), maps.directions(), k_cell_parts)),
        grids_(maps.is_crowd() ? 0 : maps.occluders().size()) {}

  const SkyMaps& maps() const { return maps_; }
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
  // Cells do not quite add up to the sky; where they take all of it, nothing must be left. What cells hide of it, times
  // this, is what they hide of irradiance(). `hidden_share`: of the sky; `n`: the unit normal of a point of `instance`.
  float hidden_scale(float hidden_share, uint32_t instance, const Vec3& n) const {
    const float weight = std::min((hidden_share - k_least_enclosed) / k_least_enclosed, 1.0f);
    if (!(weight > 0.0f)) return 1.0f;
    return 1.0f + weight * (luminance(radiance_.irradiance(n)) / cells_of(instance).irradiance(n) - 1.0f);
  }

 private:
  struct Grid {
    std::once_flag once;
    SkyCells cells;
  };

  const SkyMaps& maps_;
  SkyRadiance radiance_;
  std::shared_ptr<const IndirectLight> indirect_;
  SkyCells world_;
  mutable std::deque<Grid> grids_;  // by instance
};

}  // namespace fieldtrace
