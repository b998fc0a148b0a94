// Sobol points (nets, padding, seeds), elementary functions and warps.

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <set>
#include <vector>

#include "core/sampling/sobol.hd.h"
#include "core/sampling/warp.hd.h"

namespace fieldtrace::scalar {
namespace {

// Upper 99.9999 % points, so that this seeded suite fails by chance less than once in a thousand edits.
double chi_square_limit(int degrees) {
  // Wilson and Hilferty's cube-root normal approximation with z = 4.75.
  const double k = 2.0 / (9.0 * degrees);
  return degrees * std::pow(1.0 - k + 4.75 * std::sqrt(k), 3.0);
}

double chi_square(const std::vector<double>& observed, double expected) {
  double sum = 0.0;
  for (double o : observed) sum += (o - expected) * (o - expected) / expected;
  return sum;
}

TEST(ReverseBits, MovesEachBitToItsMirror) {
  for (int bit = 0; bit < 32; ++bit) EXPECT_EQ(reverse_bits(1u << bit), 1u << (31 - bit));
  EXPECT_EQ(reverse_bits(0x12345678u), 0x1e6a2c48u);
}

TEST(Sobol, SecondDimensionMatchesDirectionNumbers) {
  // Joe and Kuo's second dimension: primitive polynomial x + 1, m_1 = 1, so v_i = v_(i-1) ^ (v_(i-1) >> 1).
  uint32_t direction[32] = {0x80000000u};
  for (int i = 1; i < 32; ++i) direction[i] = direction[i - 1] ^ (direction[i - 1] >> 1);
  std::mt19937 random(2);
  for (int n = 0; n < 4096; ++n) {
    const uint32_t index = n < 1024 ? uint32_t(n) : uint32_t(random());
    uint32_t expected = 0;
    for (int bit = 0; bit < 32; ++bit) expected ^= (index >> bit) & 1 ? direction[bit] : 0u;
    ASSERT_EQ(reverse_bits(sobol_second_reversed<float>(index)), expected) << index;
  }
}

TEST(Sobol, AlignedBlocksAreNets) {
  std::mt19937 random(3);
  for (int probe = 0; probe < 40; ++probe) {
    const SobolSeeds<float> seeds = sobol_seeds<float>(uint32_t(random()), uint32_t(probe));
    for (int m = 0; m <= 10; ++m) {
      const uint32_t count = 1u << m;
      const uint32_t first = (uint32_t(random()) >> 12) << m;
      for (int columns = 0; columns <= m; ++columns) {  // elementary intervals 2^-columns by 2^-(m - columns)
        std::vector<int> hits(count, 0);
        for (uint32_t i = 0; i < count; ++i) {
          const FractionPair<float> p = sample_2d_fractions<float>(first + i, seeds);
          const uint32_t x = uint32_t(uint64_t(p.x) >> (32 - columns));
          const uint32_t y = uint32_t(uint64_t(p.y) >> (32 - (m - columns)));
          ++hits[(y << columns) | x];
        }
        for (int h : hits) ASSERT_EQ(h, 1) << "m " << m << " columns " << columns;
      }
    }
  }
}

TEST(Sobol, PointsLieInTheUnitSquare) {
  std::mt19937 random(4);
  for (int i = 0; i < 100000; ++i) {
    const UnitPair<float> p = sample_2d(uint32_t(random()), uint32_t(random()), uint32_t(i));
    ASSERT_TRUE(p.x >= 0.0f && p.x < 1.0f && p.y >= 0.0f && p.y < 1.0f);
  }
}

// For an unbiased estimate any fixed index must be uniform over seeds.
TEST(Sobol, EachIndexIsUniformOverSeeds) {
  constexpr int k_side = 16, k_seeds = 1 << 16;
  for (uint32_t index : {0u, 1u, 7u, 1000003u}) {
    std::vector<double> bins(k_side * k_side, 0.0);
    for (uint32_t seed = 0; seed < k_seeds; ++seed) {
      const UnitPair<float> p = sample_2d(index, vertex_seed(5, seed & 255, seed >> 8, 0), 3);
      bins[size_t(p.y * k_side) * k_side + size_t(p.x * k_side)] += 1.0;
    }
    EXPECT_LT(chi_square(bins, double(k_seeds) / bins.size()), chi_square_limit(int(bins.size()) - 1)) << index;
  }
}

// Pairs of different dimensions, and pixels with different seeds, must be independent. Within one pair of sequences the
// joint strata of padded dimensions are merely random, so bins are filled over many seeds.
TEST(Sobol, PaddedPairsAreIndependent) {
  constexpr int k_side = 16, k_count = 64, k_seeds = 2048;
  for (int which = 0; which < 4; ++which) {
    std::vector<double> bins(k_side * k_side, 0.0);
    double correlation = 0.0;
    for (uint32_t seed = 0; seed < k_seeds; ++seed) {
      const uint32_t s = vertex_seed(6, seed, 1, 2);
      for (uint32_t i = 0; i < k_count; ++i) {
        const UnitPair<float> p = sample_2d(i, s, 0);
        const UnitPair<float> q = which < 2 ? sample_2d(i, s, 1) : sample_2d(i, vertex_seed(6, seed + 1, 1, 2), 0);
        const float a = p.x, b = which % 2 == 0 ? q.x : q.y;
        bins[size_t(b * k_side) * k_side + size_t(a * k_side)] += 1.0;
        correlation += (double(a) - 0.5) * (double(b) - 0.5) * 12.0;
      }
    }
    constexpr double k_total = double(k_count) * k_seeds;
    EXPECT_LT(chi_square(bins, k_total / bins.size()), chi_square_limit(int(bins.size()) - 1)) << which;
    EXPECT_LT(std::fabs(correlation / k_total), 5.0 / std::sqrt(k_total)) << which;
  }
}

// RMSE of the mean of a smooth function: nets gain an order over independent points.
TEST(Sobol, IntegratesSmoothFunctionsWell) {
  for (uint32_t count : {64u, 1024u}) {
    double squares = 0.0;
    for (uint32_t seed = 0; seed < 64; ++seed) {
      double mean = 0.0;
      for (uint32_t i = 0; i < count; ++i) {
        const UnitPair<float> p = sample_2d(i, hash_uint(seed + 1), 0);
        mean += std::sin(3.0 * p.x) * std::exp(-double(p.y)) / count;
      }
      const double exact = (1.0 - std::cos(3.0)) / 3.0 * (1.0 - std::exp(-1.0));
      squares += (mean - exact) * (mean - exact);
    }
    // Independent points: 0.25 / sqrt(count). The error of scrambled nets falls as count^-1.5.
    EXPECT_LT(std::sqrt(squares / 64.0), 0.25 * std::pow(double(count), -1.25)) << count;
  }
}

TEST(Hash, SeedsOfNeighboursDiffer) {
  std::set<uint32_t> seen;
  for (uint32_t x = 0; x < 64; ++x) {
    for (uint32_t y = 0; y < 64; ++y) {
      for (uint32_t v = 0; v < 4; ++v) seen.insert(vertex_seed(0, x, y, v));
    }
  }
  // 16,384 draws from 2^32 collide 0.03 times on average.
  EXPECT_GE(seen.size(), size_t(64 * 64 * 4 - 1));
}

TEST(Trigonometry, ErrorsStayWithinTheStatedBounds) {
  for (int i = -4096; i <= 4096; ++i) {
    const float x = float(i) / 4096.0f * Angle::k_quarter_pi;
    const SinCos<float> s = sincos_octant<float>(x);
    ASSERT_LE(std::fabs(s.sine - std::sin(double(x))), 0x1p-23 * std::fabs(x));
    ASSERT_LE(std::fabs(s.cosine - std::cos(double(x))), 0x1p-23);
  }
  for (int i = 0; i <= 65536; ++i) {
    const float t = float(i) / 65536.0f;
    const SinCos<float> s = sincos_turns<float>(t);
    ASSERT_NEAR(s.sine, std::sin(2.0 * M_PI * double(t)), 0x1p-22) << t;
    ASSERT_NEAR(s.cosine, std::cos(2.0 * M_PI * double(t)), 0x1p-22) << t;
  }
  std::mt19937 random(7);
  std::uniform_real_distribution<double> exponent(-30.0, 30.0);
  for (int i = 0; i < 100000; ++i) {
    const float y = float(std::exp2(exponent(random))), x = float(std::exp2(exponent(random))) * (i & 1 ? 1.f : -1.f);
    const double exact = std::atan2(double(y), double(x));
    ASSERT_NEAR(angle_upper<float>(y, x), exact, 0x1p-21 * exact) << y << " " << x;
  }
}

TEST(Warp, BasisIsOrthonormalAndRightHanded) {
  std::mt19937 random(8);
  for (int i = 0; i < 20000; ++i) {
    const Vec3Lanes<float> z =
        i == 0 ? Vec3Lanes<float>{0, 0, -1} : uniform_sphere<float>(unit_float(random()), unit_float(random()));
    const Basis<float> b = make_basis<float>(z);
    constexpr float k_bound = 0x1p-21f;  // a few roundings of values up to 2
    ASSERT_NEAR(dot(b.x, b.x), 1.0f, k_bound);
    ASSERT_NEAR(dot(b.y, b.y), 1.0f, k_bound);
    ASSERT_NEAR(dot(b.x, b.y), 0.0f, k_bound);
    ASSERT_NEAR(dot(b.x, z), 0.0f, k_bound);
    ASSERT_NEAR(dot(b.y, z), 0.0f, k_bound);
    ASSERT_NEAR(b.x.x * b.y.y - b.x.y * b.y.x, z.z, k_bound);
  }
}

// Bins of equal measure under each map must fill equally, and every direction must be unit.
template <class Map>
void expect_uniform(const char* name, Map map) {
  constexpr int k_side = 16, k_count = 1 << 18;
  std::vector<double> bins(k_side * k_side, 0.0);
  std::mt19937 random(9);
  for (int i = 0; i < k_count; ++i) {
    const UnitPair<float> ab = map(unit_float(random()), unit_float(random()));
    const auto bin = [](float x) { return size_t(std::min(std::max(int(x * k_side), 0), k_side - 1)); };
    bins[bin(ab.x) * k_side + bin(ab.y)] += 1.0;
  }
  EXPECT_LT(chi_square(bins, double(k_count) / bins.size()), chi_square_limit(int(bins.size()) - 1)) << name;
}

float turns(float y, float x) { return float(std::atan2(double(y), double(x)) / (2.0 * M_PI) + 0.5); }

void expect_unit(const Vec3Lanes<float>& d) { ASSERT_NEAR(dot(d, d), 1.0f, 0x1p-21f); }

TEST(Warp, MapsAreUniform) {
  expect_uniform("disk", [](float u, float v) {
    const DiskPoint<float> p = concentric_disk<float>(u, v);
    EXPECT_NEAR(p.cosine * p.cosine + p.sine * p.sine, 1.0f, 0x1p-21f);
    return UnitPair<float>{p.radius * p.radius, turns(p.sine, p.cosine)};
  });
  expect_uniform("hemisphere", [](float u, float v) {
    const Vec3Lanes<float> d = cosine_hemisphere<float>(u, v);
    expect_unit(d);
    return UnitPair<float>{d.z * d.z, turns(d.y, d.x)};
  });
  expect_uniform("sphere", [](float u, float v) {
    const Vec3Lanes<float> d = uniform_sphere<float>(u, v);
    expect_unit(d);
    return UnitPair<float>{0.5f * (d.z + 1.0f), turns(d.y, d.x)};
  });
  expect_uniform("triangle", [](float u, float v) {
    const Barycentric<float> b = uniform_triangle<float>(u, v);
    EXPECT_GE(std::min(b.b1, b.b2), 0.0f);
    EXPECT_LE(b.b1 + b.b2, 1.0f + 0x1p-23f);
    const float sum = b.b1 + b.b2;  // its square is uniform, and so is the share of b1 given it
    return UnitPair<float>{sum * sum, sum > 0.0f ? b.b1 / sum : 0.0f};
  });
}

TEST(Warp, ConcentricDiskIsDefinedEverywhere) {
  for (float u : {0.0f, 0.25f, 0.5f, 0.75f, 0x1.fffffep-1f}) {
    for (float v : {0.0f, 0.25f, 0.5f, 0.75f, 0x1.fffffep-1f}) {
      const DiskPoint<float> p = concentric_disk<float>(u, v);
      EXPECT_NEAR(p.cosine * p.cosine + p.sine * p.sine, 1.0f, 0x1p-21f) << u << " " << v;
      EXPECT_TRUE(p.radius >= 0.0f && p.radius <= 1.0f);
    }
  }
}

}  // namespace
}  // namespace fieldtrace::scalar
