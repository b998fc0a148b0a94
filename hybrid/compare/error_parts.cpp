#include "hybrid/compare/error_parts.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "core/platform/error.h"
#include "hybrid/compare/compare.h"

namespace fieldtrace {

namespace {

// Means over channels, summed over pixels.
struct Sums {
  double bias_square = 0, variance = 0, reference_variance = 0;
  double pixels = 0;

  void add(const Sums& o) {
    bias_square += o.bias_square, variance += o.variance, reference_variance += o.reference_variance;
    pixels += o.pixels;
  }
};

}  // namespace

ErrorParts split_error(const std::vector<Image>& pictures, const Image& reference_1, const Image& reference_2) {
  if (pictures.size() < 2) throw Error("bias and variance need two pictures or more");
  std::vector<const Image*> all = {&reference_1, &reference_2};
  for (const Image& p : pictures) all.push_back(&p);
  std::vector<std::array<int, 3>> channels;
  for (const Image* image : all) {
    const auto colours = colour_channels(*image);
    if (!colours) throw Error("bias and variance are those of the channels R, G and B, and an image lacks one");
    channels.push_back(*colours);
    if (image->width != reference_1.width || image->height != reference_1.height || image->data.empty()) {
      throw Error("bias and variance need pictures of one size");
    }
  }

  const double k = double(pictures.size());
  const auto add_pixel = [&](int x, int y, Sums& sums) {
    for (size_t c = 0; c < 3; ++c) {
      const auto value = [&](size_t i) { return double(all[i]->pixel(x, y)[channels[i][c]]); };
      const double r1 = value(0), r2 = value(1);
      // About the reference, so that squares of small differences do not cancel.
      const double origin = 0.5 * (r1 + r2);
      double sum = 0.0, squares = 0.0;
      for (size_t i = 2; i < all.size(); ++i) {
        const double d = value(i) - origin;
        sum += d, squares += d * d;
      }
      const double a = r1 - origin, b = r2 - origin;
      sums.bias_square += ((sum * sum - squares) / (k * (k - 1.0)) - sum / k * (a + b) + a * b) / 3.0;
      sums.variance += (squares - sum * sum / k) / (k - 1.0) / 3.0;
      sums.reference_variance += 0.25 * (r1 - r2) * (r1 - r2) / 3.0;
    }
    sums.pixels += 1.0;
  };
  Sums total;
  std::vector<Sums> blocks;
  for (int y = 0; y < reference_1.height; y += k_difference_block) {
    for (int x = 0; x < reference_1.width; x += k_difference_block) {
      Sums block;
      for (int v = y; v < std::min(y + k_difference_block, reference_1.height); ++v) {
        for (int u = x; u < std::min(x + k_difference_block, reference_1.width); ++u) add_pixel(u, v, block);
      }
      total.add(block);
      blocks.push_back(block);
    }
  }
  ErrorParts parts;
  parts.bias_square = total.bias_square / total.pixels;
  parts.variance = total.variance / total.pixels;
  parts.reference_variance = total.reference_variance / total.pixels;
  parts.mean_square = parts.bias_square + parts.variance;
  // Of a ratio of sums over blocks.
  double spread = 0.0;
  for (const Sums& b : blocks) {
    const double d = b.bias_square - parts.bias_square * b.pixels;
    spread += d * d;
  }
  const double n = double(blocks.size());
  parts.bias_square_error = n > 1.0 ? std::sqrt(spread * n / (n - 1.0)) / total.pixels : std::nan("");
  return parts;
}

}  // namespace fieldtrace
