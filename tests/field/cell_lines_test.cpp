// The lines that cells are baked by: each lies in its own cell, and is what it is said to be.

#include "field/bake/cell_lines.h"

#include <gtest/gtest.h>

#include "core/simd/vec_lanes.h"
#include "field/chart/chart.hd.h"
#include "tests/support/random_lines.h"

namespace fieldtrace {
namespace {

constexpr int k_trials = 20000;

struct CellOfLine {
  int u, v, a, b;
  std::array<float, 4> x;
  CellFrame frame;
};

// Any cell, and a place in it that rounding does not take out of it.
CellOfLine random_cell(TestRandom& random, const FieldParameters& p) {
  const auto index = [&](int n) { return std::min(int(random.uniform() * float(n)), n - 1); };
  CellOfLine c;
  c.u = index(p.directions);
  c.v = index(p.directions);
  c.a = index(p.plane);
  c.b = index(p.plane);
  for (float& x : c.x) x = random.uniform(0.01f, 0.99f);
  c.frame = cell_frame(c.u, c.v, p.directions);
  return c;
}

void expect_in_cell(const Line& line, const Vec3& anchor, const CellOfLine& c, const FieldParameters& p) {
  const auto at =
      scalar::address_of_line(lanes(line.direction), lanes(anchor), make_axis(p.directions), make_axis(p.plane));
  EXPECT_EQ(int(at.u), c.u);
  EXPECT_EQ(int(at.v), c.v);
  EXPECT_EQ(int(at.a), c.a);
  EXPECT_EQ(int(at.b), c.b);
}

TEST(OppositeCell, HasTheOppositeFrame) {
  for (const int directions : {4, 12, 16, 32, 64}) {
    for (int cell = 0; cell < directions * directions; ++cell) {
      const CellFrame of = cell_frame(cell / directions, cell % directions, directions);
      const int opposite = opposite_cell(cell, directions);
      ASSERT_EQ(opposite, direction_cell(-of.c, directions)) << cell;
      const CellFrame to = cell_frame(opposite / directions, opposite % directions, directions);
      EXPECT_NEAR(glm::length(to.c + of.c), 0.0f, 1e-6f);
      EXPECT_NEAR(glm::length(to.s - of.s), 0.0f, 1e-6f);
      EXPECT_NEAR(glm::length(to.t + of.t), 0.0f, 1e-6f);
    }
  }
}

// An upright pole through the ball's middle, a tenth as wide as what is between two lines: over all directions lines
// meet as much of it as there is. None would if planes had a column of texels along it.
TEST(CellFrame, LinesMeetUprightPolesThinnerThanTheirSpacing) {
  constexpr int k_directions = 16, k_texels = 64;
  constexpr float k_radius = 0.0015f, k_half_height = 0.8f, k_texel = 2.0f / float(k_texels);
  double found = 0.0, expected = 0.0;
  for (int cell = 0; cell < k_directions * k_directions; ++cell) {
    const CellFrame frame = cell_frame(cell / k_directions, cell % k_directions, k_directions);
    const Vec3 across = glm::normalize(glm::cross(Vec3(0, 0, 1), frame.c)), along = glm::cross(frame.c, across);
    const float length = k_half_height * std::abs(along.z);
    if (length < 10.0f * k_radius) continue;
    for (int y = 0; y < k_texels; ++y) {
      for (int x = 0; x < k_texels; ++x) {
        const auto line = line_of_texel(frame, x, y, k_texels);
        if (!line) continue;
        const bool meets =
            std::abs(glm::dot(line->foot, across)) < k_radius && std::abs(glm::dot(line->foot, along)) < length;
        found += meets ? 1.0 : 0.0;
      }
    }
    expected += double(4.0f * k_radius * length / (k_texel * k_texel));
  }
  EXPECT_GT(expected, 500.0);
  EXPECT_NEAR(found / expected, 1.0, 0.1);
}

TEST(Lines, ThroughFeetLieInTheirCells) {
  TestRandom random(1);
  const FieldParameters p;
  for (int i = 0; i < k_trials; ++i) {
    const CellOfLine c = random_cell(random, p);
    const Line line = foot_line(c.frame, c.u, c.v, c.a, c.b, c.x, p);
    expect_in_cell(line, line.foot, c, p);
    EXPECT_NEAR(glm::length(line.direction), 1.0f, 1e-6f);
    // Feet are at most 1.5 long, and their products with a unit direction carry a few roundings of that.
    EXPECT_NEAR(glm::dot(line.foot, line.direction), 0.0f, 1e-6f);
  }
}

TEST(Lines, ThroughDepthsLieInTheirCells) {
  TestRandom random(2);
  const FieldParameters p;
  for (int i = 0; i < k_trials; ++i) {
    const CellOfLine c = random_cell(random, p);
    const float depth = random.uniform(-1.0f, 1.0f);
    const Line line = depth_line(c.frame, c.u, c.v, c.a, c.b, depth, c.x, p);
    EXPECT_NEAR(glm::dot(line.foot, line.direction), 0.0f, 1e-6f);
    // At its depth the line passes the cell: that is where it may be anchored.
    const float along = (depth - glm::dot(line.foot, c.frame.c)) / glm::dot(line.direction, c.frame.c);
    const Vec3 pivot = line.foot + line.direction * along;
    expect_in_cell(line, pivot, c, p);
  }
}

// The places of many lines fill the cell: no quarter of any coordinate is left out.
TEST(Lines, PlacesFillTheCell) {
  for (uint32_t cell = 0; cell < 200; ++cell) {
    int count[4][4] = {};
    for (int k = 0; k < 16; ++k) {
      const auto x = cell_point(cell, k);
      for (int i = 0; i < 4; ++i) {
        ASSERT_GE(x[i], 0.0f);
        ASSERT_LT(x[i], 1.0f);
        ++count[i][int(4.0f * x[i])];
      }
    }
    for (const auto& coordinate : count) {
      for (const int quarter : coordinate) EXPECT_GE(quarter, 1) << cell;
    }
  }
}

}  // namespace
}  // namespace fieldtrace
