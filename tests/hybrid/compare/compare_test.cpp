#include "hybrid/compare/compare.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "core/platform/error.h"

namespace fieldtrace {
namespace {

// Two orders of summing products in double: 1e5 terms of at most 2^-53 each, with room.
constexpr double k_rounding = 1e-11;

Image filled(int width, int height, float value, std::vector<std::string> channels = {"R", "G", "B"}) {
  Image image{width, height, std::move(channels), {}};
  image.data.assign(size_t(width) * height * image.channel_count(), value);
  return image;
}

Image noisy(int width, int height, uint32_t seed) {
  Image image = filled(width, height, 0.0f);
  std::mt19937 random(seed);
  std::lognormal_distribution<float> value(-1.0f, 1.0f);
  for (float& v : image.data) v = value(random);
  return image;
}

TEST(Compare, EqualImagesDoNotDiffer) {
  const Image image = noisy(33, 17, 1);
  const ImageDifference d = compare_images(image, image);
  EXPECT_EQ(d.rmse, 0.0);
  EXPECT_EQ(d.relmse, 0.0);
  EXPECT_EQ(d.mean_relative, 0.0);
  EXPECT_EQ(d.bias, 0.0);
  EXPECT_EQ(d.worst_block_rmse, 0.0);
  EXPECT_TRUE(std::isinf(d.psnr) && d.psnr > 0);
}

TEST(Compare, ConstantOffsetByHand) {
  const ImageDifference d = compare_images(filled(20, 20, 0.75f), filled(20, 20, 0.5f));
  EXPECT_NEAR(d.rmse, 0.25, k_rounding);
  EXPECT_NEAR(d.relmse, 0.0625 / 0.26, k_rounding);
  EXPECT_NEAR(d.mean_relative, 0.25 / 0.51, k_rounding);
  EXPECT_NEAR(d.bias, 0.5, k_rounding);
  EXPECT_NEAR(d.psnr, 12.041199826559248, k_rounding);
  EXPECT_NEAR(d.worst_block_rmse, 0.25, k_rounding);
}

TEST(Compare, AgreesWithAPlainSum) {
  const Image a = noisy(45, 31, 2), b = noisy(45, 31, 3);
  double squared = 0, relative = 0;
  for (size_t i = 0; i < a.data.size(); ++i) {
    const double d = double(a.data[i]) - b.data[i];
    squared += d * d;
    relative += d * d / (double(b.data[i]) * b.data[i] + 0.01);
  }
  const ImageDifference d = compare_images(a, b);
  EXPECT_NEAR(d.rmse, std::sqrt(squared / double(a.data.size())), k_rounding * d.rmse);
  EXPECT_NEAR(d.relmse, relative / double(a.data.size()), k_rounding * d.relmse);
}

TEST(Compare, WorstBlockIsFoundAndDilutedInTheWhole) {
  Image a = filled(64, 48, 1.0f);
  const Image b = a;
  for (int y = 32; y < 48; ++y) {
    for (int x = 16; x < 32; ++x) a.pixel(x, y)[1] += 0.5f;
  }
  const ImageDifference d = compare_images(a, b);
  EXPECT_NEAR(d.worst_block_rmse, 0.5 / std::sqrt(3.0), k_rounding);
  EXPECT_EQ(d.worst_block_x, 16);
  EXPECT_EQ(d.worst_block_y, 32);
  EXPECT_NEAR(d.rmse, 0.5 / std::sqrt(3.0 * 12.0), k_rounding);
}

TEST(Compare, PartialBlockAtTheEdgeCountsItsOwnPixels) {
  Image a = filled(17, 17, 1.0f);
  const Image b = a;
  for (int c = 0; c < 3; ++c) a.pixel(16, 16)[c] = 3.0f;
  const ImageDifference d = compare_images(a, b);
  EXPECT_NEAR(d.worst_block_rmse, 2.0, k_rounding);
  EXPECT_EQ(d.worst_block_x, 16);
  EXPECT_EQ(d.worst_block_y, 16);
}

TEST(Compare, LayersAreLeftOut) {
  const Image a = filled(8, 8, 1.0f);
  Image b = filled(8, 8, 7.0f, {"depth.Z", "B", "G", "R"});
  for (int y = 0; y < 8; ++y) {
    for (int x = 0; x < 8; ++x) {
      for (int c = 1; c < 4; ++c) b.pixel(x, y)[c] = 1.0f;
    }
  }
  EXPECT_EQ(compare_images(a, b).rmse, 0.0);
}

TEST(Compare, NotFiniteIsNeverAccepted) {
  for (const float bad : {float(NAN), float(INFINITY)}) {
    Image a = filled(40, 40, 1.0f);
    a.pixel(20, 3)[2] = bad;
    const ImageDifference d = compare_images(a, filled(40, 40, 1.0f));
    EXPECT_EQ(d.not_finite, 1u);
    EXPECT_FALSE(d.rmse <= 1e30);
    EXPECT_FALSE(d.worst_block_rmse <= 1e30);
    EXPECT_EQ(d.worst_block_x, 16);
  }
}

TEST(Compare, MismatchesAreErrors) {
  EXPECT_THROW(compare_images(filled(4, 4, 0), filled(4, 5, 0)), Error);
  EXPECT_THROW(compare_images(filled(4, 4, 0), filled(5, 4, 0)), Error);
  EXPECT_THROW(compare_images(filled(4, 4, 0, {"Y"}), filled(4, 4, 0)), Error);
  EXPECT_THROW(compare_images(filled(4, 4, 0, {"Y"}), filled(4, 4, 0, {"Y", "A"})), Error);
  EXPECT_THROW(compare_images(Image{}, Image{}), Error);
  EXPECT_EQ(compare_images(filled(4, 4, 1, {"Y"}), filled(4, 4, 1, {"Y"})).rmse, 0.0);
}

TEST(Compare, ACroppedImageHasThePixelsOfItsWindow) {
  const Image a = noisy(7, 5, 8);
  const Image part = cropped(a, {2, 1, 4, 3});
  ASSERT_EQ(part.data.size(), 4u * 3u * 3u);
  for (int y = 0; y < 3; ++y) {
    for (int x = 0; x < 4; ++x) {
      for (int c = 0; c < 3; ++c) EXPECT_EQ(part.pixel(x, y)[c], a.pixel(x + 2, y + 1)[c]);
    }
  }
}

TEST(Compare, AWindowIsComparedAsIfItWereAll) {
  const Image a = noisy(70, 50, 6), b = noisy(70, 50, 7);
  const Rect window = {9, 21, 37, 20};
  const ImageDifference d = compare_images(a, b, window),
                        expected = compare_images(cropped(a, window), cropped(b, window));
  EXPECT_EQ(d.rmse, expected.rmse);
  EXPECT_EQ(d.relmse, expected.relmse);
  EXPECT_EQ(d.bias, expected.bias);
  EXPECT_EQ(d.worst_block_rmse, expected.worst_block_rmse);
  EXPECT_EQ(d.worst_block_x, expected.worst_block_x + window.x);
  EXPECT_EQ(d.worst_block_y, expected.worst_block_y + window.y);
  for (const Rect& bad : {Rect{0, 0, 71, 50}, Rect{-1, 0, 5, 5}, Rect{0, 45, 5, 6}, Rect{3, 3, 0, 4}}) {
    EXPECT_THROW(compare_images(a, b, bad), Error);
  }
}

}  // namespace
}  // namespace fieldtrace
