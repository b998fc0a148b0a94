#include "field/bake/tile_lines.h"

#include <algorithm>
#include <thread>

#include "field/bake/cell_lines.h"

namespace fieldtrace {
namespace {

constexpr int k_side = scalar::k_tile_lines;

// Gives a claimed tile back unless it is finished: other threads wait for it.
struct Claim {
  CoverageTiles& tiles;
  uint32_t slot;
  bool finished = false;
  ~Claim() {
    if (!finished) tiles.give_back(slot);
  }
};

}  // namespace

void TileRays::lay(const CoverageTiles& tiles, uint32_t slot, const Sphere& ball, int directions) {
  const CoverageTiles::Place place = tiles.place(slot);
  const CellFrame frame = cell_frame(int(place.direction) / directions, int(place.direction) % directions, directions);
  halves.clear();
  texels.clear();
  rays.resize(CoverageTiles::k_lines_per_tile);
  for (int i = 0; i < k_side * k_side; ++i) {
    const auto line = line_of_texel(frame, place.x + i % k_side, place.y + i / k_side, tiles.lines());
    if (!line) continue;
    const Vec3 entry = line->foot + frame.c * line->half;
    rays.set(texels.size(), ball.centre + entry * ball.radius, -frame.c * ball.radius, 2.0f * line->half);
    texels.push_back(i);
    halves.push_back(line->half);
  }
  rays.resize(texels.size());
}

uint16_t TileRays::line_at(size_t r, float t) const {
  const float code = (halves[r] - t + 1.0f) / scalar::k_coverage_depth_step + 0.5f;
  return uint16_t(1 + std::clamp(int(code), 0, scalar::k_coverage_depths - 1));
}

void bake_tiles(CoverageTiles& tiles, std::span<const uint32_t> slots, const std::function<void(uint32_t)>& bake) {
  // One tile at a time, so that no thread waits for more than one.
  const auto try_bake = [&](uint32_t slot) {
    if (!tiles.claim(slot)) return;
    Claim claim{tiles, slot};
    bake(slot);
    claim.finished = true;
  };
  for (const uint32_t slot : slots) try_bake(slot);
  for (const uint32_t slot : slots) {
    while (!tiles.finished(slot) && !tiles.full()) {
      std::this_thread::yield();
      try_bake(slot);
    }
  }
}

}  // namespace fieldtrace
