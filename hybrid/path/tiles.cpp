#include "hybrid/path/tiles.h"

#include <algorithm>

namespace fieldtrace {

std::vector<Rect> make_tiles(const Rect& window, int size) {
  std::vector<Rect> tiles;
  for (int y = 0; y < window.height; y += size) {
    for (int x = 0; x < window.width; x += size) {
      tiles.push_back(
          {window.x + x, window.y + y, std::min(size, window.width - x), std::min(size, window.height - y)});
    }
  }
  return tiles;
}

namespace {

// Calls f(part) for the parts of a tile that lie in one block of the film each, row by row.
template <class F>
void for_each_block(const Rect& tile, int side, const F& f) {
  const auto next = [side](int from, int end) { return std::min(from / side * side + side, end); };
  for (int y = tile.y, bottom = y; y < tile.y + tile.height; y = bottom) {
    bottom = next(y, tile.y + tile.height);
    for (int x = tile.x, right = x; x < tile.x + tile.width; x = right) {
      right = next(x, tile.x + tile.width);
      f(Rect{x, y, right - x, bottom - y});
    }
  }
}

}  // namespace

std::vector<PixelPosition> tile_pixels(const Rect& tile, bool by_blocks) {
  std::vector<PixelPosition> pixels;
  pixels.reserve(size_t(tile.width) * tile.height);
  const auto add = [&](const Rect& part) {
    for (int y = part.y; y < part.y + part.height; ++y) {
      for (int x = part.x; x < part.x + part.width; ++x) pixels.push_back({x, y});
    }
  };
  const auto add_clusters = [&](const Rect& part) { for_each_block(part, k_cluster_side, add); };
  if (by_blocks) {
    for_each_block(tile, k_block_size, add_clusters);
  } else {
    add_clusters(tile);
  }
  return pixels;
}

}  // namespace fieldtrace
