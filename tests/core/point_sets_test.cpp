// Precomputed point sets: nets, uniformity, long sequences, and errors on a par with full Owen scrambling.

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <set>
#include <vector>

#include "core/sampling/point_sets.hd.h"
#include "core/sampling/warp.hd.h"

namespace fieldtrace::scalar {
namespace {

// Maps [-1, 1) to the upper 24 bits of a fraction.
uint32_t fraction(float centred) { return uint32_t((double(centred) + 1.0) * 0x1p23); }

struct Sets : ::testing::Test {
  const AlignedVector<int32_t> sets = make_point_sets();
  CentredPair<float> point(uint32_t index, uint32_t seed, uint32_t dimension) const {
    return gather_point<float>(sets.data(), set_sequence<float>(seed, set_stream(dimension)), index);
  }
};
using PointSets = Sets;

TEST_F(PointSets, AlignedBlocksAreNets) {
  std::mt19937 random(1);
  for (int probe = 0; probe < 200; ++probe) {
    const uint32_t seed = uint32_t(random());
    for (int m = 0; m <= 10; ++m) {
      const uint32_t count = 1u << m, first = (uint32_t(random()) >> 12) << m;
      for (int columns = 0; columns <= m; ++columns) {  // elementary intervals 2^-columns by 2^-(m - columns)
        std::vector<int> hits(count, 0);
        for (uint32_t i = 0; i < count; ++i) {
          const CentredPair<float> p = point(first + i, seed, 3);
          const uint32_t x = fraction(p.x) >> (24 - columns), y = fraction(p.y) >> (24 - (m - columns));
          ++hits[(y << columns) | x];
        }
        for (int h : hits) ASSERT_EQ(h, 1) << "m " << m << " columns " << columns;
      }
    }
  }
}

TEST_F(PointSets, LoadedAndGatheredPointsAreTheSame) {
  std::mt19937 random(2);
  for (int i = 0; i < 100000; ++i) {
    const SetSequence<float> s = set_sequence<float>(uint32_t(random()), set_stream(1));
    const uint32_t index = uint32_t(random()) >> (random() % 32);
    const CentredPair<float> a = gather_point<float>(sets.data(), s, index);
    const CentredPair<float> b = load_points<float>(sets.data(), s.set, s, index);
    ASSERT_EQ(a.x, b.x);
    ASSERT_EQ(a.y, b.y);
    ASSERT_TRUE(a.x >= -1.0f && a.x < 1.0f && a.y >= -1.0f && a.y < 1.0f);
  }
}

TEST_F(PointSets, LongSequencesDoNotRepeat) {
  std::set<std::pair<float, float>> seen;
  constexpr uint32_t k_count = 1u << 18;
  for (uint32_t i = 0; i < k_count; ++i) {
    const CentredPair<float> p = point(i, 7, 0);
    seen.insert({p.x, p.y});
  }
  EXPECT_EQ(seen.size(), k_count);
}

// For an unbiased estimate any fixed index must be uniform over seeds, also jointly with the same index of another
// dimension.
TEST_F(PointSets, EachIndexIsUniformOverSeeds) {
  constexpr int k_side = 16, k_seeds = 1 << 16;
  for (uint32_t index : {0u, 1u, 7u, 300u, 100003u}) {
    for (bool joint : {false, true}) {
      std::vector<double> bins(k_side * k_side, 0.0);
      for (uint32_t seed = 0; seed < k_seeds; ++seed) {
        const uint32_t s = vertex_seed(5, seed & 255, seed >> 8, 0);
        const float x = point(index, s, 3).x, y = joint ? point(index, s, 5).x : point(index, s, 3).y;
        bins[size_t((y + 1.0f) * 8.0f) * k_side + size_t((x + 1.0f) * 8.0f)] += 1.0;
      }
      double sum = 0.0;
      constexpr double k_expected = double(k_seeds) / (k_side * k_side);
      for (double b : bins) sum += (b - k_expected) * (b - k_expected) / k_expected;
      // 255 degrees of freedom: mean 255, standard deviation 22.6; five of these.
      EXPECT_LT(sum, 255.0 + 5.0 * 22.6) << index << joint;
    }
  }
}

// A cosine-weighted sphere light behind a straight edge that moves with the film sample: visibility in a penumbra.
struct Penumbra {
  double normal_x, normal_y, offset;
  double operator()(const DiskPoint<float>& p, const UnitPair<float>& film) const {
    const double x = double(p.radius) * p.cosine, y = double(p.radius) * p.sine;
    const double edge = offset + 0.3 * (double(film.x) - 0.5) + 0.1 * (double(film.y) - 0.5);
    return normal_x * x + normal_y * y < edge ? 1.0 + 0.2 * x : 0.0;
  }
};

// Error of camera_samples x light_samples points per pixel, over random pixels: half the mean squared difference of two
// independent estimates is the variance.
template <class Point>
double rms_error(int camera_samples, int light_samples, int probes, Point light_point) {
  std::mt19937 random(11);
  std::uniform_real_distribution<double> uniform;
  double squares = 0.0;
  for (int probe = 0; probe < probes; ++probe) {
    const double angle = 2.0 * M_PI * uniform(random);
    const Penumbra penumbra = {std::cos(angle), std::sin(angle), 1.6 * uniform(random) - 0.8};
    double estimate[2] = {};
    // One camera sample has no film strata: its position would drown out the light samples' error.
    const SobolSeeds<float> fixed_film = sobol_seeds<float>(uint32_t(random()), 0);
    for (double& e : estimate) {
      const uint32_t seed = uint32_t(random());
      const SobolSeeds<float> film_seeds = camera_samples == 1 ? fixed_film : sobol_seeds<float>(hash_uint(seed), 0);
      for (int c = 0; c < camera_samples; ++c) {
        const UnitPair<float> film = sample_2d<float>(uint32_t(c), film_seeds);
        for (int k = 0; k < light_samples; ++k) {
          e += penumbra(light_point(uint32_t(c * light_samples + k), seed), film);
        }
      }
      e /= camera_samples * light_samples;
    }
    squares += 0.5 * (estimate[0] - estimate[1]) * (estimate[0] - estimate[1]);
  }
  return std::sqrt(squares / probes);
}

TEST_F(PointSets, ErrorsAreThoseOfOwenScrambling) {
  for (int count : {16, 64, 256}) {
    // Keeps the standard error of the ratio below 0.9 %.
    const int probes = count == 256 ? 12000 : 24000;
    for (int light_samples : {count, 4, 1}) {
      const double owen = rms_error(count / light_samples, light_samples, probes, [](uint32_t i, uint32_t seed) {
        const UnitPair<float> p = sample_2d(i, seed, 9);
        return concentric_disk<float>(p.x, p.y);
      });
      const double set = rms_error(count / light_samples, light_samples, probes, [&](uint32_t i, uint32_t seed) {
        const CentredPair<float> p = point(i, seed, 9);
        return concentric_disk_centred<float>(p.x, p.y);
      });
      std::printf("%3d x %3d samples: Owen %.6f, sets %.6f, quotient %.4f\n", count / light_samples, light_samples,
                  owen, set, set / owen);
      EXPECT_NEAR(set / owen, 1.0, 0.03) << count << " points, " << light_samples << " a camera sample";
    }
  }
}

}  // namespace
}  // namespace fieldtrace::scalar
