// The kernels of direction cells: the same bits on every instruction set.

#include "field/maps/cell_kernels.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <bit>
#include <limits>

#include "field/maps/cell_visibility.hd.h"
#include "tests/support/cell_tasks.h"

namespace fieldtrace {
namespace {

using namespace test;

TEST(CellKernels, GiveTheSameBitsOnEveryInstructionSet) {
  TestRandom random(5);
  const NoisyMaps maps({8, 16, 64}, {2, 8, 16}, random);
  size_t undecided = 0, taken = 0, partly = 0, all = 0, reflected = 0;
  for (int trial = 0; trial < 2000; ++trial) {
    RandomTask r;
    make_task(maps.views, random, r);
    if (trial % 4 >= 2) add_radiance(maps.radiance, random, r);
    const Points points = random_points(r, 1 + random.index(100), random);
    AlignedVector<float> before(size_t(points.size), 0.0f);
    if (trial % 2) std::generate(before.begin(), before.end(), [&] { return random.uniform(); });
    const Answer expected = ask(Isa::scalar, r.task, points, before);
    OwnLines other_own = r.own;
    std::fill(std::begin(other_own.lines.u), std::end(other_own.lines.u), 0.0f);
    undecided += expected.undecided.size(), all += size_t(points.size);
    for (size_t i = 0; i < size_t(points.size); ++i) {
      const float most = r.task.weight[0] * scalar::cosine_over_cell<float>(r.task.vector[0] * points.values[6][i] +
                                                                                r.task.vector[1] * points.values[7][i] +
                                                                                r.task.vector[2] * points.values[8][i],
                                                                            r.task.cosine_half);
      const float sum = expected.sums[0][i] - before[i];
      EXPECT_GE(sum, 0.0f);
      EXPECT_LE(sum, most * (1.0f + 1e-5f) + 1e-6f * before[i]);
      const float back = expected.sums[3][i] - before[i], whole = 4.0f * r.task.half * r.task.half;
      EXPECT_GE(back, 0.0f);
      EXPECT_LE(back, whole * 1.01f);
      EXPECT_TRUE(back == 0.0f || r.task.reflects);
      reflected += back > 0.0f;
      taken += sum > 0.0f, partly += sum > 0.01f * most && sum < 0.99f * most;
    }
    std::vector<std::pair<Isa, bool>> ways;  // the latter: by what was kept of the points' own object
    for (const Isa isa : supported_isas()) {
      ways.push_back({isa, false});
      if (r.task.own) ways.push_back({isa, true});
    }
    for (const auto& [isa, by_kept] : ways) {
      AlignedVector<float> hidden(size_t(points.size), -1.0f), near(hidden);
      const OwnShares kept = {hidden.data(), near.data()};
      CellTask task = r.task;
      if (by_kept) {
        cell_kernels(isa).see_own(*task.own, points.view(), kept);
        task.own_shares = &kept;
        task.own = &other_own;  // whose map may say otherwise
      }
      const Answer answer = ask(isa, task, points, before);
      ASSERT_EQ(answer.undecided, expected.undecided) << isa_name(isa) << " " << trial;
      for (int channel = 0; channel < 6; ++channel) {
        for (size_t i = 0; i < size_t(points.size); ++i) {
          ASSERT_EQ(std::bit_cast<uint32_t>(answer.sums[channel][i]),
                    std::bit_cast<uint32_t>(expected.sums[channel][i]))
              << isa_name(isa) << " " << trial << " " << i;
        }
      }
    }
  }
  // The tasks reach all of the kernel.
  EXPECT_GT(undecided, all / 10);
  EXPECT_LT(undecided, all / 2);
  EXPECT_GT(taken, all / 4);
  EXPECT_GT(partly, all / 50);
  EXPECT_GT(reflected, all / 20);
}

TEST(CellKernels, FindTheSameCellsOnEveryInstructionSet) {
  TestRandom random(13);
  constexpr int k_size = 64;
  for (const int directions : {1, 16, 128}) {
    AlignedVector<float> around[3];
    Vec3 up = random.direction();
    const Vec3 x = glm::normalize(glm::cross(up, random.direction())), y = glm::cross(up, x);
    const float sine = random.uniform();
    up *= std::sqrt(1.0f - sine * sine);
    for (int i = 0; i < k_size; ++i) {
      const float phi = 2.0f * k_pi * random.uniform();
      const Vec3 d = x * std::cos(phi) + y * std::sin(phi);
      for (int a = 0; a < 3; ++a) around[a].push_back(d[a]);
    }
    const DirectionRow row = {around[0].data(), around[1].data(), around[2].data(), k_size, sine, {up.x, up.y, up.z}};
    for (const Isa isa : supported_isas()) {
      AlignedVector<int32_t> cells(k_size, -1);
      cell_kernels(isa).find_cells(row, directions, cells.data());
      for (size_t i = 0; i < k_size; ++i) {
        const Vec3 d(around[0][i], around[1][i], around[2][i]);
        ASSERT_EQ(cells[i], direction_cell(d * sine + up, directions)) << isa_name(isa) << " " << directions;
      }
    }
  }
}

// By the definition, and no direction is lost to the bounds of its block.
TEST(CellKernels, HideGroupsAlikeOnEveryInstructionSet) {
  TestRandom random(17);
  constexpr int k_blocks = 64, k_lobes = 200;
  constexpr float k_block_radius = 0.2f;
  AlignedVector<float> d[3], middle[3];
  for (int b = 0; b < k_blocks; ++b) {
    const Vec3 m = random.direction();
    for (int a = 0; a < 3; ++a) middle[a].push_back(m[a]);
    for (int k = 0; k < k_part_block; ++k) {
      const Vec3 aside = glm::normalize(glm::cross(m, random.direction()));
      const float angle = k_block_radius * random.uniform();
      for (int a = 0; a < 3; ++a) d[a].push_back(m[a] * std::cos(angle) + aside[a] * std::sin(angle));
    }
  }
  const PartDirections parts = {d[0].data(),      d[1].data(),      d[2].data(), middle[0].data(),
                                middle[1].data(), middle[2].data(), k_blocks};
  size_t hidden = 0;
  for (int trial = 0; trial < k_lobes; ++trial) {
    const Vec3 to = random.direction(), x = glm::normalize(glm::cross(to, random.direction())), y = glm::cross(to, x);
    const float reach_x = random.uniform(0.01f, 0.9f), reach_y = random.uniform(0.01f, 0.9f);
    GroupLobe lobe;
    for (int a = 0; a < 3; ++a) lobe.direction[a] = to[a], lobe.x[a] = x[a] / reach_x, lobe.y[a] = y[a] / reach_y;
    lobe.height = random.uniform();
    lobe.least_middle = std::cos(std::asin(std::max(reach_x, reach_y)) + k_block_radius + 1e-3f);
    const auto clear_by = [&](Isa isa) {
      AlignedVector<float> clear(k_blocks * k_part_block, 0.5f);
      AlignedVector<int32_t> blocks(k_blocks + k_batch_padding);
      cell_kernels(isa).hide_by_lobe(lobe, parts, blocks.data(), clear.data());
      return clear;
    };
    const AlignedVector<float> expected = clear_by(Isa::scalar);
    for (const Isa isa : supported_isas()) ASSERT_EQ(clear_by(isa), expected) << isa_name(isa);
    for (size_t i = 0; i < expected.size(); ++i) {
      const DVec3 at(d[0][i], d[1][i], d[2][i]);
      const double s = glm::dot(at, DVec3(x)) / double(reach_x), t = glm::dot(at, DVec3(y)) / double(reach_y);
      const bool ahead = glm::dot(at, DVec3(to)) > 0.0;
      const double taken = ahead ? double(lobe.height) * std::clamp(2.0 - 2.0 * (s * s + t * t), 0.0, 1.0) : 0.0;
      ASSERT_NEAR(expected[i], 0.5 * (1.0 - taken), 1e-4) << trial;
      hidden += taken > 0.0;
    }
  }
  EXPECT_GT(hidden, size_t(k_lobes * k_blocks / 2));
}

TEST(CellKernels, SumTheOpenSkyAlikeOnEveryInstructionSet) {
  TestRandom random(11);
  constexpr int k_normals = 64, k_cells = 300;
  AlignedVector<float> v[3], light[3], half, solid_angle, n[3];
  for (int c = 0; c < k_cells; ++c) {
    const Vec3 d = random.direction() * random.uniform(0.9f, 1.0f);
    for (int a = 0; a < 3; ++a) v[a].push_back(d[a]), light[a].push_back(random.log_uniform(1e-6f, 1e6f));
    half.push_back(random.log_uniform(1e-3f, 0.5f)), solid_angle.push_back(4.0f * half.back() * half.back());
  }
  for (int i = 0; i < k_normals; ++i) {
    const Vec3 d = random.direction();
    for (int a = 0; a < 3; ++a) n[a].push_back(d[a]);
  }
  const CellLights cells = {v[0].data(),     v[1].data(),     v[2].data(),     half.data(), solid_angle.data(),
                            light[0].data(), light[1].data(), light[2].data(), k_cells};
  const CellNormals normals = {n[0].data(), n[1].data(), n[2].data(), k_normals};
  for (const float grazing : {0.0f, 0.7f}) {
    const auto sums_of = [&](Isa isa) {
      std::array<AlignedVector<float>, 3> sums;
      for (auto& sum : sums) sum.assign(k_normals, -1.0f);
      cell_kernels(isa).sum_cells(cells, normals, grazing, {sums[0].data(), sums[1].data(), sums[2].data()});
      return sums;
    };
    const auto expected = sums_of(Isa::scalar);
    for (const Isa isa : supported_isas()) EXPECT_EQ(sums_of(isa), expected) << isa_name(isa);
    for (size_t i = 0; i < k_normals; ++i) {
      double exact = 0.0;
      for (size_t c = 0; c < k_cells; ++c) {
        const double mean = double(n[0][i]) * v[0][c] + double(n[1][i]) * v[1][c] + double(n[2][i]) * v[2][c];
        const double high = std::max(mean + half[c], 0.0), low = std::max(mean - half[c], 0.0);
        const double cosine = (high * high - low * low) / (4.0 * half[c]), dark = std::max(1.0 - cosine, 0.0);
        exact += double(solid_angle[c]) * light[1][c] * cosine * (1.0 - double(grazing) * std::pow(dark, 5));
      }
      EXPECT_NEAR(expected[1][i], exact, 1e-4 * exact) << i;
    }
  }
}

// A point on an edge's line or near it, in the plane or near it, over the parallelogram or far away.
Vec3 extreme_point(const Parallelogram& q, TestRandom& random) {
  const auto coordinate = [&] {
    const float at = std::array{-1.0f, 0.0f, 1.0f, random.uniform(-1.5f, 1.5f)}[random.index(4)];
    return random.index(2) ? at : at + random.uniform(-1.0f, 1.0f) * random.log_uniform(1e-8f, 1e8f);
  };
  const Vec3 n = glm::normalize(glm::cross(q.x, q.y));
  const float size = glm::length(q.x), height = random.index(8) ? size * random.log_uniform(1e-8f, 1e8f) : 0.0f;
  return q.centre + q.x * coordinate() + q.y * coordinate() + n * (random.index(2) ? height : -height);
}

// Points keep their answers whatever points lie beside them in a vector, where bounds and exact cuts meet, too: cells
// whose border runs along a plane's horizon to a few roundings, points in planes and on the lines of edges.
TEST(CellKernels, SharesOfPlanesDoNotDependOnThePointsBeside) {
  TestRandom random(7);
  size_t hidden = 0, partly = 0;
  for (int trial = 0; trial < 20000; ++trial) {
    RandomTask r;
    make_task({}, random, r);
    r.task.ball_count = 0;
    const float size = random.log_uniform(1e-6f, 1e6f);
    const Parallelogram q = {random.in_ball() * (random.index(2) ? size : 0.0f), random.direction() * size,
                             random.direction() * size * random.log_uniform(1e-3f, 1.0f)};
    PlaneLines lines = q.lines(Vec3(r.task.direction[0], r.task.direction[1], r.task.direction[2]));
    if (random.index(2)) {
      float rise = r.task.cosine_half;
      for (uint32_t n = random.index(4); n > 0; --n) rise = std::nextafter(rise, random.index(2) ? 0.0f : 1.0f);
      lines.centre.rise = random.index(2) ? rise : -rise;
    }
    r.planes.assign(1, lines);
    r.task.planes = r.planes.data(), r.task.plane_count = 1;
    Points points(32);
    for (size_t i = 0; i < size_t(points.size); ++i) {
      points.set(i, random.index(4) ? extreme_point(q, random) : random.in_ball() * size, random.direction(),
                 random.direction());
    }
    const AlignedVector<float> before(size_t(points.size), 0.0f);
    const Answer expected = ask(Isa::scalar, r.task, points, before);
    for (size_t i = 0; i < size_t(points.size); ++i) {
      const float share = scalar::share_of_slope<float>(
          lines, lines.centre, r.task.cosine_half, {points.values[0][i], points.values[1][i], points.values[2][i]});
      hidden += share == 1.0f, partly += share > 0.0f && share < 1.0f;
    }
    for (const Isa isa : supported_isas()) {
      const Answer answer = ask(isa, r.task, points, before);
      for (size_t i = 0; i < size_t(points.size); ++i) {
        ASSERT_EQ(std::bit_cast<uint32_t>(answer.sums[0][i]), std::bit_cast<uint32_t>(expected.sums[0][i]))
            << isa_name(isa) << " " << trial << " " << i;
      }
    }
  }
  EXPECT_GT(hidden, 2000u);
  EXPECT_GT(partly, 20000u);
}

// Any bits of points may be looked up: what they see means nothing, but nothing outside of the maps is read, and points
// beside them see what they would without. The maps lie at the ends of their memory (run with an address sanitizer).
TEST(CellKernels, AnyBitsOfPointsAreSafe) {
  constexpr float k_nan = std::numeric_limits<float>::quiet_NaN(), k_infinite = std::numeric_limits<float>::infinity();
  constexpr float k_huge = std::numeric_limits<float>::max(), k_tiny = std::numeric_limits<float>::denorm_min();
  TestRandom random(8);
  const auto bits = [&] {
    const float value =
        std::array{k_nan,
                   k_infinite,
                   k_huge,
                   1e20f,
                   8388608.0f,
                   k_tiny,
                   0.0f,
                   random.uniform(),
                   std::bit_cast<float>((random.index(1u << 16) << 16) | random.index(1u << 16))}[random.index(9)];
    return random.index(2) ? value : -value;
  };
  const NoisyMaps maps({8, 64}, {2, 16}, random);
  for (int trial = 0; trial < 4000; ++trial) {
    RandomTask r;
    make_task(maps.views, random, r);
    if (trial % 2) add_radiance(maps.radiance, random, r);
    const Points sound = random_points(r, 64, random);
    Points points = sound;
    std::vector<uint8_t> is_sound(size_t(points.size), 1);
    for (size_t i = 0; i < size_t(points.size); ++i) {
      if (random.index(2)) continue;
      is_sound[i] = 0;
      // Positions, normals or both, one component or all.
      for (const size_t a : {0u, 3u, 6u}) {
        if (random.index(2)) continue;
        const bool all = random.index(2) == 0;
        for (size_t c = 0; c < 3; ++c) {
          if (all || random.index(3) == 0) points.values[a + c][i] = bits();
        }
      }
    }
    const AlignedVector<float> before(size_t(points.size), 0.0f);
    const Answer expected = ask(Isa::scalar, r.task, sound, before);
    for (const Isa isa : supported_isas()) {
      const Answer answer = ask(isa, r.task, points, before);
      ASSERT_LE(answer.undecided.size(), size_t(points.size));
      ASSERT_TRUE(std::is_sorted(answer.undecided.begin(), answer.undecided.end()));
      std::vector<int32_t> undecided[2];
      for (const int32_t i : answer.undecided) {
        ASSERT_TRUE(i >= 0 && i < points.size) << isa_name(isa) << " " << trial << " " << i;
        if (is_sound[size_t(i)]) undecided[0].push_back(i);
      }
      for (const int32_t i : expected.undecided) {
        if (is_sound[size_t(i)]) undecided[1].push_back(i);
      }
      ASSERT_EQ(undecided[0], undecided[1]) << isa_name(isa) << " " << trial;
      for (size_t i = 0; i < size_t(points.size); ++i) {
        for (size_t channel = 0; is_sound[i] && channel < 6; ++channel) {
          ASSERT_EQ(std::bit_cast<uint32_t>(answer.sums[channel][i]),
                    std::bit_cast<uint32_t>(expected.sums[channel][i]))
              << isa_name(isa) << " " << trial << " " << i;
        }
      }
    }
  }
}

TEST(CellKernels, WeightlessAndUnlitCellsTakeNothing) {
  TestRandom random(6);
  const DirectionMaps maps = noisy_maps(16, random);
  const std::vector<MapsView> views = {maps.view()};
  for (int trial = 0; trial < 200; ++trial) {
    RandomTask r;
    make_task(views, random, r);
    const Points points = random_points(r, 64, random);
    const AlignedVector<float> before(size_t(points.size), 0.75f);
    for (const Isa isa : supported_isas()) {
      CellTask black = r.task;
      for (float& w : black.weight) w = 0.0f;
      for (const auto& sum : ask(isa, black, points, before).sums) EXPECT_EQ(sum, before);
      CellTask open = r.task;
      open.own = nullptr, open.map_count = open.plane_count = open.ball_count = 0;
      const Answer answer = ask(isa, open, points, before);
      for (const auto& sum : answer.sums) EXPECT_EQ(sum, before);
      EXPECT_TRUE(answer.undecided.empty());
    }
  }
}

}  // namespace
}  // namespace fieldtrace
