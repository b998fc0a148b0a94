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

std::vector<PixelPosition> tile_pixels(const Rect& tile, bool by_blocks) {
  std::vector<PixelPosition> pixels;
  pixels.reserve(size_t(tile.width) * tile.height);
  const auto add = [&](const Rect& part) {
    for (const Rect& block : make_tiles(part, 4)) {
      for (int y = 0; y < block.height; ++y) {
        for (int x = 0; x < block.width; ++x) pixels.push_back({block.x + x, block.y + y});
      }
    }
  };
  if (!by_blocks) {
    add(tile);
    return pixels;
  }
  for (int y = tile.y, bottom = y; y < tile.y + tile.height; y = bottom) {
    bottom = std::min(y / k_block_size * k_block_size + k_block_size, tile.y + tile.height);
    for (int x = tile.x, right = x; x < tile.x + tile.width; x = right) {
      right = std::min(x / k_block_size * k_block_size + k_block_size, tile.x + tile.width);
      add({x, y, right - x, bottom - y});
    }
  }
  return pixels;
}

}  // namespace fieldtrace
