// FLIP: the values of its authors' evaluator, and its properties.
#include "hybrid/compare/flip.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "core/platform/error.h"

namespace fieldtrace {
namespace {

// The authors' evaluator computes in single precision. What it differs by is largest where features are weak, since
// their difference enters by its square root; 2.3e-5 on these pictures.
constexpr double k_evaluator_rounding = 5e-5;

constexpr int k_width = 40, k_height = 24;

template <class F>
Image make(int width, int height, const F& value) {
  Image image{width, height, {"R", "G", "B"}, {}};
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      for (int c = 0; c < 3; ++c) image.data.push_back(value(x, y, c));
    }
  }
  return image;
}

// Rough and smooth pictures that are the same in every language.
Image rough(int seed, float scale) {
  return make(k_width, k_height, [&](int x, int y, int c) {
    return float((x * x * 7 + y * y * 13 + x * y * 5 + c * 29 + seed * 17) % 64) / 63.0f * scale;
  });
}
Image smooth(float scale) {
  return make(k_width, k_height,
              [&](int x, int y, int c) { return float((x * (c + 1) + y * (3 - c)) % 32) / 31.0f * scale; });
}
Image noise(int width, int height, uint32_t seed, float scale) {
  std::mt19937 random(seed);
  std::lognormal_distribution<float> value(-1.0f, 1.0f);
  return make(width, height, [&](int, int, int) { return scale * value(random); });
}

// Values of PyPI's flip-evaluator 1.7 (evaluate() of linear images, inputsRGB=False, applyMagma=False): the mean, the
// largest error, and those of the pixels (0, 0), (7, 11) and (39, 23).
struct Published {
  const char* name;
  double mean, most, first, inside, last;
};

void expect_published(const Published& p, const FlipMap& map) {
  ASSERT_EQ(map.errors.size(), size_t(k_width) * k_height);
  EXPECT_NEAR(map.mean, p.mean, k_evaluator_rounding) << p.name;
  EXPECT_NEAR(*std::max_element(map.errors.begin(), map.errors.end()), p.most, k_evaluator_rounding) << p.name;
  EXPECT_NEAR(map.errors.front(), p.first, k_evaluator_rounding) << p.name;
  EXPECT_NEAR(map.errors[11 * k_width + 7], p.inside, k_evaluator_rounding) << p.name;
  EXPECT_NEAR(map.errors.back(), p.last, k_evaluator_rounding) << p.name;
}

TEST(Flip, LdrIsThatOfTheEvaluator) {
  const Image a = rough(1, 1.0f), s = smooth(0.5f);
  expect_published({"rough", 0.448942631, 0.9472116, 0.6528431, 0.19834992, 0.8548495}, ldr_flip(rough(2, 1.0f), a));
  expect_published({"smooth", 0.155261621, 0.19915017, 0.08552335, 0.13745281, 0.19915017}, ldr_flip(smooth(0.45f), s));
  expect_published({"mixed", 0.727440417, 0.97118145, 0.97118145, 0.9253884, 0.70136636}, ldr_flip(s, a));
  expect_published({"from near", 0.894784272, 0.98628396, 0.9805533, 0.9692899, 0.5942589}, ldr_flip(s, a, 20.0));
}

TEST(Flip, HdrIsThatOfTheEvaluator) {
  const Image a = rough(1, 8.0f), s = smooth(10.0f);
  expect_published({"rough", 0.385916740, 0.8507883, 0.5629048, 0.19857739, 0.42097402}, hdr_flip(rough(2, 8.0f), a));
  expect_published({"smooth", 0.108224943, 0.15693176, 0.14201055, 0.122097425, 0.11969053}, hdr_flip(smooth(9.0f), s));
  expect_published({"mixed", 0.582257032, 0.9795561, 0.9795561, 0.77527034, 0.38709763}, hdr_flip(s, a));
  expect_published({"from near", 0.779995799, 0.9884321, 0.9857089, 0.9146917, 0.7282029}, hdr_flip(s, a, {}, 20.0));
  expect_published({"given exposures", 0.644569516, 0.9796404, 0.9796404, 0.80238533, 0.6838503},
                   hdr_flip(s, a, FlipExposures{-3.0, 1.0, 4}));
}

TEST(Flip, ExposuresAreThoseOfTheEvaluator) {
  const auto row = [](std::vector<float> values) {
    return make(int(values.size()), 1, [&](int x, int, int) { return values[size_t(x)]; });
  };
  struct Case {
    std::vector<float> values;
    double start, stop;
    int count;
  };
  const Case cases[] = {{{1, 2, 3, 4}, -0.9167028, -0.5016654, 2},
                        {{5, 1, 4, 2, 3}, -1.2386309, -0.5016654, 2},
                        {{0, 0, 0, 4}, -0.9167028, 24.0832977, 25},
                        {{0, 0, 0, 4, 5}, -1.2386309, 24.0832977, 26}};
  for (const Case& c : cases) {
    const FlipExposures e = flip_exposures(row(c.values));
    EXPECT_NEAR(e.start, c.start, 1e-6);
    EXPECT_NEAR(e.stop, c.stop, 1e-5);
    EXPECT_EQ(e.count, c.count);
  }
  // Where the median is the brightest value, or all is black, one exposure shows all.
  EXPECT_EQ(flip_exposures(row({2, 2, 2})).count, 1);
  EXPECT_EQ(flip_exposures(row({0, 0})).count, 1);
}

