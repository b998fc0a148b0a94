// The 32 x 32 parallel lines of a coverage tile as rays, and who bakes which tile.
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
  RayBatch rays;              // object space, from the light's side inwards; t = 1 is one radius
  std::vector<int> texels;    // of each ray: row * 32 + column; lines outside the ball have none
  std::vector<float> halves;  // depth (field/store/coverage.hd.h) at which each ray begins

  // Lays the lines of a tile of an object with that ball, D x D directions.
  void lay(const CoverageTiles& tiles, uint32_t slot, const Sphere& ball, int directions);
  // Depth code + 1 of ray r where it hits at t, as TileLines hold it.
  uint16_t line_at(size_t r, float t) const;
};

// Calls bake(slot) for those of `slots` that nobody has baked, one at a time and claimed before, and waits for those
// that others are baking; afterwards every one is finished, unless the pool is full. What bake() leaves by an exception
// is given back.
void bake_tiles(CoverageTiles& tiles, std::span<const uint32_t> slots, const std::function<void(uint32_t)>& bake);

}  // namespace fieldtrace
