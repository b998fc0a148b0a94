// Prefiltered radiance maps of one instance, one per direction of a coarse octahedral map: coverage tiles
// (field/store/coverage.h) whose lines also hold the radiance that the surface sends along them. Tiles are baked on
// demand, from radiance that is shaded once (hybrid/glossy/surface_radiance.h), so that most lines cost one ray and no
// shadow rays.
//
// Space: unit space of the instance's object. Thread-safety: bake() may be called from any number of threads at once.
#pragma once

#include <span>

#include "core/trace/accel.h"
#include "field/query/segment_kernels.h"
#include "field/store/coverage.h"
#include "hybrid/glossy/surface_radiance.h"

namespace fieldtrace {

class RadianceMaps {
 public:
  // Direction cells along each side of the octahedral map: coarse, because lobes are wide.
  static constexpr int k_directions = 32;
  // Cells along each side of a map; lines are twice as many. Finer maps leave fewer rays to trace and cost four times
  // as much to bake.
  static constexpr int k_plane = 64;

  // Bytes of complete tiles, without their tables and patches.
  static uint64_t tile_bytes();
  // Surface patches that the constructor would make.
  static uint64_t count_patches(const Scene& scene, uint32_t instance);
  // `shading` (as for SurfaceRadiance) must outlive this.
  RadianceMaps(const TransportContext& shading, uint32_t instance);

  uint32_t instance() const { return radiance_.instance(); }
  const SurfaceRadiance& radiance() const { return radiance_; }
  const CoverageTiles& tiles() const { return tiles_; }
  // The object, with its maps as a field that has coverage only.
  const ConeTask& task() const { return task_; }

  // Like bake_coverage(), but also shades the surface that the lines meet; both are counted in `stats` as baking.
  void bake(std::span<const uint32_t> slots, Stats& stats);

  // What the instance's surface sends back along a ray in world space that met it: what lines hold. Shades it if it is
  // not shaded yet.
  Rgb radiance_at(const HitBatch& hits, size_t i, const Vec3& direction);

 private:
  // Of a surface that a ray of the object's space met: barycentric coordinates of vertices 1 and 2.
  SurfaceRadiance::Side side_at(uint32_t triangle, const Vec2& uv, const Vec3& direction) const;

  const Scene& scene_;
  const Accel& accel_;
  Sphere ball_;
  CoverageTiles tiles_;
  SurfaceRadiance radiance_;
  ConeTask task_;
};

}  // namespace fieldtrace
