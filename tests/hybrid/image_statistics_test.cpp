// The statistics that pictures are tested by, on pictures made of random numbers: what is right is refused no more
// often than stated, and what is wrong is seen.

#include "tests/support/image_statistics.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <random>

#include "core/platform/error.h"
#include "tests/support/field_checks.h"

namespace fieldtrace {
namespace {

using test::Agreement;
using test::agreement;
using test::AgreementOptions;
using test::sampled_picture;
using test::SampledPicture;

constexpr int k_size = 16;

// A slope with an edge in it, so that no two neighbours are equal.
double expected_value(int x, int y, int channel) { return (x > y ? 1.0 : 0.5) + 0.01 * x + 0.02 * y + 0.1 * channel; }

using Noise = std::function<double(std::mt19937&)>;
using Expected = std::function<double(int x, int y, int channel)>;

std::vector<Image> pictures(int count, uint32_t seed, const Noise& noise, const Expected& expected = expected_value) {
  std::mt19937 random(seed);
  std::vector<Image> out;
  for (int i = 0; i < count; ++i) {
    Image image{k_size, k_size, {"R", "G", "B"}, {}};
    for (int y = 0; y < k_size; ++y) {
      for (int x = 0; x < k_size; ++x) {
        for (int c = 0; c < 3; ++c) image.data.push_back(float(expected(x, y, c) + noise(random)));
      }
    }
    out.push_back(std::move(image));
  }
  return out;
}

Noise normal_noise(double deviation) {
  return [=](std::mt19937& random) { return std::normal_distribution<double>(0.0, deviation)(random); };
}
double no_noise(std::mt19937&) { return 0.0; }

// A value of 1 that is seen once in `period` renders.
Noise rare_noise(double period) {
  return [=](std::mt19937& random) { return std::bernoulli_distribution(1.0 / period)(random) ? 1.0 : 0.0; };
}

TEST(ImageStatistics, PValuesAreThoseOfTheTables) {
  EXPECT_NEAR(test::two_sided_p(2.228139, 10), 0.05, 1e-6);
  EXPECT_NEAR(test::two_sided_p(12.7062, 1), 0.05, 1e-6);
  EXPECT_NEAR(test::two_sided_p(3.6460, 30), 0.001, 1e-6);
  EXPECT_NEAR(test::two_sided_p(1.959964, 1e9), 0.05, 1e-6);
  EXPECT_EQ(test::two_sided_p(0.0, 7), 1.0);
  EXPECT_EQ(test::two_sided_p(std::numeric_limits<double>::infinity(), 7), 0.0);
}

TEST(ImageStatistics, SidakThresholdGivesTheLevelBack) {
  EXPECT_DOUBLE_EQ(test::sidak_threshold(0.01, 1), 0.01);
  for (const double tests : {2.0, 100.0, 1e6}) {
    const double p = test::sidak_threshold(0.01, tests);
    EXPECT_NEAR(1.0 - std::exp(tests * std::log1p(-p)), 0.01, 1e-12);
    EXPECT_GT(p, 0.01 / tests);  // milder than Bonferroni's
  }
}

TEST(ImageStatistics, MeanAndVarianceAreUnbiased) {
  std::vector<Image> images(3, Image{1, 1, {"R", "G", "B"}, {1, 2, 3}});
  images[1].data = {4, 2, 3};
  images[2].data = {4, 2, 9};
  const SampledPicture p = sampled_picture(images);
  EXPECT_EQ(p.renders, 3);
  EXPECT_DOUBLE_EQ(p.mean[0], 3.0);
  EXPECT_DOUBLE_EQ(p.variance[0], 3.0);
  EXPECT_EQ(p.variance[1], 0.0);
  EXPECT_DOUBLE_EQ(p.variance[2], 12.0);
  EXPECT_THROW(sampled_picture({images[0]}), Error);
}

TEST(ImageStatistics, ReferenceFilesKeepTheirBits) {
  const test::TemporaryFolder folder;
  const SampledPicture written = sampled_picture(pictures(20, 1, normal_noise(0.1)));
  test::write_reference(folder / "a.exr", written);
  const SampledPicture read = test::read_reference(folder / "a.exr");
  ASSERT_EQ(read.mean.size(), written.mean.size());
  EXPECT_EQ(read.renders, 20);
  for (size_t i = 0; i < read.mean.size(); ++i) {
    EXPECT_NEAR(read.mean[i], written.mean[i], 0x1p-16 * written.mean[i]);
    EXPECT_NEAR(read.variance[i], written.variance[i], 0x1p-8 * written.variance[i]);
  }
  Image other{1, 1, {"R", "G", "B"}, {1, 2, 3}};
  write_image(folder / "b.exr", other);
  EXPECT_THROW(test::read_reference(folder / "b.exr"), Error);
}

// The share of right pictures that are refused.
double refused_share(const Noise& noise_of_picture, const Noise& noise_of_reference, const AgreementOptions& options,
                     int renders) {
  constexpr int k_trials = 400;
  const SampledPicture reference = sampled_picture(pictures(512, 7, noise_of_reference));
  int refused = 0;
  for (int i = 0; i < k_trials; ++i) {
    refused += !agreement(pictures(renders, 100 + i, noise_of_picture), reference, options).passed;
  }
  return double(refused) / k_trials;
}

// Three standard deviations of a share of .1 among 400.
constexpr double k_level = 0.1, k_most_refused = 0.1 + 0.045;

TEST(ImageStatistics, NormalNoiseIsRefusedNoMoreOftenThanStated) {
  AgreementOptions options;
  options.level = k_level;
  EXPECT_LE(refused_share(normal_noise(0.1), normal_noise(0.1), options, 16), k_most_refused);
}

// As a picture of the hybrid may be: nothing but its few renders tells how noisy it is.
TEST(ImageStatistics, NoiseThatTheReferenceDoesNotHaveIsRefusedNoMoreOftenThanStated) {
  AgreementOptions options;
  options.level = k_level;
  options.same_law = false;
  EXPECT_LE(refused_share(normal_noise(0.2), normal_noise(0.1), options, 8), k_most_refused);
}

TEST(ImageStatistics, RareEventsAreRefusedNoMoreOftenThanStated) {
  AgreementOptions options;
  options.level = k_level;
  for (const bool same_law : {true, false}) {
    options.same_law = same_law;
    for (const double period : {20.0, 200.0}) {
      EXPECT_LE(refused_share(rare_noise(period), rare_noise(period), options, 16), k_most_refused) << period;
    }
  }
}

class ImageStatisticsPower : public testing::Test {
 protected:
  Agreement found(const Expected& expected, double deviation = 0.05) const {
    return agreement(pictures(16, 3, normal_noise(deviation), expected), reference_, options_);
  }

