// Bias and variance of pictures whose bias and variance are known.
#include "hybrid/compare/error_parts.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "core/platform/error.h"
#include "hybrid/compare/compare.h"

namespace fieldtrace {
namespace {

constexpr int k_width = 48, k_height = 40;

// A picture with noise of this deviation about a truth plus `bias`.
Image picture(std::mt19937& random, double deviation, double bias) {
  Image image{k_width, k_height, {"R", "G", "B"}, {}};
  std::normal_distribution<double> noise(0.0, 1.0);
  for (int y = 0; y < k_height; ++y) {
    for (int x = 0; x < k_width; ++x) {
      for (int c = 0; c < 3; ++c) image.data.push_back(float(0.5 + 0.01 * x + bias + deviation * noise(random)));
    }
  }
  return image;
}

struct Trials {
  double bias_square = 0, variance = 0, reference_variance = 0, mean_square = 0;
  double spread = 0;  // standard deviation of bias_square
  double stated = 0;  // mean of bias_square_error
};

Trials run(double deviation, double reference_deviation, double bias, int pictures, int trials) {
  std::mt19937 random(1);
  Trials sums;
  double squares = 0.0;
  for (int t = 0; t < trials; ++t) {
    std::vector<Image> images;
    for (int k = 0; k < pictures; ++k) images.push_back(picture(random, deviation, bias));
    const Image a = picture(random, reference_deviation, 0.0), b = picture(random, reference_deviation, 0.0);
    const ErrorParts p = split_error(images, a, b);
    sums.bias_square += p.bias_square / trials, sums.variance += p.variance / trials;
    sums.reference_variance += p.reference_variance / trials, sums.mean_square += p.mean_square / trials;
    sums.stated += p.bias_square_error / trials;
    squares += p.bias_square * p.bias_square / trials;
  }
  sums.spread = std::sqrt(squares - sums.bias_square * sums.bias_square);
  return sums;
}

// Bounds are five standard errors of means over the trials.
TEST(ErrorParts, EstimatesHaveNoBiasOfTheirOwn) {
  constexpr int k_trials = 60;
  for (const double bias : {0.0, 0.01, 0.1}) {
    for (const int pictures : {2, 4}) {
      const Trials t = run(0.1, 0.05, bias, pictures, k_trials);
      EXPECT_NEAR(t.bias_square, bias * bias, 5.0 * t.spread / std::sqrt(k_trials)) << bias << " " << pictures;
      // A sample variance of n normal values has a relative standard error of sqrt(2 / (n - 1)).
      const double values = 3.0 * k_width * k_height * k_trials;
      EXPECT_NEAR(t.variance, 0.01, 5.0 * 0.01 * std::sqrt(2.0 / (values * (pictures - 1)))) << bias;
      EXPECT_NEAR(t.reference_variance, 0.5 * 0.0025, 5.0 * 0.5 * 0.0025 * std::sqrt(2.0 / values));
      EXPECT_NEAR(t.mean_square, t.bias_square + t.variance, 1e-12);
      // The stated error is that of the trials, but for its own noise: 9 blocks tell a deviation to a quarter.
      EXPECT_NEAR(t.stated, t.spread, 0.35 * t.spread) << bias;
    }
  }
}

// What is measured against a noisy reference, as `compare` does it, is the sum of all parts.
TEST(ErrorParts, AddUpToWhatCompareMeasures) {
  std::mt19937 random(7);
  std::vector<Image> images;
  for (int k = 0; k < 3; ++k) images.push_back(picture(random, 0.2, 0.05));
  const Image a = picture(random, 0.1, 0.0), b = picture(random, 0.1, 0.0);
  Image reference = a;
  for (size_t i = 0; i < a.data.size(); ++i) reference.data[i] = 0.5f * (a.data[i] + b.data[i]);
  double measured = 0.0;
  for (const Image& image : images) {
    const double rmse = compare_images(image, reference).rmse;
    measured += rmse * rmse / 3.0;
  }
  const ErrorParts p = split_error(images, a, b);
  EXPECT_NEAR(p.mean_square + p.reference_variance, measured, 1e-6 * measured);  // pictures are floats
}

TEST(ErrorParts, EqualPicturesHaveNoVariance) {
  std::mt19937 random(3);
  const Image truth = picture(random, 0.0, 0.0), off = picture(random, 0.0, 0.25);
  const ErrorParts p = split_error({off, off}, truth, truth);
  EXPECT_NEAR(p.variance, 0.0, 1e-12);
  EXPECT_NEAR(p.bias_square, 0.0625, 1e-6);
  EXPECT_NEAR(p.bias_square_error, 0.0, 1e-6);
}

TEST(ErrorParts, WhatCannotBeToldApartIsAnError) {
  std::mt19937 random(4);
  const Image a = picture(random, 0.1, 0.0);
  Image small = cropped(a, {0, 0, 8, 8}), grey = a;
  grey.channels = {"X", "Y", "Z"};
  EXPECT_THROW(split_error({a}, a, a), Error);
  EXPECT_THROW(split_error({a, small}, a, a), Error);
  EXPECT_THROW(split_error({a, a}, a, small), Error);
  EXPECT_THROW(split_error({a, grey}, a, a), Error);
  EXPECT_THROW(split_error({Image{}, Image{}}, Image{}, Image{}), Error);
}

}  // namespace
}  // namespace fieldtrace
