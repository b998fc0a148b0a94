// The 32 x 32 parallel lines of a coverage tile as rays, and the loop that shares tiles among baking threads.
//
// Thread-safety: TileRays belongs to one thread; bake_tiles() may be called by any number of threads at once.
#pragma once

#include <functional>
#include <span>
#include <vector>

#include "core/trace/rays.h"
#include "field/store/coverage.h"

namespace fieldtrace {

struct TileRays {
  RayBatch rays;              // object space, away from the light; t = 1 is one ball radius
  std::vector<int> texels;    // of each ray: row * 32 + column; lines outside the ball have none
  std::vector<float> halves;  // depth (field/store/coverage.hd.h) at which each ray begins

  // Sets up the rays of a tile. `ball` is the object's, `directions` is D.
  void lay(const CoverageTiles& tiles, uint32_t slot, const Sphere& ball, int directions);
  // Depth code + 1 of ray r where it hits at t, as TileLines hold it.
  uint16_t line_at(size_t r, float t) const;
};

// Calls bake(slot) for those of `slots` that are not baked yet, each claimed just before, and waits for those that
// other threads are baking; afterwards all are finished, unless the pool is full. A tile whose bake() throws is given
// back.
void bake_tiles(CoverageTiles& tiles, std::span<const uint32_t> slots, const std::function<void(uint32_t)>& bake);

}  // namespace fieldtrace