  const SampledPicture reference_ = sampled_picture(pictures(512, 7, normal_noise(0.05)));
  AgreementOptions options_;
};

TEST_F(ImageStatisticsPower, TheRightPicturePasses) { EXPECT_TRUE(found(expected_value).passed); }

// Two percent are less than a pixel's noise: the blocks and the whole see them.
TEST_F(ImageStatisticsPower, TwoPercentAreSeen) {
  const Agreement a = found([](int x, int y, int c) { return 1.02 * expected_value(x, y, c); });
  EXPECT_FALSE(a.passed);
  EXPECT_LT(a.least_mean, a.threshold);
  EXPECT_NEAR(a.mean_difference, 0.02, 0.002);
}

TEST_F(ImageStatisticsPower, OnePixelIsSeen) {
  const Agreement a =
      found([](int x, int y, int c) { return expected_value(x, y, c) + (x == 5 && y == 9 && c == 1 ? 0.15 : 0.0); });
  EXPECT_FALSE(a.passed);
  EXPECT_EQ(a.worst_pixel[0], 5);
  EXPECT_EQ(a.worst_pixel[1], 9);
  EXPECT_EQ(a.refused_pixels, 1);
}

TEST_F(ImageStatisticsPower, AShiftByAPixelIsSeen) {
  EXPECT_FALSE(found([](int x, int y, int c) { return expected_value(x + 1, y, c); }).passed);
}

TEST_F(ImageStatisticsPower, NotANumberIsSeen) {
  EXPECT_FALSE(found([](int x, int y, int c) { return x == 3 && y == 3 ? NAN : expected_value(x, y, c); }).passed);
}

// Where nothing is random, the least difference that is no rounding counts.
TEST_F(ImageStatisticsPower, WithoutNoiseNothingIsForgiven) {
  const SampledPicture exact = sampled_picture(pictures(4, 1, no_noise));
  EXPECT_TRUE(agreement(pictures(4, 2, no_noise), exact, options_).passed);
  const auto other = [](int x, int y, int c) { return expected_value(x, y, c) * (x == 2 ? 1.0001 : 1.0); };
  EXPECT_FALSE(agreement(pictures(4, 2, no_noise, other), exact, options_).passed);
}

TEST_F(ImageStatisticsPower, AnAllowanceForgivesWhatItSays) {
  const auto brighter = [](double by) { return [=](int x, int y, int c) { return expected_value(x, y, c) + by; }; };
  options_.allowance = {.pixel = 0.02, .block = 0.02, .mean = 0.02, .rmse = 0.02};
  EXPECT_TRUE(found(brighter(0.018), 0.01).passed);
  const Agreement seen = found(brighter(0.03), 0.01);
  EXPECT_FALSE(seen.passed);
  EXPECT_LT(seen.least_mean, seen.threshold);
  EXPECT_LT(seen.of_rmse, seen.threshold);
  // Each part by itself.
  options_.allowance = {.pixel = 1.0, .block = 1.0, .mean = 1.0, .rmse = 0.02};
  EXPECT_FALSE(found(brighter(0.03), 0.01).passed);
  options_.allowance = {.pixel = 1.0, .block = 1.0, .mean = 0.02};
  EXPECT_FALSE(found(brighter(0.03), 0.01).passed);
  options_.allowance = {.pixel = 1.0, .block = 0.02, .mean = 1.0};
  EXPECT_FALSE(found(brighter(0.04), 0.01).passed);
  options_.allowance = {.pixel = 0.02, .block = 1.0, .mean = 1.0};
  EXPECT_FALSE(found(brighter(0.15), 0.01).passed);
}

TEST_F(ImageStatisticsPower, EvidenceIsWritten) {
  const test::TemporaryFolder folder;
  const std::vector<Image> renders = pictures(16, 3, normal_noise(0.05), [](int x, int y, int c) {
    return expected_value(x, y, c) + (x == 5 && y == 9 ? 1.0 : 0.0);
  });
  const SampledPicture picture = sampled_picture(renders);
  const Agreement a = agreement(renders, reference_, options_);
  const auto paths = test::write_evidence(folder / "new", "scene.method", picture, reference_, a);
  ASSERT_EQ(paths.size(), 8u);
  const Image difference = read_image(folder / "new/scene.method_difference.exr");
  EXPECT_NEAR(difference.pixel(5, 9)[0], 1.0, 0.1);
  EXPECT_LT(read_image(folder / "new/scene.method_p_values.exr").pixel(5, 9)[0], a.threshold);
  // White where refused, dark elsewhere.
  const Image shown = read_image(folder / "new/scene.method_p_values.png");
  EXPECT_EQ(shown.pixel(5, 9)[0], 1.0f);
  EXPECT_LT(shown.pixel(5, 10)[0], 0.9f);
  for (const char* what : {"picture", "reference"}) {
    const Image image = read_image(folder / (std::string("new/scene.method_") + what + ".exr"));
    EXPECT_NEAR(image.pixel(2, 1)[0], expected_value(2, 1, 0), 0.1) << what;
  }
}

}  // namespace
}  // namespace fieldtrace
