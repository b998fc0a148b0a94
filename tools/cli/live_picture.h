// A picture as far as it is rendered, for those who show it meanwhile.
//
// Memory layout: three floats a pixel, row by row. Blocks of k_live_block^2 pixels have versions, so that each reader
// finds what is new to it: nothing is queued, and a reader that falls behind gets the newest pixels of a block once.
// Thread-safety: all functions may be called from any thread; a writer waits for one block's copy at most.
#pragma once

#include <cstdint>
#include <mutex>
#include <span>
#include <vector>

#include "core/math/math.h"
#include "core/scene/scene.h"

namespace fieldtrace {

inline constexpr int k_live_block = 64;

class LivePicture {
 public:
  LivePicture(int width, int height);

  int width() const { return width_; }
  int height() const { return height_; }
  size_t block_count() const { return blocks_.size(); }

  // Sets linear R, G, B of the pixels of `tile`, row by row. Unchecked: `tile` lies within the picture.
  void update(const Rect& tile, std::span<const Rgb> pixels);

  // A block's pixels, if it has changed since its version was `seen` (0: never set), which becomes the new one.
  struct Block {
    Rect rect;
    std::vector<Rgb> pixels;  // row by row
  };
  bool read(size_t block, uint64_t& seen, Block& to) const;

 private:
  const int width_, height_;
  int columns_ = 0;
  mutable std::mutex mutex_;
  std::vector<Rgb> pixels_;
  struct State {
    Rect rect;
    uint64_t version = 0;
  };
  std::vector<State> blocks_;
};

}  // namespace fieldtrace
