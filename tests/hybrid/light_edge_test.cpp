// Following edges across a light, against edges whose hidden part is known.
#include "hybrid/light/light_edge.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numeric>
#include <random>

namespace fieldtrace {
namespace {

using Hides = std::function<bool(SquarePoint)>;

std::vector<uint8_t> query_lattice(const Hides& hides, int side) {
  std::vector<uint8_t> hidden(size_t(side * side));
  for (int i = 0; i < side * side; ++i) hidden[size_t(i)] = hides(point_on({0, uint16_t(i)}, side, 0.0f));
  return hidden;
}

// The part of the square that is seen, if one edge is found.
struct Followed {
  bool is_edge = false;
  double seen = 0.0;
  double middle_x = 0.0, middle_y = 0.0;  // of the part that is seen
  std::vector<EdgeCrossing> crossings;
  std::vector<CellSeen> cells;
};
Followed follow(const Hides& hides, int side, int bisection_steps) {
  const std::vector<uint8_t> hidden = query_lattice(hides, side);
  Followed result;
  result.is_edge = find_crossings(hidden, side, 7, result.crossings);
  if (!result.is_edge) return result;
  for (EdgeCrossing& c : result.crossings) {
    for (int i = 0; i < bisection_steps; ++i) c.narrow(c.middle(), hides(point_on(c, side, c.middle())));
  }
  std::vector<CellSeen> cells(size_t((side - 1) * (side - 1)));
  measure_cells(hidden, side, result.crossings, cells);
  const float width = 2.0f / float(side - 1);
  for (size_t i = 0; i < cells.size(); ++i) {
    const float share = cells[i].share;
    const SquarePoint& middle = cells[i].middle;
    EXPECT_GE(share, 0.0f);
    EXPECT_LE(share, 1.0f);
    // The centroid lies within its cell.
    EXPECT_LE(std::abs(middle.x + 1.0f - width * (float(i % size_t(side - 1)) + 0.5f)), 0.5001f * width);
    EXPECT_LE(std::abs(middle.y + 1.0f - width * (float(i / size_t(side - 1)) + 0.5f)), 0.5001f * width);
    result.seen += share / double(cells.size());
    result.middle_x += middle.x * share / double(cells.size());
    result.middle_y += middle.y * share / double(cells.size());
  }
  result.middle_x /= result.seen;
  result.middle_y /= result.seen;
  result.cells = std::move(cells);
  return result;
}

// The same, measured with 400 x 400 points.
Followed measure(const Hides& hides) {
  constexpr int k_points = 400;
  Followed result;
  for (int i = 0; i < k_points * k_points; ++i) {
    const auto at = [](int k) { return (2.0f * float(k) + 1.0f) / float(k_points) - 1.0f; };
    const SquarePoint point = {at(i % k_points), at(i / k_points)};
    if (hides(point)) continue;
    result.seen += 1.0;
    result.middle_x += point.x;
    result.middle_y += point.y;
  }
  result.middle_x /= result.seen;
  result.middle_y /= result.seen;
  result.seen /= k_points * k_points;
  return result;
}

// Any straight edge that separates some lattice points is found, and its hidden area is right.
TEST(LightEdge, StraightEdgesAreMeasured) {
  std::mt19937 random(5);
  std::uniform_real_distribution<float> turn(0.0f, 6.2831853f), offset(-1.2f, 1.2f);
  int found = 0;
  for (int i = 0; i < 300; ++i) {
    const float angle = turn(random), d = offset(random);
    const Hides hides = [&](SquarePoint p) { return p.x * std::cos(angle) + p.y * std::sin(angle) > d; };
    const int side = 3 + i % 7;
    const std::vector<uint8_t> lattice = query_lattice(hides, side);
    const bool differs = std::adjacent_find(lattice.begin(), lattice.end(), std::not_equal_to<>()) != lattice.end();
    const Followed edge = follow(hides, side, 14);
    ASSERT_EQ(edge.is_edge, differs) << angle << " " << d << " " << side;
    if (!differs) continue;
    ++found;
    for (const EdgeCrossing& c : edge.crossings) {
      EXPECT_EQ(c.owner, 7u);
      EXPECT_EQ(hides(point_on(c, side, c.begin)), c.hidden);
      EXPECT_NE(hides(point_on(c, side, c.end)), c.hidden);
    }
    const Followed truth = measure(hides);
    ASSERT_NEAR(edge.seen, truth.seen, 2e-3) << angle << " " << d << " " << side;
    ASSERT_NEAR(edge.middle_x, truth.middle_x, 4e-3) << angle << " " << d << " " << side;
    ASSERT_NEAR(edge.middle_y, truth.middle_y, 4e-3) << angle << " " << d << " " << side;
  }
  EXPECT_GT(found, 200);
}

// Places beside a straight edge lie on the right side, at the right distance.
TEST(LightEdge, PlacesBesideAnEdgeLieOnItsSides) {
  std::mt19937 random(9);
  std::uniform_real_distribution<float> turn(0.0f, 6.2831853f), offset(-0.9f, 0.9f), distance(0.01f, 0.4f);
  int crossed = 0;
  for (int i = 0; i < 200; ++i) {
    const float angle = turn(random), d = offset(random), away = distance(random);
    const int side = 3 + i % 5;
    const auto beyond = [&](SquarePoint p) { return p.x * std::cos(angle) + p.y * std::sin(angle) - d; };
    const Followed edge = follow([&](SquarePoint p) { return beyond(p) > 0.0f; }, side, 16);
    for (size_t k = 0; k < edge.cells.size(); ++k) {
      if (!edge.cells[k].is_crossed) continue;
      ++crossed;
      const int corner = int(k) / (side - 1) * side + int(k) % (side - 1);
      for (const float to_hidden : {away, -away}) {
        const SquarePoint at = edge.cells[k].beside_middle(to_hidden);
        ASSERT_NEAR(beyond(point_in(corner, side, at.x, at.y)), to_hidden * 2.0f / float(side - 1), 2e-3f);
      }
    }
  }
  EXPECT_GT(crossed, 500);
}

// The bisection steps that edge_bisection_steps() advises leave half of the noise of as many samples of the light, .42
// M^-.75 (docs/decisions/009-cones.md), or less.
TEST(LightEdge, BisectionKeepsNoiseBelowThatOfSamples) {
  std::mt19937 random(6);
  std::uniform_real_distribution<float> turn(0.0f, 6.2831853f), offset(-0.7f, 0.7f);
  for (const auto& [side, samples] : {std::pair{3, 16}, std::pair{4, 64}, std::pair{6, 256}, std::pair{8, 1024}}) {
    const int bisection_steps = edge_bisection_steps(side, samples);
    double squares = 0.0;
    constexpr int k_edges = 400;
    for (int i = 0; i < k_edges; ++i) {
      const float angle = turn(random), d = offset(random);
      const Hides hides = [&](SquarePoint p) { return p.x * std::cos(angle) + p.y * std::sin(angle) > d; };
      const double error = follow(hides, side, bisection_steps).seen - follow(hides, side, 16).seen;
      squares += error * error;
    }
    EXPECT_LE(std::sqrt(squares / k_edges), 0.5 * 0.42 * std::pow(double(samples), -0.75)) << side;
  }
}

// Discs that cover the square from one side: straight pieces would err by h^2 / (12 r).
TEST(LightEdge, CurvedEdgesAreMeasured) {
  std::mt19937 random(8);
  std::uniform_real_distribution<float> turn(0.0f, 6.2831853f), depth(0.6f, 1.4f);
  for (const int side : {4, 6, 8}) {
    for (const float radius : {1.5f, 3.0f}) {
      double squares = 0.0;
      int n = 0;
      for (int tries = 0; tries < 600 && n < 60; ++tries) {
        const float angle = turn(random), far = radius + 1.2f - depth(random);
        const Hides hides = [&](SquarePoint p) {
          return std::hypot(p.x - far * std::cos(angle), p.y - far * std::sin(angle)) < radius;
        };
        const Followed edge = follow(hides, side, 16);
        if (!edge.is_edge) continue;
        const double error = edge.seen - measure(hides).seen;
        squares += error * error;
        ++n;
      }
      ASSERT_EQ(n, 60);
      const double h = 1.0 / double(side - 1), straight = h * h / (12.0 * double(radius / 2.0f));
      EXPECT_LE(std::sqrt(squares / n), 0.35 * straight + 2e-4) << side << " " << radius;
    }
  }
}

// Patterns that one edge does not explain are left alone.
TEST(LightEdge, OnlyOneEdgeIsFollowed) {
  struct Pattern {
    const char* points;
    bool is_edge;
  };
  for (const Pattern& pattern : {Pattern{"0000"
                                         "0000"
                                         "0000"
                                         "0000",
                                         false},
                                 Pattern{"1111"
                                         "1111"
                                         "1111"
                                         "1111",
                                         false},
                                 Pattern{"0000"
                                         "0110"
                                         "0110"
                                         "0000",
                                         false},
                                 Pattern{"1111"
                                         "1001"
                                         "1111"
                                         "1111",
                                         false},
                                 Pattern{"0110"
                                         "0110"
                                         "0110"
                                         "0110",
                                         false},
                                 Pattern{"1000"
                                         "0000"
                                         "0000"
                                         "0001",
                                         false},
                                 Pattern{"0110"
                                         "1001"
                                         "0110"
                                         "1001",
                                         false},
                                 Pattern{"1000"
                                         "0010"
                                         "0000"
                                         "0000",
                                         false},
                                 Pattern{"1111"
                                         "1100"
                                         "1010"
                                         "1111",
                                         false},
                                 Pattern{"1000"
                                         "0000"
                                         "0000"
                                         "0000",
                                         true},
                                 Pattern{"1111"
                                         "1111"
                                         "1110"
                                         "1100",
                                         true},
                                 Pattern{"0100"
                                         "0110"
                                         "0000"
                                         "0000",
                                         true}}) {
    std::vector<uint8_t> hidden;
    for (const char* c = pattern.points; *c; ++c) hidden.push_back(*c == '1');
    std::vector<EdgeCrossing> crossings;
    EXPECT_EQ(find_crossings(hidden, 4, 0, crossings), pattern.is_edge) << pattern.points;
    EXPECT_EQ(crossings.empty(), !pattern.is_edge) << pattern.points;
  }
}

TEST(LightEdge, BisectionStepsGrowWithSamples) {
  for (int side = 2; side < 20; ++side) {
    int last = 1;
    for (int samples = 1; samples < 100000; samples *= 2) {
      const int bisection_steps = edge_bisection_steps(side, samples);
      EXPECT_GE(bisection_steps, last);
      EXPECT_LE(bisection_steps, 16);
      last = bisection_steps;
    }
  }
}

}  // namespace
}  // namespace fieldtrace
