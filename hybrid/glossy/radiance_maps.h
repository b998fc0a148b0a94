// Prefiltered radiance maps of one instance, along each direction of a coarse octahedral map: coverage tiles
// (field/store/coverage.h) whose lines carry what the surface sends along them. Tiles are baked by demand, from
// radiance that is shaded once (hybrid/glossy/surface_radiance.h), so that most lines cost a ray and no shadows.
//
// Space: unit space of the instance's object. Thread-safety: bake() from any number of threads at once.
#pragma once

#include <span>

#include "core/trace/accel.h"
#include "field/query/segment_kernels.h"
#include "field/store/coverage.h"
#include "hybrid/glossy/surface_radiance.h"

namespace fieldtrace {

class RadianceMaps {
 public:
  // Direction cells along each side of the map: lobes are wide beside them.
  static constexpr int k_directions = 32;
  // Lines along each side of a picture, 2 N, where so many glossy rays or more share the maps; N / 2 else. Finer
  // ones leave fewer rays to be traced, and cost four times as much to bake.
  static constexpr int k_plane = 64;
  static constexpr uint64_t k_many_rays = uint64_t(1) << 25;

  // `shading` must outlive this: SurfaceRadiance.
  // Bytes of complete maps, without their tables and patches.
  static uint64_t tile_bytes(uint64_t most_rays);
  // Surface patches that the constructor will make.
  static uint64_t count_patches(const Scene& scene, uint32_t instance, uint64_t most_rays);
  RadianceMaps(const TransportContext& shading, uint32_t instance, uint64_t most_rays);

  uint32_t instance() const { return radiance_.instance(); }
  const SurfaceRadiance& radiance() const { return radiance_; }
  const CoverageTiles& tiles() const { return tiles_; }
  // The object, its maps as a field of coverage alone.
  const ConeTask& task() const { return task_; }

  // As bake_coverage(); the surface that the lines meet is shaded, which is counted in `stats` with the bake.
  void bake(std::span<const uint32_t> slots, Stats& stats);

 private:
  const Scene& scene_;
  const Accel& accel_;
  Sphere ball_;
  CoverageTiles tiles_;
  SurfaceRadiance radiance_;
  ConeTask task_;
};

}  // namespace fieldtrace
