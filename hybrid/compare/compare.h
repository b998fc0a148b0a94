// Image error metrics: those of every table and of `fieldtrace compare`.
//
// Images are linear radiance. Two colour images are compared over the channels R, G and B, and their further layers are
// ignored; other images over all channels, which must then agree by name. Sums are accumulated in double in a fixed
// order, so the figures do not depend on threads.
// Thread-safety: pure functions.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "core/image/image.h"
#include "core/scene/scene.h"
#include "hybrid/film/noise_sums.h"

namespace fieldtrace {

// Side in pixels of the blocks that `ImageDifference::worst_block_rmse` is taken over.
inline constexpr int k_difference_block = 16;

// a: the image, b: the reference; means are over all pixels and compared channels. A value that is not finite in either
// image makes every figure that it enters NaN.
struct ImageDifference {
  double rmse = 0;           // sqrt(mean((a - b)^2))
  double relmse = 0;         // mean((a - b)^2 / (b^2 + k_relative_floor))
  double psnr = 0;           // 20 log10(1 / rmse), in dB with peak 1; infinite for equal images
  double mean_relative = 0;  // mean(|a - b| / (|b| + k_relative_floor))
  double bias = 0;           // mean(a - b) / mean(b); 0 where the reference's mean is 0
  // Largest RMSE of one block of k_difference_block^2 pixels (fewer at the right and lower edges), and its upper left
  // pixel: field errors are correlated in space, which the RMSE of the whole image hides.
  double worst_block_rmse = 0;
  int worst_block_x = 0, worst_block_y = 0;
  uint64_t not_finite = 0;  // values of either image that are NaN or infinite
};

// Compares the pixels of `window`, or all pixels if there is none; blocks begin at its upper left pixel. Throws Error
// if the sizes differ, if there are no pixels or no channels to compare, or if the window is not inside the images.
ImageDifference compare_images(const Image& image, const Image& reference, const std::optional<Rect>& window = {});

// The pixels of `window`, with all channels. Unchecked: it lies inside the image.
Image cropped(const Image& image, const Rect& window);

// The channels LAYER.NAME of one layer. Throws Error if there are none.
Image layer_of(const Image& image, const std::string& layer);

}  // namespace fieldtrace
