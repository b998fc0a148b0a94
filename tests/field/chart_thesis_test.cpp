// Properties of the thesis' chart: the points on the sphere, the direction map, its frames, and the addresses of rays.
#include "field/thesis/chart_thesis.hd.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <vector>

#include "core/math/math.h"
#include "field/store/view.h"
#include "tests/support/chart_checks.h"
#include "tests/support/random_lines.h"

namespace fieldtrace {
namespace {

using scalar::ThesisAddress;
using scalar::ThesisVertex;
using test::angle;
using test::exact;
using test::k_round_trip_bound;
using test::lanes;
using test::Lanes3;
using test::special_directions;

constexpr std::array<int, 3> k_directions = {32, 64, 128};
constexpr int k_positions = scalar::k_thesis_positions;

DVec3 point_of_index(int index) { return exact(scalar::thesis_point(scalar::thesis_vertex_of_index<float>(index))); }
int index_of_point(const Vec3& p) { return scalar::index_of_thesis_vertex(scalar::nearest_thesis_vertex(lanes(p))); }
bool same(const ThesisAddress<float>& a, const ThesisAddress<float>& b) {
  return a.position == b.position && a.u == b.u && a.v == b.v;
}
bool in_range(const ThesisAddress<float>& at, int n) {
  return at.position >= 0 && at.position < k_positions && at.u >= 0 && at.u < n && at.v >= 0 && at.v < n;
}

std::vector<DVec3> all_points() {
  std::vector<DVec3> points;
  for (int i = 0; i < k_positions; ++i) points.push_back(point_of_index(i));
  return points;
}

// The subdivision as Slater builds it: every triangle cut into four, new corners pushed out to the sphere.
void subdivide(const DVec3& a, const DVec3& b, const DVec3& c, int level, std::vector<DVec3>& corners) {
  if (level == 0) {
    corners.insert(corners.end(), {a, b, c});
    return;
  }
  const DVec3 ab = glm::normalize(a + b), bc = glm::normalize(b + c), ca = glm::normalize(c + a);
  subdivide(a, ab, ca, level - 1, corners);
  subdivide(ab, b, bc, level - 1, corners);
  subdivide(ca, bc, c, level - 1, corners);
  subdivide(ab, bc, ca, level - 1, corners);
}

TEST(ThesisChart, HasTheThesisNumberOfSamples) {
  EXPECT_EQ(scalar::k_thesis_hemisphere, 2113);
  EXPECT_EQ(k_positions, 4226);
  int rim[2] = {0, 0};
  for (int i = 0; i < k_positions; ++i) {
    const DVec3 p = point_of_index(i);
    const bool lower = i >= scalar::k_thesis_hemisphere;
    ASSERT_NEAR(glm::length(p), 1.0, 3e-7);
    ASSERT_TRUE(lower ? p.z <= 0.0 : p.z >= 0.0) << i;
    rim[lower ? 1 : 0] += p.z == 0.0;
  }
  EXPECT_EQ(rim[0], 128);
  EXPECT_EQ(rim[1], 128);
}

TEST(ThesisChart, PointsAreThoseOfTheSubdivision) {
  std::vector<DVec3> corners;
  for (const double x : {1.0, -1.0}) {
    for (const double y : {1.0, -1.0}) subdivide({x, 0, 0}, {0, y, 0}, {0, 0, 1}, 5, corners);
  }
  std::set<int> seen;
  for (const DVec3& c : corners) {
    const int index = index_of_point(Vec3(c));
    ASSERT_LT(angle(point_of_index(index), c), 1e-6);
    seen.insert(index);
  }
  EXPECT_EQ(seen.size(), 2113u);
}

TEST(ThesisChart, IndexSurvivesTheRoundTrip) {
  for (int i = 0; i < k_positions; ++i) {
    const ThesisVertex<float> v = scalar::thesis_vertex_of_index<float>(i);
    ASSERT_LE(std::abs(v.i) + std::abs(v.j), 32.0f);
    ASSERT_EQ(scalar::index_of_thesis_vertex(v), i);
    const int found = index_of_point(Vec3(point_of_index(i)));
    const bool lower_rim = v.lower && std::abs(v.i) + std::abs(v.j) == 32.0f;
    ASSERT_EQ(found, lower_rim ? i - 2113 : i);
  }
}

TEST(ThesisChart, FindsTheNearestPoint) {
  const std::vector<DVec3> points = all_points();
  TestRandom random(1);
  double farthest = 0.0;
  const auto check = [&](const Vec3& p) {
    const int index = index_of_point(p);
    ASSERT_TRUE(index >= 0 && index < k_positions);
    const bool lower = p.z < 0.0f;
    ASSERT_EQ(index >= 2113, lower);
    double nearest = 10.0;
    for (int k = 0; k < 2113; ++k) {
      nearest = std::min(nearest, glm::length(points[size_t(lower ? k + 2113 : k)] - DVec3(p)));
    }
    const double found = glm::length(points[size_t(index)] - DVec3(p));
    // Between two equidistant points rounding decides: cosines agree to a few 2^-24, distances of .02 to 1e-5.
    ASSERT_LT(found, nearest + 1e-5) << p.x << " " << p.y << " " << p.z;
    farthest = std::max(farthest, found);
  };
  for (int i = 0; i < 20000; ++i) check(random.direction());
  for (const Vec3& d : special_directions()) check(d);
  // The widest triangles lie in the middle of an octant: edges of .074, so circumscribed circles of .0427.
  EXPECT_LT(farthest, 0.0428);
  EXPECT_GT(farthest, 0.04);
}

TEST(ThesisChart, EverySampleIsReached) {
  std::vector<int> count(k_positions, 0);
  TestRandom random(2);
  for (int i = 0; i < 600000; ++i) ++count[size_t(index_of_point(random.direction()))];
  for (int i = 0; i < k_positions; ++i) {
    const bool pole = i % 2113 == 1056;
    EXPECT_GT(count[size_t(i)], pole ? 20 : 10) << i;
  }
  for (const int n : k_directions) {
    std::vector<int> cells(size_t(n) * size_t(n), 0);
    for (int i = 0; i < 60 * n * n; ++i) {
      const Vec3 p = random.direction();
      // Cosine-weighted about the inward normal.
      const Vec3 d = glm::normalize(random.direction() - 0.999999f * p);
      const auto at = scalar::address_of_entry(lanes(p), lanes(d), make_axis(n));
      ASSERT_TRUE(in_range(at, n));
      ++cells[size_t(at.v) * size_t(n) + size_t(at.u)];
    }
    EXPECT_GT(*std::min_element(cells.begin(), cells.end()), 0) << n;
  }
}

TEST(ThesisChart, TheRimBelongsToTheUpperHemisphere) {
  TestRandom random(3);
  for (int i = 0; i < 20000; ++i) {
    const float phi = random.uniform(0.0f, 2.0f * k_pi), z = random.log_uniform(1e-38f, 1e-4f);
    const Vec3 flat(std::cos(phi), std::sin(phi), 0.0f);
    ASSERT_LT(index_of_point(flat), 2113);
    ASSERT_LT(index_of_point({flat.x, flat.y, -0.0f}), 2113);
    const int above = index_of_point({flat.x, flat.y, z}), below = index_of_point({flat.x, flat.y, -z});
    ASSERT_LT(above, 2113);
    // The hemispheres are mirror images, their copies of the rim included.
    ASSERT_EQ(below, above + 2113);
    ASSERT_EQ(point_of_index(above).z, 0.0);
    ASSERT_LT(angle(point_of_index(above), point_of_index(below)), 1e-9);
  }
}

TEST(ThesisChart, DirectionsSurviveTheRoundTrip) {
  TestRandom random(4);
  double worst = 0.0;
  const auto check = [&](Vec3 d) {
    d.z = std::abs(d.z);
    float u, v;
    scalar::square_from_disk(d.x, d.y, u, v);
    ASSERT_LE(std::max(std::abs(u), std::abs(v)), 1.0f + 3e-7f);
    const DVec3 back = exact(scalar::cosine_hemisphere_centred(std::clamp(u, -1.0f, 1.0f), std::clamp(v, -1.0f, 1.0f)));
    // The projection onto the disk keeps the precision of the offset, not that of the height near the rim.
    worst = std::max(worst, glm::length(DVec3(back.x, back.y, 0) - DVec3(d.x, d.y, 0)));
    if (d.z > 0.1f) {
      ASSERT_LT(angle(back, DVec3(d)), 10.0 * k_round_trip_bound);
    }
  };
  for (int i = 0; i < 500000; ++i) check(random.direction());
  for (const Vec3& d : special_directions()) check(d);
  EXPECT_LT(worst, k_round_trip_bound);
}

TEST(ThesisChart, SquareSurvivesTheRoundTrip) {
  TestRandom random(5);
  for (int i = 0; i < 300000; ++i) {
    const float u = random.uniform(-1.0f, 1.0f), v = random.uniform(-1.0f, 1.0f);
    const Lanes3 d = scalar::cosine_hemisphere_centred(u, v);
    ASSERT_GE(d.z, 0.0f);
    ASSERT_NEAR(glm::length(exact(d)), 1.0, 1e-6);
    float u2, v2;
    scalar::square_from_disk(d.x, d.y, u2, v2);
    ASSERT_NEAR(u, u2, 3e-6f) << u << " " << v;
    ASSERT_NEAR(v, v2, 3e-6f) << u << " " << v;
  }
}

TEST(ThesisChart, DirectionCellsHaveEqualProjectedAreas) {
  // Malley: equal areas on the disk are equal shares of the cosine-weighted hemisphere.
  for (const int n : k_directions) {
    constexpr int k_steps = 8;
    for (int j = 0; j < n; ++j) {
      for (int i = 0; i < n; ++i) {
        const std::vector<DVec3> border = test::cell_border(
            i, j, n, k_steps, [](float u, float v) { return exact(scalar::cosine_hemisphere_centred(u, v)); });
        double area = 0.0;
        for (size_t s = 1; s < border.size(); ++s) {
          area += 0.5 * (border[s - 1].x * border[s].y - border[s - 1].y * border[s].x);
        }
        ASSERT_NEAR(area * n * n / double(k_pi), 1.0, 2e-3) << i << " " << j << " of " << n;
      }
    }
  }
}

TEST(ThesisChart, CosineWeightedDirectionsFillCellsEvenly) {
  for (const int n : {32, 64}) {
    TestRandom random(uint32_t(60 + n));
    std::vector<int> count(size_t(n) * size_t(n), 0);
    constexpr int k_per_cell = 200;
    for (int i = 0; i < k_per_cell * n * n; ++i) {
      const float r = std::sqrt(random.uniform()), phi = 2.0f * k_pi * random.uniform();
      float u, v;
      scalar::square_from_disk(r * std::cos(phi), r * std::sin(phi), u, v);
      ++count[size_t(scalar::cell_of(v, make_axis(n))) * size_t(n) + size_t(scalar::cell_of(u, make_axis(n)))];
    }
    test::expect_even(count, k_per_cell);
  }
}

TEST(ThesisChart, FramesAreOrthonormalRightHandedAndInward) {
  TestRandom random(7);
  double worst = 0.0, farthest_turn = 0.0;
  for (int i = 0; i < 200000; ++i) {
    Vec3 p = random.direction();
    if (i % 3 == 0) p.z *= random.log_uniform(1e-38f, 1e-3f);
    p = Vec3(glm::normalize(DVec3(p)));
    const bool lower = p.z < 0.0f;
    const auto f = scalar::thesis_frame(lanes(p), lower);
    worst = std::max(worst, test::frame_error(exact(f.x), exact(f.y), -DVec3(p)));
    // Continuous: a small step turns the frame by little, even at the rim.
    const Vec3 q = glm::normalize(p + 1e-3f * random.direction());
    if ((q.z < 0.0f) == lower) {
      farthest_turn = std::max(farthest_turn, glm::length(exact(scalar::thesis_frame(lanes(q), lower).x) - exact(f.x)));
    }
  }
  EXPECT_LT(worst, 1e-6);
  EXPECT_LT(farthest_turn, 3e-3);
}

TEST(ThesisChart, SampleAddressesItself) {
  TestRandom random(8);
  for (const int n : k_directions) {
    const ChartAxis axis = make_axis(n);
    for (int position = 0; position < k_positions; ++position) {
      for (int k = 0; k < 8; ++k) {
        const ThesisAddress<float> cell = {position, int(random.index(uint32_t(n))), int(random.index(uint32_t(n)))};
        const auto ray = scalar::ray_of_address(cell, axis);
        ASSERT_LT(glm::dot(exact(ray.point), exact(ray.direction)), 0.0);
        ASSERT_NEAR(glm::length(exact(ray.direction)), 1.0, 1e-6);
        // The lower hemisphere's copy of the rim has z = 0, hence belongs to the upper hemisphere: it is reached by
        // entry points just below.
        const bool lower_rim = position >= 2113 && ray.point.z == 0.0f;
        Lanes3 entry = ray.point;
        if (lower_rim) entry.z = -1e-30f;
        const auto at = scalar::address_of_entry(entry, ray.direction, axis);
        ASSERT_TRUE(same(at, cell)) << n << ": " << position << " " << cell.u << " " << cell.v;
      }
    }
  }
}

TEST(ThesisChart, EntryLiesOnTheBallAndTheLine) {
  TestRandom random(9);
  int crossing = 0;
  for (int i = 0; i < 200000; ++i) {
    const Vec3 d = random.direction(), through = random.in_ball();
    const DVec3 unit = glm::normalize(DVec3(d));
    const float distance = random.log_uniform(1.5f, 1e3f);
    const Vec3 origin = through - d * distance;
    const auto entry = scalar::enter_ball(lanes(origin), lanes(d));
    if (!entry.crosses) continue;
    ++crossing;
    const double ulp = test::ulp_of(origin);
    ASSERT_NEAR(glm::length(exact(entry.point)), 1.0, 1e-6);
    ASSERT_LE(glm::dot(exact(entry.point), unit), 1e-6);
    const DVec3 off = exact(entry.point) - DVec3(origin);
    ASSERT_LT(glm::length(glm::cross(off, unit)), 4.0 * ulp + 1e-6);
  }
  EXPECT_GT(crossing, 190000);  // they pass within the ball: all but those that rounding moves out
  EXPECT_FALSE(scalar::enter_ball<float>({0, 2, -5}, {0, 0, 1}).crosses);
  const auto inside = scalar::enter_ball<float>({0, 0, 0.5f}, {0, 0, 1});
  EXPECT_TRUE(inside.crosses);
  EXPECT_FLOAT_EQ(inside.along, -1.5f);
}

TEST(ThesisChart, AddressIsInvariantUnderSliding) {
  TestRandom random(10);
  int moved = 0, total = 0;
  for (int i = 0; i < 200000; ++i) {
    const Vec3 d = random.direction();
    const DVec3 unit(d);
    const DVec3 through(random.in_ball());
    const double distance = double(random.log_uniform(2.0f, 1e6f));
    const Vec3 far(through - unit * distance);
    const Vec3 near(DVec3(far) + unit * (distance - 1.5));
    const auto e1 = scalar::enter_ball(lanes(far), lanes(d)), e2 = scalar::enter_ball(lanes(near), lanes(d));
    if (!e1.crosses || !e2.crosses) continue;
    const double ulp = test::ulp_of(far);
    // An offset of the line moves its entry on the ball by that over the cosine: at most twice as much here. The near
    // line's own origin is rounded by 2^-22.
    const double chord = glm::dot(exact(e1.point), unit);
    if (chord < -0.5) {
      const double off = glm::length(exact(e1.point) - exact(e2.point));
      ASSERT_LE(off, 2.0 * (3.0 * ulp + 4.0 * 0x1p-22)) << distance;
    }
    if (distance > 100.0) continue;
    ++total;
    moved += !same(scalar::address_of_entry(e1.point, lanes(d), make_axis(64)),
                   scalar::address_of_entry(e2.point, lanes(d), make_axis(64)));
  }
  ASSERT_GT(total, 10000);
  EXPECT_LT(moved, total / 200);
}

TEST(ThesisChart, GrazingAndStrangeLinesStayInTheTable) {
  TestRandom random(11);
  for (const int n : k_directions) {
    for (int i = 0; i < 100000; ++i) {
      const Vec3 p = random.direction();
      Vec3 d = glm::cross(p, random.direction());
      if (glm::length(d) < 1e-3f) continue;
      // Along the ball and slightly inwards; a direction that points outwards is clamped, too.
      d = glm::normalize(glm::normalize(d) +
                         p * (random.uniform() < 0.5f ? -1.0f : 1.0f) * random.log_uniform(1e-8f, 1.0f));
      ASSERT_TRUE(in_range(scalar::address_of_entry(lanes(p), lanes(d), make_axis(n)), n));
    }
    for (const Vec3& p : special_directions()) {
      for (const Vec3& d : {Vec3(1, 0, 0), Vec3(0, -1, 0), Vec3(0, 0, 1), -p}) {
        ASSERT_TRUE(in_range(scalar::address_of_entry(lanes(p), lanes(d), make_axis(n)), n));
      }
    }
  }
}

}  // namespace
}  // namespace fieldtrace
