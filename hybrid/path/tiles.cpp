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

std::vector<PixelPosition> tile_pixels(const Rect& tile) {
  std::vector<PixelPosition> pixels;
  pixels.reserve(size_t(tile.width) * tile.height);
  for (const Rect& block : make_tiles(tile, 4)) {
    for (int y = 0; y < block.height; ++y) {
      for (int x = 0; x < block.width; ++x) pixels.push_back({block.x + x, block.y + y});
    }
  }
  return pixels;
}

}  // namespace fieldtrace
