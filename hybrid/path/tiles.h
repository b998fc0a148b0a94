// Cuts the picture into tiles, the unit of parallel work. Thread-safety: pure functions.
#pragma once

#include <vector>

#include "core/scene/scene.h"

namespace fieldtrace {

// Pixels along each side of a render's tiles.
inline constexpr int k_tile_size = 32;

// Tiles of at most size x size pixels that cover `window`, row by row. size >= 1; an empty window has no tiles.
std::vector<Rect> make_tiles(const Rect& window, int size);

// Pixels along each side of the blocks of the film within which irradiance is fitted (hybrid/light/pixel_blocks.h);
inline constexpr int k_block_size = 8;
// and of those whose shading points form clusters where rays alone answer (hybrid/light/shading_clusters.h).
inline constexpr int k_cluster_side = 4;
static_assert(k_block_size % k_cluster_side == 0);

// The pixels of a tile in the film's blocks of 4 x 4, so that 16 consecutive camera rays are coherent in both
// directions. by_blocks: these in blocks of k_block_size.
struct PixelPosition {
  int x = 0, y = 0;
};
std::vector<PixelPosition> tile_pixels(const Rect& tile, bool by_blocks = false);

inline bool in_one_block(const PixelPosition& a, const PixelPosition& b, int size = k_block_size) {
  return a.x / size == b.x / size && a.y / size == b.y / size;
}

inline bool contains(const Rect& r, const PixelPosition& p) {
  return p.x >= r.x && p.y >= r.y && p.x < r.x + r.width && p.y < r.y + r.height;
}

}  // namespace fieldtrace
