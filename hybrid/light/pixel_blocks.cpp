#include "hybrid/light/pixel_blocks.h"

#include <algorithm>
#include <cmath>
#include <type_traits>

namespace fieldtrace {
namespace {

// How far normals may lie from their fit, as a length.
constexpr float k_bent_normal = 0.4f;
// How far out samples lie, in sides of the block.
constexpr float k_sample_radius = 0.4f;

struct Offset {
  float x, y;
};

// Where a block's samples lie best: in a pentagon, and in its middle.
struct BlockPlaces {
  explicit BlockPlaces(int side) {
    const float middle = 0.5f * float(side - 1);
    for (size_t s = 0; s + 1 < k_block_samples; ++s) {
      const float angle = 2.0f * k_pi * (0.25f + float(s) / float(k_block_samples - 1));
      const float out = k_sample_radius * float(side);
      targets[s] = {middle + out * std::cos(angle), middle + out * std::sin(angle)};
    }
    targets[k_block_samples - 1] = {middle, middle};
    for (size_t s = 0; s < k_block_samples; ++s) {
      float least = k_infinity;
      for (int i = 0; i < side * side; ++i) {
        const float apart = square_to(s, i % side, i / side);
        if (apart < least) least = apart, nearest[s] = size_t(i);
      }
    }
  }
  float square_to(size_t s, int x, int y) const {
    const float dx = float(x) - targets[s].x, dy = float(y) - targets[s].y;
    return dx * dx + dy * dy;
  }
  std::array<Offset, k_block_samples> targets;
  std::array<size_t, k_block_samples> nearest;  // of all of the block's pixels, row by row
};

const BlockPlaces& places_of(int side) {
  static const BlockPlaces of_8(8), of_4(4);
  return side == 8 ? of_8 : of_4;
}

// A function linear in the pixel's place.
template <class T>
struct Linear {
  T mean, per_x, per_y;
  Offset middle;
  T operator()(const Offset& o) const { return mean + (o.x - middle.x) * per_x + (o.y - middle.y) * per_y; }
};

// Fits functions of that kind to samples.
class LinearFit {
 public:
  explicit LinearFit(std::span<const Offset> at) {
    for (const Offset& o : at) mean_.x += o.x, mean_.y += o.y;
    const auto count = float(at.size());
    mean_.x /= count, mean_.y /= count;
    double xx = 0.0, xy = 0.0, yy = 0.0;
    for (const Offset& o : at) {
      const double x = o.x - mean_.x, y = o.y - mean_.y;
      xx += x * x, xy += x * y, yy += y * y;
    }
    const double determinant = xx * yy - xy * xy;
    is_regular_ = determinant > 0.25 * xx * yy && xx > 0.0 && yy > 0.0;
    if (!is_regular_) return;
    for (size_t i = 0; i < at.size(); ++i) {
      const double x = at[i].x - mean_.x, y = at[i].y - mean_.y;
      x_[i] = float((yy * x - xy * y) / determinant), y_[i] = float((xx * y - xy * x) / determinant);
    }
    share_ = 1.0f / count;
  }
  bool is_regular() const { return is_regular_; }
  // value(i): that of sample i.
  template <class Value>
  auto fit(const Value& value) const {
    using T = std::decay_t<decltype(value(0))>;
    T mean = share_ * value(0), per_x = x_[0] * value(0), per_y = y_[0] * value(0);
    for (size_t i = 1; i < k_block_samples; ++i) {
      const T v = value(i);
      mean += share_ * v, per_x += x_[i] * v, per_y += y_[i] * v;
    }
    return Linear<T>{mean, per_x, per_y, mean_};
  }

