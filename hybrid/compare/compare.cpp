#include "hybrid/compare/compare.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "core/platform/error.h"

namespace fieldtrace {

namespace {

// Pairs of channel indices (image, reference).
using ChannelPairs = std::vector<std::pair<int, int>>;

ChannelPairs channels_to_compare(const Image& image, const Image& reference) {
  ChannelPairs pairs;
  const auto colours = colour_channels(image), others = colour_channels(reference);
  if (colours && others) {
    for (size_t c = 0; c < 3; ++c) pairs.emplace_back((*colours)[c], (*others)[c]);
    return pairs;
  }
  for (size_t c = 0; c < image.channel_count(); ++c) {
    pairs.emplace_back(int(c), reference.channel_index(image.channels[c]));
    if (pairs.back().second < 0 || image.channel_count() != reference.channel_count()) {
      throw Error("the images have different channels; compare two colour images, or two with the same layers");
    }
  }
  return pairs;
}

struct Sums {
  double squared = 0, relative_squared = 0, relative = 0, difference = 0, reference = 0;
  uint64_t values = 0, not_finite = 0;

  void add(double a, double b) {
    const double d = a - b;
    squared += d * d;
    relative_squared += d * d / (b * b + k_relative_floor);
    relative += std::abs(d) / (std::abs(b) + k_relative_floor);
    difference += d;
    reference += b;
    values += 1;
    not_finite += (std::isfinite(a) ? 0u : 1u) + (std::isfinite(b) ? 0u : 1u);
  }
  void add(const Sums& o) {
    squared += o.squared;
    relative_squared += o.relative_squared;
    relative += o.relative;
    difference += o.difference;
    reference += o.reference;
    values += o.values;
    not_finite += o.not_finite;
  }
  double rmse() const { return std::sqrt(squared / double(values)); }
};

Sums sum_block(const Image& image, const Image& reference, const ChannelPairs& pairs, const Rect& block) {
  Sums sums;
  for (int y = block.y; y < block.y + block.height; ++y) {
    for (int x = block.x; x < block.x + block.width; ++x) {
      const float* a = image.pixel(x, y);
      const float* b = reference.pixel(x, y);
      for (const auto& [ca, cb] : pairs) sums.add(a[ca], b[cb]);
    }
  }
  return sums;
}

}  // namespace

ImageDifference compare_images(const Image& image, const Image& reference, const std::optional<Rect>& window) {
  if (image.width != reference.width || image.height != reference.height) {
    const auto size = [](const Image& i) { return std::to_string(i.width) + "x" + std::to_string(i.height); };
    throw Error("the image is " + size(image) + " and the reference " + size(reference) +
                " pixels; render both at one size");
  }
  const ChannelPairs pairs = channels_to_compare(image, reference);
  const Rect all = {0, 0, image.width, image.height};
  const Rect w = window.value_or(all);
  if (w.width <= 0 || w.height <= 0 || pairs.empty()) throw Error("there are no pixels to compare");
  if (!is_inside(w, all)) throw Error("the window to compare is not inside the images");

  ImageDifference result;
  result.worst_block_x = w.x, result.worst_block_y = w.y;  // of equal pictures
  Sums total;
  const int end_x = w.x + w.width, end_y = w.y + w.height;
  for (int y = w.y; y < end_y; y += k_difference_block) {
    for (int x = w.x; x < end_x; x += k_difference_block) {
      const Rect part = {x, y, std::min(k_difference_block, end_x - x), std::min(k_difference_block, end_y - y)};
      const Sums block = sum_block(image, reference, pairs, part);
      const double rmse = block.rmse();
      // NaN ranks worst; of several NaN blocks the first is reported.
      const bool worse = std::isnan(rmse) ? !std::isnan(result.worst_block_rmse) : rmse > result.worst_block_rmse;
      if (worse) {
        result.worst_block_rmse = rmse;
        result.worst_block_x = x;
        result.worst_block_y = y;
      }
      total.add(block);
    }
  }
  const double n = double(total.values);
  result.rmse = total.rmse();
  result.relmse = total.relative_squared / n;
  result.psnr = -20.0 * std::log10(result.rmse);
  result.mean_relative = total.relative / n;
  result.bias = total.reference == 0.0 ? 0.0 : total.difference / total.reference;
  result.not_finite = total.not_finite;
  return result;
}

Image cropped(const Image& image, const Rect& window) {
  Image part{window.width, window.height, image.channels, {}};
  part.data.reserve(size_t(window.width) * size_t(window.height) * image.channel_count());
  for (int y = window.y; y < window.y + window.height; ++y) {
    const float* row = image.pixel(window.x, y);
    part.data.insert(part.data.end(), row, row + size_t(window.width) * image.channel_count());
  }
  return part;
}

Image layer_of(const Image& image, const std::string& layer) {
  std::vector<size_t> from;
  for (size_t c = 0; c < image.channel_count(); ++c) {
    if (image.channels[c].starts_with(layer + ".")) from.push_back(c);
  }
  if (from.empty()) throw Error("it has no layer " + layer);
  return select_channels(image, from);
}

}  // namespace fieldtrace
