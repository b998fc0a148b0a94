// Blocks of 8 x 8 and 4 x 4 pixels within which the irradiance of a sky is linear: it is asked for at six pixels of a
// block, and fitted to the others by least squares (after Ward, Rubinstein, Clear, "A Ray Tracing Solution for Diffuse
// Interreflection", SIGGRAPH 1988, with a test in place of an a-priori bound).
//
// A block is tried if its pixels see one surface without creases. The six, a pentagon and its middle, show every
// function of second degree; the block stands if they agree with the fit. Otherwise its quarters are tried, then each
// pixel is asked for. What was asked for is kept. Which blocks there are depends on the pixels alone, as long as blocks
// are whole (CameraSamples::whole_blocks). Thread-safety: belongs to one thread.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "core/light/shading_points.h"
#include "hybrid/path/tiles.h"

namespace fieldtrace {

// What arrives at a surface from a sky: the share of the open sky's irradiance, by channel, and the irradiance of what
// objects send on, in units of the open sky's luminance.
struct SkyArrival {
  static constexpr int k_channels = 6;
  std::array<float, k_channels> values = {};

  SkyArrival& operator+=(const SkyArrival& other) {
    for (size_t c = 0; c < k_channels; ++c) values[c] += other.values[c];
    return *this;
  }
  friend SkyArrival operator+(SkyArrival a, const SkyArrival& b) { return a += b; }
  friend SkyArrival operator*(float weight, SkyArrival a) {
    for (float& v : a.values) v *= weight;
    return a;
  }
};

// Points of a block that are asked for first.
inline constexpr size_t k_block_samples = 6;

class PixelBlocks {
 public:
  // Finds blocks among points, of which point i stands for pixel pixels[i]; those of a block are consecutive. Points
  // with different groups[i] share no block, and those of group k_none lie in none. No block is wider than `widest`
  // (world units). Writes the points to ask for first.
  void find(const ShadingPointBatch& points, std::span<const PixelPosition> pixels, std::span<const uint32_t> groups,
            float widest, std::vector<uint32_t>& wanted);

  // Tests blocks with what was asked for. arrivals[i] is known of the points asked for so far, and is set at those of
  // blocks that stand, with fitted[i] = 1. Writes what to ask for next: nothing once all is known.
  void refine(float tolerance, std::span<SkyArrival> arrivals, std::span<uint8_t> fitted,
              std::vector<uint32_t>& wanted);

 private:
  struct Block {
    std::array<uint32_t, k_block_samples> sample = {};  // points
    uint32_t begin = 0, end = 0;                        // of members_
    int side = 8;
  };
  bool add(uint32_t begin, uint32_t end, int side);
  bool is_even(const Block& block) const;
  void split(const Block& block, std::vector<uint32_t>& wanted);
  void want(uint32_t point, std::vector<uint32_t>& wanted);

  const ShadingPointBatch* points_ = nullptr;
  float widest_ = 0.0f;
  std::span<const PixelPosition> pixels_;
  std::vector<uint8_t> asked_;
  std::vector<uint32_t> members_;
  std::vector<Block> blocks_, tried_;
};

}  // namespace fieldtrace