 private:
  bool is_regular_ = false;
  Offset mean_ = {0.0f, 0.0f};
  float share_ = 0.0f, x_[k_block_samples] = {}, y_[k_block_samples] = {};
};

Offset offset_of(const PixelPosition& p) { return {float(p.x & 7), float(p.y & 7)}; }

}  // namespace

bool PixelBlocks::is_even(const Block& block) const {
  std::array<Offset, k_block_samples> at;
  for (size_t s = 0; s < k_block_samples; ++s) at[s] = offset_of(pixels_[block.sample[s]]);
  const LinearFit fit(at);
  if (!fit.is_regular()) return false;
  // Beyond a step all samples but some lie near by.
  float nearest = k_infinity, farthest = 0.0f;
  for (size_t s = 0; s + 1 < k_block_samples; ++s) {
    const Vec3 middle = points_->position(block.sample[k_block_samples - 1]);
    const float distance = glm::length(points_->position(block.sample[s]) - middle);
    nearest = std::min(nearest, distance), farthest = std::max(farthest, distance);
  }
  if (farthest > k_sample_radius * widest_) return false;
  const auto position = fit.fit([&](size_t s) { return points_->position(block.sample[s]); });
  const auto shading = fit.fit([&](size_t s) { return points_->shading_normal(block.sample[s]); });
  const auto geometric = fit.fit([&](size_t s) { return points_->geometric_normal(block.sample[s]); });
  const uint32_t members = block.end - block.begin;
  std::array<float, 64> right, down;  // of the samples' middle
  for (uint32_t k = 0; k < members; ++k) {
    const Offset o = offset_of(pixels_[members_[block.begin + k]]);
    right[k] = o.x - position.middle.x, down[k] = o.y - position.middle.y;
  }
  // No member lies farther from where the samples place it than the nearest sample from the middle one.
  const auto count_others = [&](const auto& member) {
    const auto count = [&](const Linear<Vec3>& f, const auto& x, const auto& y, const auto& z, float most) {
      uint32_t others = 0;
      for (uint32_t k = 0; k < members; ++k) {
        const uint32_t i = member(k);
        const float dx = f.mean.x + right[k] * f.per_x.x + down[k] * f.per_y.x - x[i];
        const float dy = f.mean.y + right[k] * f.per_x.y + down[k] * f.per_y.y - y[i];
        const float dz = f.mean.z + right[k] * f.per_x.z + down[k] * f.per_y.z - z[i];
        others += !(dx * dx + dy * dy + dz * dz <= most * most);
      }
      return others;
    };
    const ShadingPointBatch& p = *points_;
    return count(position, p.px.data(), p.py.data(), p.pz.data(), nearest) +
           count(shading, p.sx.data(), p.sy.data(), p.sz.data(), k_bent_normal) +
           count(geometric, p.gx.data(), p.gy.data(), p.gz.data(), k_bent_normal);
  };
  // They ascend; most often they are consecutive points.
  const uint32_t* const member = &members_[block.begin];
  if (member[members - 1] - member[0] == members - 1)
    return count_others([first = member[0]](uint32_t k) { return first + k; }) == 0;
  return count_others([member](uint32_t k) { return member[k]; }) == 0;
}

// Adds members [begin, end), which lie in one block, to tried_ if they may be fitted.
bool PixelBlocks::add(uint32_t begin, uint32_t end, int side) {
  if (end - begin < k_block_samples) return false;
  Block block;
  block.begin = begin, block.end = end, block.side = side;
  const BlockPlaces& places = places_of(side);
  const auto x_of = [&](uint32_t i) { return pixels_[i].x & (side - 1); };
  const auto y_of = [&](uint32_t i) { return pixels_[i].y & (side - 1); };
  if (end - begin == uint32_t(side * side)) {
    std::array<uint32_t, 64> at = {};
    for (uint32_t m = begin; m < end; ++m) at[size_t(y_of(members_[m]) * side + x_of(members_[m]))] = members_[m];
    for (size_t s = 0; s < k_block_samples; ++s) block.sample[s] = at[places.nearest[s]];
  } else {
    for (size_t s = 0; s < k_block_samples; ++s) {
      float least = k_infinity;
      for (uint32_t m = begin; m < end; ++m) {
        const float apart = places.square_to(s, x_of(members_[m]), y_of(members_[m]));
        if (apart < least) least = apart, block.sample[s] = members_[m];
      }
      const auto chosen = block.sample.begin() + s;
      if (least > 2.0f || std::find(block.sample.begin(), chosen, *chosen) != chosen) return false;
    }
  }
  if (!is_even(block)) return false;
  tried_.push_back(block);
  return true;
}

void PixelBlocks::want(uint32_t point, std::vector<uint32_t>& wanted) {
  if (asked_[point]) return;
  asked_[point] = 1;
  wanted.push_back(point);
}

// Tries the quarters of a block, or wants all of it.
void PixelBlocks::split(const Block& block, std::vector<uint32_t>& wanted) {
  const int half = block.side / 2;
  if (half >= 4) {
    const auto begin = members_.begin() + block.begin, end = members_.begin() + block.end;
    const auto is_before = [&](uint32_t a, uint32_t b) {
      const auto quarter = [&](uint32_t i) { return (pixels_[i].y & half) * 2 + (pixels_[i].x & half); };
      return quarter(a) < quarter(b);
    };
    if (!std::is_sorted(begin, end, is_before)) std::stable_sort(begin, end, is_before);
  }
  for (uint32_t begin = block.begin, end = begin; begin < block.end; begin = end) {
    while (end < block.end && (half < 4 || in_one_block(pixels_[members_[begin]], pixels_[members_[end]], half))) ++end;
    if (half >= 4 && add(begin, end, half)) {
      for (const uint32_t i : tried_.back().sample) want(i, wanted);
    } else {
      for (uint32_t m = begin; m < end; ++m) want(members_[m], wanted);
    }
  }
}

void PixelBlocks::find(const ShadingPointBatch& points, std::span<const PixelPosition> pixels,
                       std::span<const uint32_t> groups, float widest, std::vector<uint32_t>& wanted) {
  points_ = &points;
  widest_ = widest;
  pixels_ = pixels;
  asked_.assign(pixels.size(), 0);
  members_.clear(), tried_.clear();
  wanted.clear();
  for (uint32_t begin = 0, end = 0; begin < pixels.size(); begin = end) {
    const auto first = uint32_t(members_.size());
    bool is_one = groups[begin] != k_none;
    for (end = begin; end < pixels.size() && in_one_block(pixels[begin], pixels[end], 8); ++end) {
      is_one = is_one && groups[end] == groups[begin];
      is_one = is_one && (end == begin || pixels[end].x != pixels[end - 1].x || pixels[end].y != pixels[end - 1].y);
      members_.push_back(end);
    }
    const auto last = uint32_t(members_.size());
    if (!is_one) {
      for (uint32_t i = begin; i < end; ++i) want(i, wanted);
    } else if (add(first, last, 8)) {
      for (const uint32_t i : tried_.back().sample) want(i, wanted);
    } else {
      Block block;
      block.begin = first, block.end = last;
      split(block, wanted);
    }
  }
  std::sort(wanted.begin(), wanted.end());
}

void PixelBlocks::refine(float tolerance, std::span<SkyArrival> arrivals, std::span<uint8_t> fitted,
                         std::vector<uint32_t>& wanted) {
  blocks_.swap(tried_);
  tried_.clear();
  wanted.clear();
  for (const Block& block : blocks_) {
    std::array<Offset, k_block_samples> at;
    for (size_t s = 0; s < k_block_samples; ++s) at[s] = offset_of(pixels_[block.sample[s]]);
    const LinearFit fit(at);
    const auto value_at = fit.fit([&](size_t s) { return arrivals[block.sample[s]]; });
    bool stands = true;
    for (size_t s = 0; s < k_block_samples && stands; ++s) {
      const SkyArrival value = value_at(at[s]);
      for (size_t c = 0; c < SkyArrival::k_channels; ++c) {
        stands = stands && std::abs(value.values[c] - arrivals[block.sample[s]].values[c]) <= tolerance;
      }
    }
    if (!stands) {
      split(block, wanted);
      continue;
    }
    for (uint32_t m = block.begin; m < block.end; ++m) {
      const uint32_t i = members_[m];
      if (asked_[i]) continue;
      arrivals[i] = value_at(offset_of(pixels_[i]));
      for (float& v : arrivals[i].values) v = std::max(v, 0.0f);
      fitted[i] = 1;
    }
  }
  std::sort(wanted.begin(), wanted.end());
}

}  // namespace fieldtrace
