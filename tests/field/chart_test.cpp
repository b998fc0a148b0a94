// Properties of the orthographic chart: the direction map, its frames, and the addresses of lines.
#include "field/chart/chart.hd.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <tuple>
#include <utility>
#include <vector>

#include "core/math/math.h"
#include "core/simd/vec_lanes.h"
#include "field/query/query.hd.h"
#include "field/store/layout.hd.h"
#include "field/store/view.h"
#include "tests/support/chart_checks.h"
#include "tests/support/random_lines.h"

namespace fieldtrace {
namespace {

using scalar::CellAddress;
using test::angle;
using test::exact;
using test::k_round_trip_bound;
using test::lanes;
using test::Lanes3;
using test::special_directions;

constexpr std::array<int, 4> k_directions = {32, 64, 128, 256};
constexpr std::array<int, 4> k_planes = {64, 128, 256, 512};

// Distance from a direction to the centre of its cell, times D. The map shears cells most where an axis meets z = 0: a
// step of 1 / D in u turns by (2, 0) / D in (theta, phi), one in v by (2, pi / 2) / D, so that a corner lies
// sqrt(4^2 + (pi / 2)^2) = 4.30 away; cells of D = 32 are large enough to bend by a little more.
constexpr double k_centre_distance = 4.4;

DVec3 direction_at(float u, float v) { return exact(scalar::frame_from_square(u, v).c); }

bool same_cell(const CellAddress<float>& a, const CellAddress<float>& b) {
  return a.u == b.u && a.v == b.v && a.a == b.a && a.b == b.b;
}

bool same_bits(const Lanes3& a, const Lanes3& b) { return std::memcmp(&a, &b, sizeof(a)) == 0; }

bool in_range(const CellAddress<float>& at, int directions, int plane) {
  return at.u >= 0 && at.u < directions && at.v >= 0 && at.v < directions && at.a >= 0 && at.a < plane && at.b >= 0 &&
         at.b < plane;
}

TEST(OrthographicChart, DirectionSurvivesTheRoundTrip) {
  TestRandom random(1);
  double worst = 0.0;
  const auto check = [&](const Vec3& d) {
    float u, v;
    scalar::square_from_direction(lanes(d), u, v);
    ASSERT_LE(std::abs(u), 1.0f);
    ASSERT_LE(std::abs(v), 1.0f);
    worst = std::max(worst, angle(direction_at(u, v), DVec3(d)));
  };
  for (int i = 0; i < 1000000; ++i) check(random.direction());
  for (int i = 0; i < 200000; ++i) {
    // Close to a pole, an axis or a seam: one or two components log-uniform down to 1e-8.
    DVec3 d(random.direction());
    d[int(random.index(3))] *= double(random.log_uniform(1e-8f, 1.0f));
    d[int(random.index(3))] *= double(random.log_uniform(1e-8f, 1.0f));
    check(Vec3(glm::normalize(d)));
  }
  for (const Vec3& d : special_directions()) check(d);
  EXPECT_LT(worst, k_round_trip_bound);
}

// The map as Clarberg gives it, in double precision and with the library's arctangent: (Shirley and Chiu's map of a
// quarter disk) of the hemisphere, the lower one folded outwards.
struct SquarePoint {
  double u, v;
};
SquarePoint clarberg(const DVec3& d) {
  const double length = glm::length(d), z = std::abs(d.z) / length;
  const double r = std::sqrt(1.0 - z), turn = std::atan2(std::abs(d.y), std::abs(d.x)) * 2.0 / double(k_pi);
  double v = turn * r, u = r - v;
  if (d.z < 0.0) std::tie(u, v) = std::pair(1.0 - v, 1.0 - u);
  return {std::copysign(u, d.x), std::copysign(v, d.y)};
}

TEST(OrthographicChart, DirectionsLieWhereThePaperPutsThem) {
  TestRandom random(14);
  double worst = 0.0;
  const auto check = [&](const Vec3& d) {
    float u, v;
    scalar::square_from_direction(lanes(d), u, v);
    const SquarePoint expected = clarberg(DVec3(d));
    worst = std::max({worst, std::abs(double(u) - expected.u), std::abs(double(v) - expected.v)});
  };
  for (int i = 0; i < 200000; ++i) {
    // Not too near the poles: there the paper's sqrt(1 - z) loses what a rounded direction leaves of it.
    const Vec3 d = random.direction();
    if (std::abs(d.z) < 0.999f) check(d);
  }
  for (const float x : {1.0f, -1.0f, 0.0f, 0.5f, -0.25f}) {
    for (const float y : {1.0f, -1.0f, 0.0f, 0.75f}) {
      for (const float z : {0.0f, 0.5f, -0.5f}) {
        if (x != 0.0f || y != 0.0f) check(glm::normalize(Vec3(x, y, z)));
      }
    }
  }
  // A direction that is rounded is 2^-24 times sqrt(3) too long; where z is .999 that moves sqrt(1 - z) by 1 / (2 r) =
  // 16 times as much. The polynomial is off by 1e-7, and each step rounds by 2^-24.
  EXPECT_LT(worst, 16.0 * 1.8 * 0x1p-24 + 1e-7 + 8.0 * 0x1p-24);
}

TEST(OrthographicChart, SquareSurvivesTheRoundTrip) {
  TestRandom random(2);
  for (int i = 0; i < 300000; ++i) {
    const float u = random.uniform(-1.0f, 1.0f), v = random.uniform(-1.0f, 1.0f);
    float u2, v2;
    scalar::square_from_direction(scalar::frame_from_square(u, v).c, u2, v2);
    // Across the fold a point of the border stands for the same direction as its mirror image.
    const DVec3 d = direction_at(u, v), d2 = direction_at(u2, v2);
    ASSERT_LT(angle(d, d2), k_round_trip_bound) << u << " " << v;
    const bool interior = std::max(std::abs(u), std::abs(v)) < 0.999f && std::min(std::abs(u), std::abs(v)) > 0.001f;
    if (interior) {
      ASSERT_NEAR(u, u2, 1e-5f) << u << " " << v;
      ASSERT_NEAR(v, v2, 1e-5f) << u << " " << v;
    }
  }
}

// Solid angle of a triangle (Van Oosterom and Strackee, 1983).
double solid_angle(const DVec3& a, const DVec3& b, const DVec3& c) {
  return 2.0 * std::atan2(glm::dot(a, glm::cross(b, c)), 1.0 + glm::dot(a, b) + glm::dot(b, c) + glm::dot(c, a));
}

TEST(OrthographicChart, CellsHaveEqualAreas) {
  // The border of a cell as a polygon of 4 * 16 corners, in a fan of triangles from the cell's centre. Chords instead
  // of arcs lose (1/16)^2 of the border's bulge; corners are rounded to 2^-24.
  constexpr int k_steps = 16;
  TestRandom random(3);
  for (const int n : k_directions) {
    const double expected = 4.0 * double(k_pi) / (double(n) * n);
    double sum = 0.0;
    const int count = n == 32 ? n * n : 2000;
    for (int k = 0; k < count; ++k) {
      const int i = n == 32 ? k / n : int(random.index(uint32_t(n)));
      const int j = n == 32 ? k % n : int(random.index(uint32_t(n)));
      const DVec3 centre = direction_at(float((i + 0.5) * 2.0 / n - 1.0), float((j + 0.5) * 2.0 / n - 1.0));
      const std::vector<DVec3> border = test::cell_border(i, j, n, k_steps, direction_at);
      double area = 0.0;
      for (size_t s = 1; s < border.size(); ++s) area += solid_angle(centre, border[s - 1], border[s]);
      // The map does not flip orientation anywhere on the square.
      ASSERT_NEAR(area / expected, 1.0, 1e-3) << "cell " << i << ", " << j << " of " << n;
      sum += area;
    }
    if (n == 32) {
      EXPECT_NEAR(sum, 4.0 * double(k_pi), 1e-5);
    }
  }
}

TEST(OrthographicChart, UniformDirectionsFillCellsEvenly) {
  for (const int n : {32, 64}) {
    TestRandom random(uint32_t(40 + n));
    std::vector<int> count(size_t(n) * size_t(n), 0);
    constexpr int k_per_cell = 300;
    const int total = k_per_cell * n * n;
    for (int i = 0; i < total; ++i) {
      float u, v;
      scalar::square_from_direction(lanes(random.direction()), u, v);
      ++count[size_t(scalar::cell_of(u, make_axis(int(n)))) * size_t(n) +
              size_t(scalar::cell_of(v, make_axis(int(n))))];
    }
    test::expect_even(count, k_per_cell);
  }
}

TEST(OrthographicChart, SeamsOfTheSquareMeet) {
  // The lower hemisphere is folded outwards: border points (x, +-1) and (-x, +-1) are one direction, and the map is
  // continuous across the square's axes and the diamond |u| + |v| = 1 (z = 0).
  TestRandom random(5);
  constexpr float k_step = 0x1p-20f;
  for (int i = 0; i < 20000; ++i) {
    const float x = random.uniform(-1.0f, 1.0f);
    for (const float side : {1.0f, -1.0f}) {
      ASSERT_LT(angle(direction_at(x, side), direction_at(-x, side)), k_round_trip_bound) << x;
      ASSERT_LT(angle(direction_at(side, x), direction_at(side, -x)), k_round_trip_bound) << x;
      ASSERT_LT(angle(direction_at(x, k_step), direction_at(x, -k_step)), 8.0 * k_step);
      ASSERT_LT(angle(direction_at(k_step, x), direction_at(-k_step, x)), 8.0 * k_step);
      const float y = side * (1.0f - std::abs(x));
      const DVec3 above = direction_at(x, y * (1.0f - k_step)), below = direction_at(x, y * (1.0f + k_step));
      ASSERT_LT(angle(above, below), 8.0 * k_step) << x;
      ASSERT_GE(above.z, 0.0);
      ASSERT_LE(below.z, 0.0);
    }
  }
}

TEST(OrthographicChart, CellCentreIsNearEveryDirectionOfItsCell) {
  for (const int n : k_directions) {
    TestRandom random(uint32_t(60 + n));
    const auto check = [&](const Vec3& d) {
      const auto at = scalar::address_of_line<float>(lanes(d), {0.0f, 0.0f, 0.0f}, make_axis(n), make_axis(64));
      ASSERT_TRUE(in_range(at, n, 64));
      ASSERT_LT(angle(exact(at.frame.c), DVec3(d)) * n, k_centre_distance) << d.x << " " << d.y << " " << d.z;
    };
    for (int i = 0; i < 200000; ++i) check(random.direction());
    for (const Vec3& d : special_directions()) check(d);
    // Pairs that straddle a seam: each is near its own cell's centre, so the centres are near one another.
    for (int i = 0; i < 20000; ++i) {
      Vec3 d = random.direction();
      const int axis = int(random.index(3));
      d[axis] = 0.0f;
      d = glm::normalize(d);
      Vec3 e = d;
      d[axis] = random.log_uniform(1e-12f, 1e-7f);
      e[axis] = -d[axis];
      check(d);
      check(e);
    }
  }
}

TEST(OrthographicChart, ExactPolesAndAxesGiveFiniteCells) {
  for (const Vec3& d : special_directions()) {
    float u, v;
    scalar::square_from_direction(lanes(d), u, v);
    ASSERT_TRUE(std::isfinite(u) && std::isfinite(v));
    ASSERT_LE(std::max(std::abs(u), std::abs(v)), 1.0f);
    const bool lower = d.z < 0.0f;
    if (lower) {
      ASSERT_GE(std::abs(u) + std::abs(v), 1.0f - 1e-6f);
    } else {
      ASSERT_LE(std::abs(u) + std::abs(v), 1.0f + 1e-6f);
    }
  }
  float u, v;
  scalar::square_from_direction<float>({0.0f, 0.0f, 1.0f}, u, v);
  EXPECT_EQ(u, 0.0f);
  EXPECT_EQ(v, 0.0f);
  scalar::square_from_direction<float>({0.0f, 0.0f, -1.0f}, u, v);
  EXPECT_EQ(std::abs(u), 1.0f);
  EXPECT_EQ(std::abs(v), 1.0f);
}

TEST(OrthographicChart, FramesAreOrthonormalAndRightHanded) {
  double worst = 0.0;
  for (const int n : k_directions) {
    for (int i = 0; i < n; ++i) {
      for (int j = 0; j < n; ++j) {
        const auto f = scalar::frame_from_square(scalar::centre_of<float>(i, make_axis(int(n))),
                                                 scalar::centre_of<float>(j, make_axis(int(n))));
        worst = std::max(worst, test::frame_error(exact(f.s), exact(f.t), exact(f.c)));
      }
    }
  }
  // The truncation of sine and cosine, 4e-7, twice in a squared length, and a few roundings.
  EXPECT_LT(worst, 2e-6);
}

TEST(OrthographicChart, FrameIsAFunctionOfTheCellAlone) {
  TestRandom random(8);
  for (const int n : {32, 64}) {
    // The frame that the first line of a cell found, whatever its offset.
    std::map<std::pair<int, int>, CellAddress<float>> first;
    int again = 0;
    for (int i = 0; i < 50000; ++i) {
      const auto at = scalar::address_of_line(lanes(random.direction()), lanes(random.in_ball() * 2.0f), make_axis(n),
                                              make_axis(128));
      const auto [found, is_new] = first.try_emplace({at.u, at.v}, at);
      again += !is_new;
      const auto& f = found->second.frame;
      ASSERT_TRUE(same_bits(f.c, at.frame.c) && same_bits(f.s, at.frame.s) && same_bits(f.t, at.frame.t));
    }
    EXPECT_GT(again, 40000);
    // Neighbours have other frames.
    for (const auto& [cell, at] : first) {
      const auto next = first.find({cell.first + 1, cell.second});
      if (next == first.end()) continue;
      ASSERT_FALSE(same_bits(next->second.frame.c, at.frame.c));
    }
  }
}

// By brute force over the plane: the cell is the one whose centre lies nearest to where the line crosses the plane.
TEST(OrthographicChart, OffsetsGoToTheNearestCellOfThePlane) {
  TestRandom random(15);
  for (const int plane : {64, 128}) {
    for (int i = 0; i < 300; ++i) {
      const Vec3 d = random.direction(), anchor = random.in_ball();
      const auto at = scalar::address_of_line(lanes(d), lanes(anchor), make_axis(64), make_axis(plane));
      const DVec3 s = exact(at.frame.s), t = exact(at.frame.t);
      const auto distance = [&](int a, int b) {
        const double x = (2.0 * a + 1.0) / plane - 1.0, y = (2.0 * b + 1.0) / plane - 1.0;
        const DVec3 off = DVec3(anchor) - s * x - t * y;
        return std::hypot(glm::dot(off, s), glm::dot(off, t));
      };
      double nearest = 10.0;
      for (int a = 0; a < plane; ++a) {
        for (int b = 0; b < plane; ++b) nearest = std::min(nearest, distance(a, b));
      }
      // On a border between two cells a few roundings decide.
      ASSERT_LE(distance(at.a, at.b), nearest + 4.0 * 0x1p-23) << plane;
    }
  }
}

TEST(OrthographicChart, CellCentreAddressesItsOwnCell) {
  TestRandom random(9);
  for (const int n : k_directions) {
    for (int i = 0; i < n * n; ++i) {
      const int u = i / n, v = i % n;
      const auto f = scalar::frame_from_square(scalar::centre_of<float>(u, make_axis(int(n))),
                                               scalar::centre_of<float>(v, make_axis(int(n))));
      for (const int plane : k_planes) {
        const int a = int(random.index(uint32_t(plane))), b = int(random.index(uint32_t(plane)));
        const float along = random.uniform(-1.0f, 1.0f);
        const Lanes3 anchor = f.s * scalar::centre_of<float>(a, make_axis(int(plane))) +
                              f.t * scalar::centre_of<float>(b, make_axis(int(plane))) + f.c * along;
        const auto at = scalar::address_of_line(f.c, anchor, make_axis(n), make_axis(plane));
        ASSERT_TRUE(at.u == u && at.v == v && at.a == a && at.b == b) << n << " " << plane << " " << u << " " << v;
      }
    }
  }
}

TEST(OrthographicChart, RimAndGrazingLinesStayInTheTable) {
  TestRandom random(10);
  for (int i = 0; i < 100000; ++i) {
    const Vec3 d = random.direction();
    Vec3 side = glm::cross(d, random.direction());
    if (glm::length(side) < 1e-3f) continue;
    side = glm::normalize(side);
    // Offsets from just inside the ball's rim to twice the radius: these are clamped, not wrapped.
    const float offset = 1.0f + (random.uniform() < 0.5f ? -1.0f : 1.0f) * random.log_uniform(1e-8f, 1.0f);
    const auto at = scalar::address_of_line(lanes(d), lanes(side * offset), make_axis(64), make_axis(128));
    ASSERT_TRUE(in_range(at, 64, 128));
    if (offset <= 1.0f) {
      const float x = scalar::centre_of<float>(at.a, make_axis(128)),
                  y = scalar::centre_of<float>(at.b, make_axis(128));
      // Inside the disk, up to half a cell's diagonal.
      ASSERT_LE(std::hypot(x, y), 1.0f + 1.5f / 128.0f);
    }
  }
}

TEST(OrthographicChart, CoordinatesOutsideGoToTheNearestCellAndNanToTheFirst) {
  EXPECT_EQ(scalar::cell_of(-1.0f, make_axis(64)), 0);
  EXPECT_EQ(scalar::cell_of(1.0f, make_axis(64)), 63);
  EXPECT_EQ(scalar::cell_of(-3.0f, make_axis(64)), 0);
  EXPECT_EQ(scalar::cell_of(k_infinity, make_axis(64)), 63);
  EXPECT_EQ(scalar::cell_of(-k_infinity, make_axis(64)), 0);
  // Inactive lanes hold such values; a look-up must stay inside the table all the same.
  EXPECT_EQ(scalar::cell_of(std::numeric_limits<float>::quiet_NaN(), make_axis(64)), 0);
}

constexpr float k_identity[12] = {1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0};

TEST(OrthographicChart, AddressIsInvariantUnderSliding) {
  TestRandom random(11);
  int moved = 0, total = 0;
  for (int i = 0; i < 200000; ++i) {
    const Vec3 d = random.direction() * random.log_uniform(1e-3f, 1e3f);
    const DVec3 unit = glm::normalize(DVec3(d));
    const DVec3 through = DVec3(random.in_ball());
    const double distance = double(random.log_uniform(2.0f, 1e6f));
    const Vec3 far(through - unit * distance);
    // The same line from an origin near the ball, rounded once from the far origin as it really is.
    const Vec3 near(DVec3(far) + unit * (distance - 1.5));
    const auto s1 = scalar::segment_in_unit_space(k_identity, lanes(far), lanes(d), k_infinity);
    const auto s2 = scalar::segment_in_unit_space(k_identity, lanes(near), lanes(d), k_infinity);
    const double ulp = test::ulp_of(far);
    const double near_ulp = 0x1p-22;  // of |near| <= 2.5
    const DVec3 foot = DVec3(far) - unit * glm::dot(DVec3(far), unit);
    ASSERT_LE(glm::length(exact(s1.foot) - foot), 4.0 * ulp) << distance;
    ASSERT_LE(glm::length(exact(s1.foot) - exact(s2.foot)), 4.0 * ulp + 4.0 * near_ulp) << distance;
    if (distance > 100.0) continue;
    ++total;
    moved += !same_cell(scalar::address_of_line(s1.direction, s1.foot, make_axis(64), make_axis(128)),
                        scalar::address_of_line(s2.direction, s2.foot, make_axis(64), make_axis(128)));
  }
  // A foot that moves by so much crosses a border along either axis with the chance of that over half a cell's width.
  // Distances are log-uniform between 2 and 100: 25 in the mean, where an ulp is 2^-19 at most.
  const double chance = 2.0 * (4.0 * 0x1p-19 + 4.0 * 0x1p-22) / (2.0 / 128.0);
  ASSERT_GT(total, 50000);
  EXPECT_LT(moved, chance * total + 5.0 * std::sqrt(chance * total));
}

TEST(OrthographicChart, FootIsPerpendicularForAnyOrigin) {
  TestRandom random(12);
  int near = 0, far = 0;
  for (int i = 0; i < 200000; ++i) {
    const Vec3 d = random.direction();
    Vec3 o = random.direction() * random.log_uniform(1e-8f, 1e6f);
    // Lines that pass near the centre, from anywhere.
    if (i % 2 == 0) o = random.in_ball() - d * random.log_uniform(1e-8f, 1e6f);
    const auto s = scalar::segment_in_unit_space(k_identity, lanes(o), lanes(d), k_infinity);
    const double size = glm::length(exact(s.foot));
    if (size > 1.0) continue;
    ++(glm::length(o) < 10.0f ? near : far);
    // The second step rounds what the first one left, which may lie 4 ulp of the origin beside the foot.
    const double first = size + 4.0 * test::ulp_of(o);
    ASSERT_LE(std::abs(glm::dot(exact(s.foot), exact(s.direction))), 4.0 * 0x1p-24 * std::max(first, 1e-30) + 1e-37)
        << glm::length(o);
  }
  EXPECT_GT(near, 10000);
  EXPECT_GT(far, 10000);
}

TEST(OrthographicChart, ReverseLinesShareTheVisibilityCell) {
  // A field without a brick reads as unknown everywhere and names the slice that it would need.
  const std::vector<int32_t> zeros(size_t(16 * 16 + 32 * 16), 0);
  const std::vector<uint8_t> bytes(1024, 0);
  const std::vector<int32_t> words(512, 0);
  FieldView field;
  field.directions = make_axis(64);
  field.plane = make_axis(128);
  field.direction_bricks = 16;
  field.plane_bricks_b = 16;
  field.plane_bricks = 32 * 16;
  field.top = zeros.data();
  field.pages = zeros.data();
  field.visibility = bytes.data();
  field.depth = field.certificate = field.primitive = words.data();
  TestRandom random(13);
  int different = 0, total = 0;
  for (int i = 0; i < 200000; ++i) {
    const Vec3 a = random.direction() * random.uniform(1.1f, 20.0f),
               b = random.direction() * random.uniform(1.1f, 20.0f);
    const auto forth = scalar::segment_in_unit_space(k_identity, lanes(a), lanes(b - a), 1.0f);
    const auto back = scalar::segment_in_unit_space(k_identity, lanes(b), lanes(a - b), 1.0f);
    if (!forth.crosses || !back.crosses) continue;
    const auto v1 = scalar::query_segment(field, QueryPolicy{}, forth, false);
    const auto v2 = scalar::query_segment(field, QueryPolicy{}, back, false);
    ASSERT_EQ(v1.verdict, scalar::k_verdict_unknown_visibility);
    ASSERT_EQ(v2.verdict, scalar::k_verdict_unknown_visibility);
    ++total;
    different += v1.slice != v2.slice;
  }
  ASSERT_GT(total, 1000);
  // Only lines that rounding pushes over a cell's border differ: the feet are off by 4 ulp of a distance of 10 in the
  // mean each, as above.
  const double chance = 2.0 * (2.0 * 4.0 * 0x1p-20) / (2.0 / 128.0);
  EXPECT_LT(different, chance * total + 5.0 * std::sqrt(chance * total));
}

// Lines of the cells around a pole may lie at the pole itself, where the frame is not unique.
TEST(OrthographicChart, PolesHaveFrames) {
  for (const float pole : {0.0f, 1.0f}) {
    for (const float u : {-pole, pole, pole + 1e-8f, pole - 1e-8f}) {
      for (const float v : {-pole, pole, pole + 1e-8f, pole - 1e-8f}) {
        const auto f = scalar::frame_from_square(u, v);
        const Vec3 c = to_vec(f.c), s = to_vec(f.s), t = to_vec(f.t);
        EXPECT_NEAR(c.z, pole == 0.0f ? 1.0f : -1.0f, 1e-6f) << u << " " << v;
        // Sines and cosines of the frame's angle are within 4e-7.
        for (const Vec3& axis : {c, s, t}) EXPECT_NEAR(glm::length(axis), 1.0f, 2e-6f) << u << " " << v;
        EXPECT_NEAR(glm::dot(s, t), 0.0f, 2e-6f) << u << " " << v;
      }
    }
  }
}

}  // namespace
}  // namespace fieldtrace
