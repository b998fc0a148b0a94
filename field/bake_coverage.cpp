#include "field/bake_coverage.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <thread>

#include "field/lines.h"

namespace fieldtrace {
namespace {

constexpr int k_side = scalar::k_tile_lines;

uint16_t depth_code(float depth) {
  const float code = (depth + 1.0f) / scalar::k_coverage_depth_step + 0.5f;
  return uint16_t(std::clamp(int(code), 0, scalar::k_coverage_depths - 1));
}

class TileBaker {
 public:
  TileBaker(Field& field, const Accel& accel, uint32_t shape, BakeCounters& counters)
      : field_(field), accel_(accel), shape_(shape), counters_(counters) {}

  // False if the pool is full.
  bool bake(uint32_t slot) {
    CoverageTiles& tiles = field_.coverage();
    const CoverageTiles::Place place = tiles.place(slot);
    const int directions = field_.parameters().directions;
    const CellFrame frame =
        cell_frame(int(place.direction) / directions, int(place.direction) % directions, directions);
    const Sphere& ball = field_.ball();
    const float step = 2.0f / float(tiles.lines());
    lines_.assign(CoverageTiles::k_lines_per_tile, 0);
    halves_.clear();
    texels_.clear();
    rays_.resize(CoverageTiles::k_lines_per_tile);
    for (int i = 0; i < k_side * k_side; ++i) {
      const float x = (float(place.x + i % k_side) + 0.5f) * step - 1.0f;
      const float y = (float(place.y + i / k_side) + 0.5f) * step - 1.0f;
      const float half_squared = 1.0f - (x * x + y * y);
      if (half_squared <= 0.0f) continue;  // outside the ball
      const float half = std::sqrt(half_squared);
      const Vec3 entry = frame.s * x + frame.t * y + frame.c * half;
      rays_.set(texels_.size(), ball.centre + entry * ball.radius, -frame.c * ball.radius, 2.0f * half);
      texels_.push_back(i);
      halves_.push_back(half);
    }
    rays_.resize(texels_.size());
    hits_.resize(texels_.size());
    if (!texels_.empty()) accel_.shape_intersect(shape_, rays_, hits_);
    counters_.rays += texels_.size();
    for (size_t r = 0; r < texels_.size(); ++r) {
      if (hits_.t[r] >= 0.0f) lines_[size_t(texels_[r])] = uint16_t(1 + depth_code(halves_[r] - hits_.t[r]));
    }
    return tiles.finish(slot, lines_);
  }

 private:
  Field& field_;
  const Accel& accel_;
  uint32_t shape_;
  BakeCounters& counters_;
  RayBatch rays_;
  ShapeHits hits_;
  TileLines lines_;
  std::vector<int> texels_;
  std::vector<float> halves_;
};

// Gives a claimed tile back unless it was finished: other threads wait for it.
struct Claim {
  CoverageTiles& tiles;
  uint32_t slot;
  bool finished = false;
  ~Claim() {
    if (!finished) tiles.give_back(slot);
  }
};

}  // namespace

void bake_coverage(Field& field, std::span<const uint32_t> slots, const Accel& accel, uint32_t shape,
                   BakeCounters& counters) {
  const auto start = std::chrono::steady_clock::now();
  CoverageTiles& tiles = field.coverage();
  TileBaker baker(field, accel, shape, counters);
  // One tile at a time, so that nobody waits for more than one.
  const auto try_bake = [&](uint32_t slot) {
    if (!tiles.claim(slot)) return;
    Claim claim{tiles, slot};
    baker.bake(slot);
    claim.finished = true;
  };
  for (const uint32_t slot : slots) try_bake(slot);
  for (const uint32_t slot : slots) {
    while (!tiles.finished(slot) && !tiles.full()) {
      std::this_thread::yield();
      try_bake(slot);
    }
  }
  counters.seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

}  // namespace fieldtrace
