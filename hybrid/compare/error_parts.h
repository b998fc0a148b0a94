// The mean squared error of a method, told apart into bias and variance by pictures with several seeds.
//
// With pictures x_k, k = 1 ... K, of independent seeds, and a reference in two independent halves r_1, r_2, the square
// of a pixel's bias is estimated by the mean of (x_k - r_1) (x_l - r_2) over all k != l, of which every factor has its
// own noise: its expectation is the bias' square, whatever the noise of pictures and reference. Its mean over pixels
// may be less than 0 where there is little bias. The variance is that of samples, divided by K - 1. Thread-safety: pure
// functions.
#pragma once

#include <vector>

#include "core/image/image.h"

namespace fieldtrace {

// Means over pixels and the channels R, G and B.
struct ErrorParts {
  double mean_square = 0;         // of one picture's error, without the reference's noise: bias_square + variance
  double bias_square = 0;         // unbiased; may be below 0
  double variance = 0;            // of one picture; unbiased
  double reference_variance = 0;  // of the mean of both halves; unbiased
  // Standard error of bias_square, by the spread of its means over blocks of k_difference_block^2 pixels. It counts how
  // bias differs from block to block as well, and so is too large rather than too small.
  double bias_square_error = 0;
};

// Throws Error for fewer than two pictures, for differing sizes, or where a channel is missing.
ErrorParts split_error(const std::vector<Image>& pictures, const Image& reference_1, const Image& reference_2);

}  // namespace fieldtrace