TEST(Flip, EqualImagesDoNotDiffer) {
  const Image image = noise(31, 17, 3, 2.0f);
  for (const FlipMap& map : {ldr_flip(image, image), hdr_flip(image, image)}) {
    EXPECT_EQ(map.mean, 0.0);
    for (const float e : map.errors) EXPECT_EQ(e, 0.0f);
  }
}

// HDR-FLIP takes its exposures from the reference, and is symmetric for given ones.
TEST(Flip, DoesNotDependOnWhichImageIsTheReference) {
  for (uint32_t seed = 0; seed < 4; ++seed) {
    const Image a = noise(23, 19, seed, 1.0f), b = noise(23, 19, seed + 100, 0.5f);
    EXPECT_EQ(ldr_flip(a, b).errors, ldr_flip(b, a).errors);
    const FlipExposures exposures = {-4.0, 2.0, 5};
    EXPECT_EQ(hdr_flip(a, b, exposures).errors, hdr_flip(b, a, exposures).errors);
    EXPECT_NE(hdr_flip(a, b).errors, hdr_flip(b, a).errors);
  }
}

TEST(Flip, ErrorsLieBetween0And1) {
  const Image black = make(16, 16, [](int, int, int) { return 0.0f; });
  const Image white = make(16, 16, [](int, int, int) { return 1.0f; });
  const Image chequered = make(16, 16, [](int x, int y, int) { return float((x / 4 + y / 4) % 2); });
  const Image green = make(16, 16, [](int, int, int c) { return c == 1 ? 1.0f : 0.0f; });
  const Image blue = make(16, 16, [](int, int, int c) { return c == 2 ? 1.0f : 0.0f; });
  const Image beyond = make(16, 16, [](int x, int, int) { return x % 2 ? 1e30f : -1e30f; });
  const Image images[] = {black, white, chequered, green, blue, beyond, noise(16, 16, 5, 100.0f)};
  for (const Image& a : images) {
    for (const Image& b : images) {
      for (const FlipMap& map : {ldr_flip(a, b), hdr_flip(a, b)}) {
        for (const float e : map.errors) ASSERT_TRUE(e >= 0.0f && e <= 1.0f) << e;
        EXPECT_TRUE(map.mean >= 0.0 && map.mean <= 1.0);
      }
    }
  }
  // The colours that are furthest apart.
  EXPECT_NEAR(ldr_flip(green, blue).mean, 1.0, 1e-6);
}

TEST(Flip, GrowsWithTheDifference) {
  const Image image = smooth(0.5f);
  const Image other = rough(3, 0.5f);
  double last_ldr = 0.0, last_hdr = 0.0;
  for (const float share : {0.01f, 0.03f, 0.1f, 0.3f, 1.0f}) {
    Image between = image;
    for (size_t i = 0; i < between.data.size(); ++i) between.data[i] += share * (other.data[i] - image.data[i]);
    const double ldr = ldr_flip(between, image).mean, hdr = hdr_flip(between, image).mean;
    EXPECT_GT(ldr, last_ldr) << share;
    EXPECT_GT(hdr, last_hdr) << share;
    last_ldr = ldr, last_hdr = hdr;
  }
}

// What a display cannot show does not count in LDR-FLIP, but does in HDR-FLIP.
TEST(Flip, OnlyHdrSeesWhatIsBrighterThanTheDisplay) {
  const Image a = make(20, 20, [](int x, int, int) { return x < 10 ? 0.1f : 4.0f; });
  const Image b = make(20, 20, [](int x, int, int) { return x < 10 ? 0.1f : 2.0f; });
  EXPECT_EQ(ldr_flip(a, b).mean, 0.0);
  EXPECT_GT(hdr_flip(a, b).mean, 0.05);
}

TEST(Flip, OtherLayersDoNotCount) {
  const Image a = noise(9, 9, 7, 1.0f), b = noise(9, 9, 8, 1.0f);
  Image layered{9, 9, {"depth.Z", "B", "G", "R"}, {}};
  for (size_t i = 0; i < 81; ++i) {
    layered.data.insert(layered.data.end(), {50.0f, a.data[3 * i + 2], a.data[3 * i + 1], a.data[3 * i]});
  }
  EXPECT_EQ(ldr_flip(layered, b).errors, ldr_flip(a, b).errors);
}

TEST(Flip, WhatIsNotFiniteHasNoMean) {
  Image a = noise(9, 9, 9, 1.0f);
  const Image b = a;
  for (const float bad : {float(NAN), float(INFINITY)}) {
    a.pixel(4, 4)[1] = bad;
    EXPECT_TRUE(std::isnan(ldr_flip(a, b).mean));
    EXPECT_TRUE(std::isnan(hdr_flip(a, b).mean));
    EXPECT_TRUE(std::isnan(hdr_flip(b, a).mean));
  }
}

TEST(Flip, MismatchesAreErrors) {
  const Image a = noise(4, 4, 1, 1.0f);
  Image grey{4, 4, {"Y"}, std::vector<float>(16, 0.5f)};
  EXPECT_THROW(ldr_flip(a, noise(4, 5, 1, 1.0f)), Error);
  EXPECT_THROW(hdr_flip(noise(5, 4, 1, 1.0f), a), Error);
  EXPECT_THROW(ldr_flip(grey, a), Error);
  EXPECT_THROW(hdr_flip(a, grey), Error);
  EXPECT_THROW(ldr_flip(Image{}, Image{}), Error);
  EXPECT_THROW(flip_exposures(grey), Error);
}

}  // namespace
}  // namespace fieldtrace
