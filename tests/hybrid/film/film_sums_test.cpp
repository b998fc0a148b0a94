// Sums of camera samples: means, variances, samples that are not finite, layers.
#include "hybrid/film/film_sums.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

namespace fieldtrace {
namespace {

constexpr float k_nan = std::numeric_limits<float>::quiet_NaN();

std::vector<Rgb> random_samples(std::mt19937& rng, size_t count) {
  std::uniform_real_distribution<float> value(0.0f, 3.0f);
  std::vector<Rgb> samples(count);
  for (Rgb& s : samples) s = Rgb(value(rng), value(rng), value(rng));
  return samples;
}

TEST(FilmSums, MeansAreThoseOfAllSamples) {
  std::mt19937 rng(1);
  for (size_t count : {1, 2, 7, 100}) {
    const std::vector<Rgb> samples = random_samples(rng, count);
    PixelSums sums;
    EXPECT_EQ(sums.add(0, std::span(samples).first(count / 2)), 0u);
    EXPECT_EQ(sums.add(2, std::span(samples).subspan(count / 2)), 0u);
    DVec3 mean(0.0);
    for (const Rgb& s : samples) mean += DVec3(s);
    mean /= double(count);
    EXPECT_EQ(sums.samples(), count);
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(sums.mean()[c], mean[c], 1e-12);
  }
  EXPECT_EQ(PixelSums().mean(), DVec3(0.0));
}

TEST(FilmSums, WhatIsNotFiniteCountsAsBlack) {
  const std::vector<Rgb> samples = {Rgb(1.0f), Rgb(1.0f, k_nan, 1.0f), Rgb(k_infinity), Rgb(3.0f)};
  PixelSums sums;
  EXPECT_EQ(sums.add(0, samples), 2u);
  EXPECT_EQ(sums.samples(), 4u);
  EXPECT_EQ(sums.mean(), DVec3(1.0));
}

// Over many pixels both estimates have the mean's variance as their mean.
TEST(FilmSums, VariancesAreThoseOfTheMean) {
  std::mt19937 rng(2);
  for (const int halves : {1, 2}) {
    const size_t pixels = 20000, of_half = 4;
    double estimated = 0.0, squares = 0.0;
    for (size_t i = 0; i < pixels; ++i) {
      PixelSums sums;
      for (int half = 0; half < halves; ++half) sums.add(2 * half, random_samples(rng, of_half));
      estimated += sums.variance().x / double(pixels);
      squares += (sums.mean().x - 1.5) * (sums.mean().x - 1.5) / double(pixels);
    }
    EXPECT_NEAR(estimated / squares, 1.0, 0.05) << halves;
    // Uniform numbers in [0, 3].
    EXPECT_NEAR(estimated * double(of_half) * halves, 0.75, 0.04) << halves;
  }
}

// Numbers of which n leave a variance that falls as n^-2: of one sequence, halves and quarters tell that and the
// mean's.
TEST(FilmSums, QuartersTellHowVarianceFalls) {
  std::mt19937 rng(4);
  std::normal_distribution<double> normal;
  const size_t pixels = 20000;
  double halves = 0.0, quarters = 0.0, squares = 0.0, variances = 0.0;
  for (size_t i = 0; i < pixels; ++i) {
    // The sums of all, and of the first half and quarters given these: V(n) = 1 / n^2.
    const auto split = [&](double mean, double n) {
      const double apart = std::sqrt(4.0 / (n * n) - 1.0 / (n * n)) * normal(rng);
      return std::pair(mean + apart, mean - apart);
    };
    const double all = normal(rng) / 8.0;
    const auto [first, second] = split(all, 8.0);
    PixelSums sums;
    int quarter = 0;
    for (const double half : {first, second}) {
      const auto [a, b] = split(half, 4.0);
      for (const double mean : {a, b}) {
        const std::vector<Rgb> of_quarter(2, Rgb(float(mean)));
        sums.add(quarter++, of_quarter);
      }
    }
    halves += sums.half_difference().x;
    quarters += sums.quarter_difference().x;
    squares += sums.mean().x * sums.mean().x;
    variances += sums.variance(2.0).x;
  }
  EXPECT_NEAR(quarters / halves, 4.0, 0.2);
  EXPECT_NEAR(variances / squares, 1.0, 0.05);
}

// However a sequence is cut into rounds, the sums are those of taking it at once.
TEST(FilmSums, RoundsAddUpToOneSequence) {
  std::mt19937 rng(5);
  for (const std::vector<uint32_t>& totals :
       {std::vector<uint32_t>{2, 4, 8, 16}, {2, 8, 32}, {4, 64}, {2, 64}, {1, 2, 4}}) {
    const std::vector<Rgb> samples = random_samples(rng, totals.back());
    PixelSums rounds;
    for (const uint32_t total : totals) {
      const uint32_t done = rounds.samples();
      PixelSums round;
      // In two runs, as batches may cut them.
      const uint32_t cut = (done + total) / 2;
      round.add_of(done, total, std::span(samples).subspan(done, cut - done), 1.0, 1.0);
      round.add_of(cut, total, std::span(samples).subspan(cut, total - cut), 1.0, 1.0);
      rounds.append(round);
      PixelSums whole;
      whole.add_of(0, total, std::span(samples).first(total), 1.0, 1.0);
      EXPECT_EQ(rounds.samples(), total);
      EXPECT_EQ(rounds.count[0], (total + 1) / 2);
      for (int quarter = 0; quarter < 4; ++quarter) {
        EXPECT_NEAR(rounds.radiance[quarter].x, whole.radiance[quarter].x, 1e-9) << total << " " << quarter;
      }
      EXPECT_EQ(rounds.work, whole.work);
    }
  }
}

TEST(FilmSums, StoredSumsAreTheSums) {
  std::mt19937 rng(6);
  const std::vector<Rgb> samples = random_samples(rng, 8);
  PixelSums whole, quarters;
  whole.add(0, samples, 2.0, 0.25);
  quarters.add_of(0, 8, samples, 2.0, 0.25);
  const PixelSums w = StoredSums(whole), q = StoredSums(quarters), none = StoredSums(PixelSums());
  EXPECT_EQ(StoredSums(whole).samples(), 8u);
  EXPECT_EQ(w.mean(), whole.mean());
  EXPECT_EQ(w.variance(), whole.variance());
  EXPECT_EQ(none.samples(), 0u);
  EXPECT_EQ(none.mean(), DVec3(0.0));
  for (int c = 0; c < 3; ++c) {
    EXPECT_NEAR(q.mean()[c], quarters.mean()[c], 1e-6);
    EXPECT_NEAR(q.half_difference()[c], quarters.half_difference()[c], 1e-6);
    EXPECT_NEAR(q.quarter_difference()[c], quarters.quarter_difference()[c], 1e-6);
  }
  for (const PixelSums& sums : {w, q}) {
    EXPECT_EQ(sums.work, 16.0f);
    EXPECT_EQ(sums.seconds, 2.0);
  }
  for (const PixelSums& sums : {whole, quarters, PixelSums()}) {
    const StoredSums stored = sums;
    const PixelSums read = stored;
    EXPECT_EQ(stored.mean(), read.mean());
    EXPECT_EQ(stored.half_difference(), read.half_difference());
    EXPECT_EQ(stored.work(), read.work);
    EXPECT_EQ(stored.has_halves(), read.has_halves());
    EXPECT_EQ(stored.has_quarters(), read.has_quarters());
    if (read.has_quarters()) {
      EXPECT_EQ(stored.quarter_difference(), read.quarter_difference());
    }
  }
}

TEST(FilmSums, OneSampleHasNoVariance) {
  PixelSums sums;
  const std::vector<Rgb> sample = {Rgb(2.0f)};
  sums.add(0, sample);
  EXPECT_EQ(sums.variance(), DVec3(0.0));
}

TEST(FilmSums, PartsMergeToTheWhole) {
  std::mt19937 rng(3);
  const std::vector<Rgb> samples = random_samples(rng, 64);
  PixelSums whole, merged;
  whole.add(0, samples);
  for (size_t i = 0; i < samples.size(); i += 16) {
    PixelSums part;
    part.add(0, std::span(samples).subspan(i, 16));
    part.work = 16.0f, part.seconds = 0.5;
    merged.merge(part);
  }
  EXPECT_EQ(merged.samples(), whole.samples());
  EXPECT_NEAR(merged.mean().y, whole.mean().y, 1e-12);
  EXPECT_NEAR(merged.variance().y, whole.variance().y, 1e-12);
  EXPECT_EQ(merged.work, 64.0f);
  EXPECT_EQ(merged.seconds, 2.0);
}

// A million samples, and estimates that err on the bright side.
TEST(FilmSums, LayersStayRight) {
  FirstHit first;
  first.hit = true;
  first.albedo = first.shown_albedo = Rgb(0.7f, 0.3f, 0.9f);
  first.normal = first.shown_normal = Vec3(0.6f, 0.0f, 0.8f);
  first.occlusion_rays = 1.0f, first.occlusion_clear = 1.02f;
  AovSums sums;
  constexpr int k_samples = 1 << 20;
  for (int i = 0; i < k_samples; ++i) sums.add(first);
  float out[3];
  for (const Aov aov : {Aov::albedo, Aov::denoise_albedo}) {
    sums.write(aov, out);
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(out[c], first.albedo[c], 1e-6f);
  }
  for (const Aov aov : {Aov::normal, Aov::denoise_normal}) {
    sums.write(aov, out);
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(out[c], first.normal[c], 1e-6f);
  }
  sums.write(Aov::ao, out);
  EXPECT_EQ(out[0], 1.0f);
}

TEST(FilmSums, LayersOfSamples) {
  PixelSums sums;
  const std::vector<Rgb> samples = {Rgb(1.0f), Rgb(3.0f)};
  sums.add(0, samples);
  sums.seconds = 2e-6;
  const std::vector<Aov> layers = {Aov::samples, Aov::depth, Aov::variance, Aov::time};
  AovSums aovs;
  aovs.samples = aovs.hits = 2;
  aovs.depth = 8.0;
  float out[9] = {};
  EXPECT_EQ(write_pixel(sums, aovs, layers, 1.0, out), out + 9);
  EXPECT_EQ(out[0], 2.0f);
  EXPECT_EQ(out[3], 2.0f);
  EXPECT_EQ(out[4], 4.0f);
  EXPECT_EQ(out[5], 1.0f);
  EXPECT_FLOAT_EQ(out[8], 2000.0f);
}

}  // namespace
}  // namespace fieldtrace
