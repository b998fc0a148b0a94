#include "field/maps/direction_maps.h"

#include <algorithm>
#include <bit>
#include <vector>

#include "core/platform/parallel.h"
#include "core/platform/stopwatch.h"
#include "field/bake/cell_lines.h"
#include "field/maps/radiance_pyramids.h"

namespace fieldtrace {
namespace {

int32_t level_bytes(int texels, int level) {
  const int n = (texels >> level) + 1;
  return 4 * n * n;
}

int32_t coverage_bytes(int texels) {
  int32_t bytes = 0;
  for (int level = 1; level <= pyramid_levels(texels); ++level) bytes += level_bytes(texels, level);
  return bytes;
}

// What a field file stores together, leaves of 8 directions, are whole.
constexpr int k_least_directions = 4, k_most_directions = 128;

}  // namespace

bool valid_map_size(const MapSize& size) {
  return size.directions >= k_least_directions && size.directions <= k_most_directions &&
         size.directions % k_least_directions == 0 && size.texels >= 8 && size.texels <= 256 &&
         std::has_single_bit(unsigned(size.texels)) && size.lines() < uint64_t(1) << 30;  // 32-bit places
}

DirectionMaps::DirectionMaps(const Sphere& ball, const MapSize& size)
    : ball_(ball),
      size_(size),
      depth_(size.lines() + 2, 0),  // look-ups read four bytes
      coverage_(size.maps() * uint64_t(coverage_bytes(size.texels)), 0) {}

uint64_t DirectionMaps::bytes_of(const MapSize& size) {
  return 2 * size.lines() + size.maps() * uint64_t(coverage_bytes(size.texels));
}

MapsView DirectionMaps::view() const {
  MapsView view;
  view.texels = size_.texels;
  view.levels = pyramid_levels(size_.texels);
  view.depth = reinterpret_cast<const uint8_t*>(depth_.data());
  view.coverage = coverage_.data();
  view.depth_bytes = int32_t(2 * texels_of_map());
  view.coverage_bytes = coverage_bytes(size_.texels);
  view.directions = int32_t(depth_.size() / texels_of_map());
  for (int level = 1, begin = 0; level <= view.levels; ++level) {
    view.level_begin[level - 1] = begin;
    begin += level_bytes(size_.texels, level);
  }
  return view;
}

void DirectionMaps::finish(int direction) {
  const uint16_t* const depth = depths(direction);
  int n = size_.texels;
  std::vector<float> fine(texels_of_map()), coarse;
  for (size_t i = 0; i < fine.size(); ++i) fine[i] = depth[i] ? 255.0f : 0.0f;
  uint8_t* out = &coverage_[size_t(direction) * size_t(coverage_bytes(size_.texels))];
  while (n > 1) {
    const int half = n / 2;
    coarse.resize(size_t(half) * size_t(half));
    for (int y = 0; y < half; ++y) {
      for (int x = 0; x < half; ++x) {
        const float* const two = &fine[size_t(2 * y) * size_t(n) + size_t(2 * x)];
        coarse[size_t(y) * size_t(half) + size_t(x)] = 0.25f * ((two[0] + two[1]) + (two[n] + two[n + 1]));
      }
    }
    n = half;
    fine.swap(coarse);
    const auto texel = [&](int x, int y) {
      if (x < 0 || y < 0 || x >= n || y >= n) return uint8_t(0);
      return uint8_t(fine[size_t(y) * size_t(n) + size_t(x)] + 0.5f);
    };
    for (int j = 0; j <= n; ++j) {
      for (int i = 0; i <= n; ++i) {
        *out++ = texel(i - 1, j - 1);
        *out++ = texel(i, j - 1);
        *out++ = texel(i - 1, j);
        *out++ = texel(i, j);
      }
    }
  }
}

bool bake_maps(DirectionMaps& maps, const Accel& accel, uint32_t shape, const DMat3& to_object,
               const std::atomic<bool>* stop, BakeCounters& counters) {
  const ScopedTimer timer(counters.seconds);
  const MapSize size = maps.size();
  const Sphere ball = maps.ball();
  const bool is_deformed = to_object != DMat3(1.0);
  const auto in_object = [&](const Vec3& v) { return is_deformed ? Vec3(to_object * DVec3(v)) : v; };
  const auto stopped = [&] { return stop && stop->load(std::memory_order_relaxed); };
  std::atomic<uint64_t> traced = 0;
  parallel_for(size_t(size.maps()), [&](size_t direction) {
    if (stopped()) return;
    const CellFrame frame =
        cell_frame(int(direction) / size.directions, int(direction) % size.directions, size.directions);
    const Vec3 along = in_object(-frame.c * ball.radius);
    uint16_t* const depth = maps.depths(int(direction));
    RayBatch rays;
    ShapeHits hits;
    std::vector<size_t> texels;
    std::vector<float> halves;
    rays.resize(size_t(size.texels) * size_t(size.texels));
    // Blocks of 8 x 4 lines keep packets of rays together.
    for (int block = 0; block < size.texels * size.texels / 32; ++block) {
      const int x0 = block % (size.texels / 8) * 8, y0 = block / (size.texels / 8) * 4;
      for (int i = 0; i < 32; ++i) {
        const int column = x0 + i % 8, row = y0 + i / 8;
        const auto line = line_of_texel(frame, column, row, size.texels);
        if (!line) continue;
        const Vec3 entry = line->foot + frame.c * line->half;
        rays.set(texels.size(), in_object(ball.centre + entry * ball.radius), along, 2.0f * line->half);
        texels.push_back(size_t(row) * size_t(size.texels) + size_t(column));
        halves.push_back(line->half);
      }
    }
    rays.resize(texels.size());
    hits.resize(texels.size());
    accel.shape_intersect(shape, rays, hits);
    for (size_t r = 0; r < texels.size(); ++r) {
      if (hits.t[r] < 0.0f) continue;
      const float z = std::clamp(halves[r] - hits.t[r], -1.0f, 1.0f);
      depth[texels[r]] = uint16_t(1.5f + 0.5f * (z + 1.0f) * k_depth_codes);
    }
    maps.finish(int(direction));
    traced += texels.size();
  });
  counters.rays += traced;
  return !stopped();
}

}  // namespace fieldtrace
