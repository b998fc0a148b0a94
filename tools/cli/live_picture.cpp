#include "tools/cli/live_picture.h"

#include <algorithm>

namespace fieldtrace {

LivePicture::LivePicture(int width, int height)
    : width_(width),
      height_(height),
      columns_((width + k_live_block - 1) / k_live_block),
      pixels_(size_t(width) * size_t(height), Rgb(0.0f)) {
  for (int y = 0; y < height; y += k_live_block) {
    for (int x = 0; x < width; x += k_live_block)
      blocks_.push_back({{x, y, std::min(k_live_block, width - x), std::min(k_live_block, height - y)}, 0});
  }
}

void LivePicture::update(const Rect& tile, std::span<const Rgb> pixels) {
  if (tile.width <= 0 || tile.height <= 0) return;
  const std::lock_guard lock(mutex_);
  for (int y = 0; y < tile.height; ++y) {
    std::copy_n(&pixels[size_t(y) * size_t(tile.width)], tile.width,
                &pixels_[size_t(tile.y + y) * size_t(width_) + size_t(tile.x)]);
  }
  const auto block = [](int pixel) { return pixel / k_live_block; };
  for (int y = block(tile.y); y <= block(tile.y + tile.height - 1); ++y) {
    for (int x = block(tile.x); x <= block(tile.x + tile.width - 1); ++x) ++blocks_[size_t(y * columns_ + x)].version;
  }
}

bool LivePicture::read(size_t block, uint64_t& seen, Block& to) const {
  const std::lock_guard lock(mutex_);
  const State& state = blocks_[block];
  if (state.version == seen) return false;
  seen = state.version;
  to.rect = state.rect;
  to.pixels.clear();
  for (int y = 0; y < state.rect.height; ++y) {
    const Rgb* const row = &pixels_[size_t(state.rect.y + y) * size_t(width_) + size_t(state.rect.x)];
    to.pixels.insert(to.pixels.end(), row, row + state.rect.width);
  }
  return true;
}

}  // namespace fieldtrace
