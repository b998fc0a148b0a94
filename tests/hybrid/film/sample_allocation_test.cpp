// Where further camera samples go: by variance and work, within limits, and held out; and how noise falls.
#include "hybrid/film/sample_allocation.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <functional>
#include <random>

#include "hybrid/path/tiles.h"

namespace fieldtrace {
namespace {

struct Pixel {
  double deviation = 0.1, work = 2.0, mean = 1.0;  // of one sample
  uint32_t samples = 8;
  double decay = 1.0;  // the variance of n samples is deviation^2 n^-decay
};

// A film whose quarters differ as normal samples would.
FilmSums film_of(const Rect& window, uint32_t seed, const std::function<Pixel(int, int)>& pixel) {
  std::mt19937 rng(seed);
  std::normal_distribution<double> normal;
  FilmSums film(window, false);
  for (int y = window.y; y < window.y + window.height; ++y) {
    for (int x = window.x; x < window.x + window.width; ++x) {
      const Pixel p = pixel(x, y);
      PixelSums sums;
      const double variance = p.deviation * p.deviation * std::pow(double(p.samples), -p.decay);
      // By how much the mean of half the samples is farther off.
      const double apart = std::sqrt(variance * (std::exp2(p.decay) - 1.0)), factor = std::exp2(0.5 * p.decay);
      for (int c = 0; c < 3; ++c) {
        const double mean = p.mean + std::sqrt(variance) * normal(rng), of_halves = apart * normal(rng);
        for (int half = 0; half < 2; ++half) {
          const double of_quarters = factor * apart * normal(rng);
          const double of_half = half == 0 ? mean + of_halves : mean - of_halves;
          sums.radiance[2 * half][c] = 0.25 * p.samples * (of_half + of_quarters);
          sums.radiance[2 * half + 1][c] = 0.25 * p.samples * (of_half - of_quarters);
        }
      }
      sums.count[0] = sums.count[1] = p.samples / 2;
      sums.work = float(p.work * p.samples);
      film.pixels[film.index(x, y)] = sums;
    }
  }
  return film;
}

const Rect k_window = {3, 5, 250, 130};  // ragged

SampleAllocation allocate(const FilmSums& film, ErrorMeasure measure, double decay) {
  NoiseSums sums(film.window, measure);
  sums.sum(film);
  return {sums, decay};
}

// Cells that are summed tile by tile are those of the whole film, and before that they have its pixels.
TEST(NoiseSums, TilesAddUpToTheFilm) {
  for (const Rect& window : {k_window, Rect{0, 0, 64, 32}, Rect{7, 2, 1, 3}, Rect{9, 8, 35, 33}}) {
    const FilmSums film = film_of(window, 5, [](int x, int y) { return Pixel{.deviation = 0.01 * (x + y)}; });
    for (const ErrorMeasure measure : {ErrorMeasure::absolute, ErrorMeasure::relative}) {
      NoiseSums whole(window, measure), tiles(window, measure);
      whole.sum(film);
      double pixels = 0.0;
      for (size_t i = 0; i < tiles.cells().count(); ++i) {
        EXPECT_EQ(tiles[i].pixels, whole[i].pixels);
        EXPECT_EQ(tiles[i].samples, 0.0);
        pixels += whole[i].pixels;
      }
      EXPECT_EQ(pixels, double(window.width) * window.height);
      for (const Rect& tile : make_tiles(window, k_tile_size)) tiles.sum(film, tile);
      for (size_t i = 0; i < tiles.cells().count(); ++i) {
        EXPECT_EQ(tiles[i].square, whole[i].square) << i;
        EXPECT_EQ(tiles[i].of_quarters, whole[i].of_quarters) << i;
        EXPECT_EQ(tiles[i].samples, 8.0 * whole[i].pixels) << i;
        EXPECT_EQ(tiles[i].of_value, whole[i].of_value) << i;
      }
    }
  }
}

TEST(SampleAllocation, NoiseIsTheMeanSquareError) {
  const FilmSums film = film_of(k_window, 1, [](int x, int) { return Pixel{.deviation = x < 128 ? 0.4 : 0.1}; });
  double squares = 0.0;
  for (const PixelSums p : film.pixels) {
    const DVec3 error = p.mean() - DVec3(1.0);
    squares += glm::dot(error, error) / 3.0 / double(film.pixels.size());
  }
  const SampleAllocation allocation = allocate(film, ErrorMeasure::absolute, 1.0);
  EXPECT_NEAR(allocation.mean_square() / squares, 1.0, 0.05);
  EXPECT_EQ(allocation.mean_samples(), 8.0);
  EXPECT_EQ(allocation.fewest_samples(), 8u);
  EXPECT_EQ(allocation.most_samples(), 8u);
  EXPECT_NEAR(allocation.work(), 16.0 * 250 * 130, 1.0);
}

TEST(SampleAllocation, RelativeNoiseIsWeighedByTheMean) {
  const auto noise = [](double mean) {
    const FilmSums film = film_of(k_window, 2, [&](int, int) { return Pixel{.deviation = 0.01, .mean = mean}; });
    return allocate(film, ErrorMeasure::relative, 1.0).mean_square();
  };
  EXPECT_NEAR(noise(1.0) / noise(3.0), 9.01 / 1.01, 0.05);
}

// A bright sample in one half of a pixel counts by its brightness: a pixel's own mean would hide it. Bright pixels amid
// dark ones count by theirs, not by their neighbours'.
TEST(SampleAllocation, RelativeNoiseOfBrightSamplesAndPixelsIsTheirError) {
  std::mt19937 rng(7);
  std::uniform_real_distribution<double> uniform;
  std::normal_distribution<double> normal;
  const auto ratio = [&](uint32_t samples, const auto& value, const auto& sample) {
    FilmSums film({0, 0, 512, 512}, false);
    double squares = 0.0;
    for (StoredSums& stored : film.pixels) {
      PixelSums sums;
      const double exact = value();
      for (uint32_t i = 0; i < samples; ++i) sums.radiance[i % 4] += DVec3(sample(exact));
      sums.count[0] = sums.count[1] = samples / 2;
      stored = sums;
      const double error = sums.mean().x - exact;
      squares += error * error / (exact * exact + k_relative_floor) / double(film.pixels.size());
    }
    return std::sqrt(allocate(film, ErrorMeasure::relative, 1.0).mean_square() / squares);
  };
  const auto even = [] { return 0.2; };
  const auto rarely_bright = [&](double) { return uniform(rng) < 0.02 ? 5.1 : 0.1; };
  EXPECT_GT(ratio(8, even, rarely_bright), 0.65);  // .3 by a pixel's own mean
  EXPECT_NEAR(ratio(64, even, rarely_bright), 1.0, 0.1);
  const auto few_bright = [&] { return uniform(rng) < 0.001 ? 10.0 : 0.1; };
  const auto noisy = [&](double exact) { return exact + (exact > 1.0 ? exact : 0.03) * normal(rng); };
  EXPECT_NEAR(ratio(16, few_bright, noisy), 1.3, 0.25);  // 12 by its neighbours'
}

TEST(SampleAllocation, SamplesFollowDeviationAndWork) {
  const FilmSums film = film_of(k_window, 3, [](int x, int) {
    return x < 64 ? Pixel{.deviation = 0.1} : x < 160 ? Pixel{.deviation = 0.4} : Pixel{.deviation = 0.4, .work = 8.0};
  });
  const SampleAllocation allocation = allocate(film, ErrorMeasure::absolute, 1.0);
  const NoiseCells cells(k_window);
  // In the mean over targets, as numbers are rounded to powers of two.
  double by_deviation = 0.0, by_work = 0.0;
  constexpr int k_targets = 16;
  for (int i = 0; i < k_targets; ++i) {
    const std::vector<uint32_t> counts = allocation.further({.mean_square = 1e-5 * std::exp2(double(i) / k_targets)});
    const auto mean_at = [&](int from, int to) {
      double sum = 0.0, n = 0.0;
      for (int y = 24; y < 120; ++y) {
        for (int x = from; x < to; ++x) sum += std::log2(8.0 + counts[cells.cell(x, y)]), n += 1.0;
      }
      return sum / n;
    };
    by_deviation += (mean_at(88, 136) - mean_at(16, 40)) / k_targets;
    by_work += (mean_at(88, 136) - mean_at(184, 240)) / k_targets;
  }
  EXPECT_NEAR(by_deviation, 2.0, 0.1);
  EXPECT_NEAR(by_work, 1.0, 0.1);
}

TEST(NoiseLeft, TellsPowersAndMixturesOfBothApart) {
  for (const double decay : {1.0, 1.2, 1.5, 3.0}) {
    EXPECT_NEAR(noise_left(std::exp2(decay) - 1.0, std::exp2(2.0 * decay) - std::exp2(decay)), 1.0, 1e-9) << decay;
  }
  for (const double smooth : {0.0, 0.1, 0.5, 0.9, 1.0}) {
    const auto left = [&](double n) { return (1.0 - smooth) * std::pow(n, -1.5) + smooth * std::pow(n, -3.0); };
    EXPECT_NEAR(noise_left(left(0.5) - left(1.0), left(0.25) - left(0.5)), 1.0, 1e-9) << smooth;
  }
  // What chance makes of them: as random samples at worst, and as smooth pictures at best.
  EXPECT_EQ(noise_left(1.0, 0.0), 1.0);
  EXPECT_NEAR(noise_left(1.0, 1e9), 1.0 / 7.0, 1e-12);
  EXPECT_EQ(noise_left(0.0, 1.0), 0.0);
  EXPECT_EQ(noise_left(0.0, 0.0), 0.0);
}

// Of samples that are better spread than random ones, the film tells itself how noise falls; where it falls in several
// ways, nearly.
TEST(SampleAllocation, NoiseOfSequencesIsTheMeanSquareError) {
  const auto ratio = [](const std::function<Pixel(int, int)>& pixel) {
    const FilmSums film = film_of(k_window, 9, pixel);
    double squares = 0.0;
    for (const PixelSums p : film.pixels) {
      const DVec3 error = p.mean() - DVec3(1.0);
      squares += glm::dot(error, error) / 3.0 / double(film.pixels.size());
    }
    return std::sqrt(allocate(film, ErrorMeasure::absolute, 1.0).mean_square() / squares);
  };
  for (const double decay : {1.0, 1.25, 1.5}) {
    EXPECT_NEAR(ratio([&](int, int) { return Pixel{.samples = 16, .decay = decay}; }), 1.0, 0.05) << decay;
  }
  // Where it falls faster than edges leave, it is taken for their part and one that falls as n^-3.
  EXPECT_NEAR(ratio([](int, int) { return Pixel{.samples = 16, .decay = 3.0}; }), 1.0, 0.05);
  EXPECT_NEAR(ratio([](int, int) { return Pixel{.samples = 16, .decay = 2.0}; }), 1.17, 0.05);
  EXPECT_NEAR(ratio([](int x, int) { return Pixel{.deviation = x < 64 ? 0.1 : 0.2, .decay = x < 64 ? 1.0 : 1.5}; }),
              1.0, 0.15);
  EXPECT_NEAR(ratio([](int x, int) {
                return x < 128 ? Pixel{.samples = 4, .decay = 1.0}
                               : Pixel{.deviation = 0.4, .samples = 64, .decay = 1.5};
              }),
              1.0, 0.15);
  const FilmSums film = film_of(k_window, 10, [](int, int) { return Pixel{.samples = 16, .decay = 1.5}; });
  EXPECT_NEAR(allocate(film, ErrorMeasure::absolute, 1.0).decay(), 1.5, 0.05);
}

TEST(SampleAllocation, HalvesAloneFallAsIsSaid) {
  FilmSums film = film_of(k_window, 11, [](int, int) { return Pixel{.samples = 2}; });
  for (StoredSums& stored : film.pixels) {
    PixelSums p = stored;
    p.radiance[0] = p.sum_of(0);
    p.radiance[2] = p.sum_of(1);
    p.radiance[1] = p.radiance[3] = DVec3(0.0);
    stored = p;
  }
  const SampleAllocation random = allocate(film, ErrorMeasure::absolute, 1.0);
  const SampleAllocation spread = allocate(film, ErrorMeasure::absolute, 1.5);
  EXPECT_EQ(random.decay(), 1.0);
  EXPECT_NEAR(spread.decay(), 1.5, 1e-12);
  EXPECT_NEAR(random.mean_square() / spread.mean_square(), std::exp2(1.5) - 1.0, 1e-9);
}

// Drawing what was planned gives the noise that was asked for.
TEST(SampleAllocation, PlansMeetTheirTarget) {
  const auto deviation = [](int x, int y) { return 0.02 + 0.5 * std::abs(std::sin(0.05 * x) * std::cos(0.07 * y)); };
  const FilmSums film = film_of(k_window, 4, [&](int x, int y) { return Pixel{.deviation = deviation(x, y)}; });
  const SampleAllocation allocation = allocate(film, ErrorMeasure::absolute, 1.0);
  const NoiseCells cells(k_window);
  for (const double target : {4e-3, 1e-3, 1e-4}) {
    const std::vector<uint32_t> counts = allocation.further({.mean_square = target});
    double expected = 0.0;
    for (int y = k_window.y; y < k_window.y + k_window.height; ++y) {
      for (int x = k_window.x; x < k_window.x + k_window.width; ++x) {
        const double n = 8.0 + counts[cells.cell(x, y)];
        expected += deviation(x, y) * deviation(x, y) / n / double(film.pixels.size());
      }
    }
    EXPECT_NEAR(expected / target, 1.0, 0.15) << target;
  }
}

TEST(SampleAllocation, LimitsHold) {
  const FilmSums film = film_of(k_window, 5, [](int x, int) { return Pixel{.deviation = x < 50 ? 2.0 : 0.1}; });
  const SampleAllocation allocation = allocate(film, ErrorMeasure::absolute, 1.0);
  for (const uint32_t n : allocation.further({.growth = 3.0})) EXPECT_LE(n, 8u);
  for (const uint32_t n : allocation.further({.growth = 30.0, .most = 33.0})) EXPECT_LE(n, 24u);
  for (const uint32_t n : allocation.further({.mean_square = 1e-4})) EXPECT_TRUE(std::has_single_bit(n + 8));
  const double pixels = 250.0 * 130.0;
  const std::vector<uint32_t> some = allocation.further({.work = 40.0 * pixels});
  EXPECT_GT(allocation.work_of(some), 30.0 * pixels);
  EXPECT_LT(allocation.work_of(some), 44.0 * pixels);
  for (const uint32_t n : allocation.further({.mean_square = 1.0})) EXPECT_EQ(n, 0u);
  for (const uint32_t n : allocation.further({.most = 8.0})) EXPECT_EQ(n, 0u);
}

// What a pixel's own halves show changes nothing about its own samples: only those of the other colour are looked at.
TEST(SampleAllocation, PixelsDoNotDecideAboutThemselves) {
  const FilmSums film = film_of(k_window, 6, [](int, int) { return Pixel{}; });
  FilmSums changed = film;
  for (int y = k_window.y; y < k_window.y + k_window.height; ++y) {
    for (int x = k_window.x; x < k_window.x + k_window.width; ++x) {
      if (((x ^ y) & 1) != 0) continue;
      PixelSums sums = changed.pixels[changed.index(x, y)];
      sums.radiance[0] *= 3.0;
      changed.pixels[changed.index(x, y)] = sums;
    }
  }
  const SampleAllocation before = allocate(film, ErrorMeasure::absolute, 1.0);
  const SampleAllocation after = allocate(changed, ErrorMeasure::absolute, 1.0);
  const NoiseCells cells(k_window);
  const std::vector<uint32_t> counts_before = before.further({.mean_square = 1e-4}),
                              counts_after = after.further({.mean_square = 1e-4});
  size_t others = 0;
  for (int y = k_window.y; y < k_window.y + k_window.height; ++y) {
    for (int x = k_window.x; x < k_window.x + k_window.width; ++x) {
      const size_t cell = cells.cell(x, y);
      if (((x ^ y) & 1) == 0) {
        EXPECT_EQ(before.cells()[cell].variance, after.cells()[cell].variance);
        EXPECT_EQ(counts_before[cell], counts_after[cell]);
      } else {
        others += before.cells()[cell].variance < after.cells()[cell].variance;
      }
    }
  }
  EXPECT_EQ(others, film.pixels.size() / 2);
}

// What shows no noise may have missed rare light: it is looked at again, if less than what is noisy.
TEST(SampleAllocation, BlocksWithoutNoiseAreNotForgotten) {
  const FilmSums film = film_of(
      k_window, 9, [](int x, int) { return x < 50 ? Pixel{.deviation = 0.5} : Pixel{.deviation = 0.0, .mean = 0.0}; });
  const NoiseCells cells(k_window);
  const double work = 800.0 * double(film.pixels.size());
  const std::vector<uint32_t> counts = allocate(film, ErrorMeasure::absolute, 1.0).further({.work = work});
  for (const int y : {20, 100}) {
    for (const int x : {100, 101, 200, 201}) {
      EXPECT_GT(counts[cells.cell(x, y)], 0u);
      EXPECT_LT(counts[cells.cell(x, y)], counts[cells.cell(20 + x % 2, y)]);
    }
  }
  // Nothing is seen yet: all wants the same.
  const FilmSums black = film_of(k_window, 9, [](int, int) { return Pixel{.deviation = 0.0, .mean = 0.0}; });
  const SampleAllocation nothing = allocate(black, ErrorMeasure::absolute, 1.0);
  const std::vector<uint32_t> even = nothing.further({.work = work, .growth = 4.0});
  for (const int x : {10, 11, 200, 201}) EXPECT_EQ(even[cells.cell(x, 50)], 24u);
}

TEST(SampleAllocation, SmallAndEvenFilms) {
  for (const Rect window : {Rect{0, 0, 1, 1}, Rect{7, 3, 1, 9}, Rect{0, 0, 8, 8}}) {
    const FilmSums noisy = film_of(window, 7, [](int, int) { return Pixel{}; });
    const std::vector<uint32_t> counts = allocate(noisy, ErrorMeasure::absolute, 1.0).further({.mean_square = 1e-6});
    EXPECT_TRUE(std::any_of(counts.begin(), counts.end(), [](uint32_t n) { return n > 0; }));
    const FilmSums even = film_of(window, 8, [](int, int) { return Pixel{.deviation = 0.0}; });
    const SampleAllocation done = allocate(even, ErrorMeasure::absolute, 1.0);
    EXPECT_LT(done.mean_square(), 1e-30);
    for (const uint32_t n : done.further({.mean_square = 1e-6})) EXPECT_EQ(n, 0u);
  }
}

}  // namespace
}  // namespace fieldtrace
