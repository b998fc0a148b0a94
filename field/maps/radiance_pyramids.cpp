#include "field/maps/radiance_pyramids.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace fieldtrace {
namespace {

size_t words_of_pyramid(int texels) {
  size_t words = 0;
  for (int n = texels; n >= 2; n /= 2) words += size_t(n) * size_t(n);
  return words;
}

struct Texel {
  Rgb sum = Rgb(0.0f);
  float weight = 0.0f;
};

uint32_t code_of(const Rgb& radiance, float per_root) {
  uint32_t word = 0;
  for (int c = 0; c < 3; ++c) {
    const float code = std::sqrt(std::max(radiance[c], 0.0f)) * per_root + 0.5f;
    word |= uint32_t(std::min(code, float(k_radiance_codes))) << (10 * c);
  }
  return word;
}

}  // namespace

RadiancePyramids::RadiancePyramids(int texels, int count)
    : texels_(texels), words_(size_t(count) * words_of_pyramid(texels), 0u) {}

uint64_t RadiancePyramids::bytes_of(int texels, int count) {
  return uint64_t(count) * words_of_pyramid(texels) * sizeof(uint32_t);
}

RadianceView RadiancePyramids::view() const {
  RadianceView view;
  view.texels = texels_;
  view.levels = pyramid_levels(texels_);
  view.words = reinterpret_cast<const uint8_t*>(words_.data());
  view.bytes = int32_t(words_of_pyramid(texels_) * sizeof(uint32_t));
  view.count = int32_t(words_.size() / words_of_pyramid(texels_));
  view.scale = scale_;
  int32_t begin = 0;
  for (int level = 0; level < view.levels; ++level) {
    view.level_begin[level] = begin;
    const int n = texels_ >> level;
    begin += int32_t(sizeof(uint32_t)) * n * n;
  }
  return view;
}

void RadiancePyramids::set_most(float radiance) {
  scale_ = radiance / (float(k_radiance_codes) * float(k_radiance_codes));
}

void RadiancePyramids::fill(int i, std::span<const Rgb> radiance, std::span<const uint8_t> is_known) {
  const int levels = pyramid_levels(texels_);
  std::vector<std::vector<Texel>> pyramid(static_cast<size_t>(levels));
  pyramid[0].resize(radiance.size());
  for (size_t t = 0; t < radiance.size(); ++t) {
    if (is_known[t]) pyramid[0][t] = {radiance[t], 1.0f};
  }
  for (int level = 1; level < levels; ++level) {
    const auto n = size_t(texels_ >> level);
    const std::vector<Texel>& fine = pyramid[size_t(level) - 1];
    std::vector<Texel>& coarse = pyramid[size_t(level)];
    coarse.resize(n * n);
    for (size_t t = 0; t < coarse.size(); ++t) {
      const size_t first = t / n * 4 * n + t % n * 2;
      for (const size_t from : {first, first + 1, first + 2 * n, first + 2 * n + 1}) {
        coarse[t].sum += fine[from].sum, coarse[t].weight += fine[from].weight;
      }
    }
  }
  // Unknown texels become those of the level above.
  Texel all;
  for (const Texel& t : pyramid.back()) all.sum += t.sum, all.weight += t.weight;
  for (int level = levels - 1; level >= 0; --level) {
    const auto n = size_t(texels_ >> level);
    std::vector<Texel>& texels = pyramid[size_t(level)];
    for (size_t t = 0; t < texels.size(); ++t) {
      if (texels[t].weight > 0.0f) continue;
      texels[t] = level + 1 < levels ? pyramid[size_t(level) + 1][t / n / 2 * (n / 2) + t % n / 2] : all;
    }
  }
  const float per_root = scale_ > 0.0f ? 1.0f / std::sqrt(scale_) : 0.0f;
  uint32_t* out = &words_[size_t(i) * words_of_pyramid(texels_)];
  for (const std::vector<Texel>& texels : pyramid) {
    for (const Texel& t : texels) *out++ = t.weight > 0.0f ? code_of(t.sum / t.weight, per_root) : 0u;
  }
}

}  // namespace fieldtrace
