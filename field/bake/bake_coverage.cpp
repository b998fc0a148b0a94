#include "field/bake/bake_coverage.h"

#include "core/platform/stopwatch.h"
#include "field/bake/tile_lines.h"

namespace fieldtrace {

void bake_coverage(Field& field, std::span<const uint32_t> slots, const Accel& accel, uint32_t shape,
                   BakeCounters& counters) {
  const ScopedTimer timer(counters.seconds);
  CoverageTiles& tiles = field.coverage();
  TileRays rays;
  ShapeHits hits;
  TileLines lines;
  bake_tiles(tiles, slots, [&](uint32_t slot) {
    rays.lay(tiles, slot, field.ball(), field.parameters().directions);
    const size_t count = rays.texels.size();
    lines.assign(CoverageTiles::k_lines_per_tile, 0);
    hits.resize(count);
    if (count > 0) accel.shape_intersect(shape, rays.rays, hits);
    counters.rays += count;
    for (size_t r = 0; r < count; ++r) {
      if (hits.t[r] >= 0.0f) lines[size_t(rays.texels[r])] = rays.line_at(r, hits.t[r]);
    }
    tiles.finish(slot, lines);
  });
}

}  // namespace fieldtrace
