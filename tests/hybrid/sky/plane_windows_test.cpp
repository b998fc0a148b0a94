// Planes know rooms that stand on them by texels of their own.

#include "hybrid/sky/plane_windows.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/mesh/mesh_procedural.h"
#include "tests/support/random_lines.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace {
namespace {

using namespace test;

// A floor of 50 x 50 and walls of 2.5 about a room of 4 x 6, turned and moved as one.
struct House : SceneMaker {
  explicit House(uint32_t seed) {
    TestRandom random(seed);
    const float turn = random.uniform(0.0f, 6.0f), c = std::cos(turn), s = std::sin(turn);
    x = {c, s, 0}, y = {-s, c, 0}, z = {0, 0, random.uniform() < 0.5f ? 1.0f : -1.0f};
    origin = {random.uniform(-9.0f, 9.0f), random.uniform(-9.0f, 9.0f), random.uniform(-9.0f, 9.0f)};
    grey = bsdf(BsdfKind::diffuse, Rgb(0.5f));
    square = shape(ShapeKind::rectangle);
    instance(square, grey, Affine(25.0f * x, 25.0f * y, z, origin));
    for (const float side : {-1.0f, 1.0f}) wall({2 * side, 0}, {0, 3}, 0.0f, 2.5f);
  }
  // From `low` to `high` over the floor, along `half` about `at` on it.
  void wall(const Vec2& at, const Vec2& half, float low, float high) {
    const Vec3 along = x * half.x + y * half.y;
    instance(square, grey,
             Affine(along, 0.5f * (high - low) * z, glm::normalize(glm::cross(along, z)),
                    place({at.x, at.y, 0.5f * (low + high)})));
  }
  Vec3 place(const Vec3& p) const { return origin + x * p.x + y * p.y + z * p.z; }

  // On the floor, in the house's coordinates.
  std::vector<PlaneWindow> windows_about(const Vec2& middle) const {
    std::vector<Vec3> seen;
    for (int i = 0; i < 9; ++i) seen.push_back(place({middle.x + 0.1f * float(i % 3 - 1), middle.y, float(i / 3)}));
    const std::vector<ShapeTraits> traits = shape_traits(scene);
    const SkyMaps maps(scene, traits, mapped_shapes(scene, traits), {}, 16, {});
    const SkyOccluder& floor = maps.occluders()[0];
    const PlaneCorners corners = plane_corners(floor);
    std::vector<PlaneWindow> windows = plane_windows(maps.occluders(), floor, seen, 64);
    for (PlaneWindow& w : windows) {
      const auto placed = [&](const Vec2& at) {
        const Vec3 p =
            0.5f * (corners[1] + corners[2] + (corners[1] - corners[0]) * at.x + (corners[2] - corners[0]) * at.y) -
            origin;
        return Vec2(glm::dot(p, x), glm::dot(p, y));
      };
      const Vec2 a = placed(w.lower), b = placed(w.upper);
      w = {glm::min(a, b), glm::max(a, b)};
    }
    return windows;
  }

  Vec3 x, y, z, origin;
  uint32_t grey, square;
};

void expect_window(const std::vector<PlaneWindow>& windows, const Vec2& lower, const Vec2& upper) {
  ASSERT_EQ(windows.size(), 2u);
  for (int a = 0; a < 2; ++a) {
    EXPECT_NEAR(windows[0].lower[a], -25.0f, 1e-4f);
    EXPECT_NEAR(windows[0].upper[a], 25.0f, 1e-4f);
    EXPECT_NEAR(windows[1].lower[a], lower[a], 1e-4f);
    EXPECT_NEAR(windows[1].upper[a], upper[a], 1e-4f);
  }
}

TEST(PlaneWindows, EndAtWalls) {
  for (uint32_t seed = 1; seed <= 8; ++seed) {
    House house(seed);
    house.wall({0, -3}, {2, 0}, 0.0f, 2.5f);
    house.wall({0, 3}, {2, 0}, -0.5f, 2.0f);  // through the floor
    expect_window(house.windows_about({0.3f, 1.0f}), {-2, -3}, {2, 3});
    house.wall({0.3f, 1.5f}, {0.4f, 0}, 0.0f, 0.8f);     // furniture
    house.wall({0.3f, 0.5f}, {2, 0}, 0.1f, 0.8f);        // above the floor
    house.wall({0.5f, 0.7f}, {1.0f, 1.0f}, 0.0f, 2.5f);  // aslant
    expect_window(house.windows_about({0.3f, 1.0f}), {-2, -3}, {2, 3});
    house.wall({-1.3f, 0.2f}, {0.7f, 0}, 0.0f, 2.5f);  // with a door
    house.wall({1.3f, 0.2f}, {0.7f, 0}, 0.0f, 2.5f);
    expect_window(house.windows_about({0.3f, 1.0f}), {-2, 0.2f}, {2, 3});
    expect_window(house.windows_about({0.3f, -1.0f}), {-2, -3}, {2, 0.2f});
  }
}

// Rounding, or less than a texel: all texels of the whole plane would lie within.
TEST(PlaneWindows, AreNoneWhereWallsStandAtTheEdges) {
  House house(3);
  house.scene.instances.resize(1);
  for (const float side : {-1.0f, 1.0f}) {
    house.wall({24.9999f * side, 0}, {0, 25}, 0.0f, 2.5f);
    house.wall({0, 24.5f * side}, {25, 0}, 0.0f, 2.5f);
  }
  EXPECT_EQ(house.windows_about({1, 1}).size(), 1u);
}

// Panels that stand side by side are not twice as long.
TEST(PlaneWindows, DoNotEndAtScreens) {
  House house(5);
  for (const float side : {-1.0f, 1.0f}) house.wall({0, 3 * side}, {2, 0}, 0.0f, 2.5f);
  for (const float at : {0.1f, 0.11f, 0.12f}) house.wall({0.5f, at}, {0.4f, 0}, 0.0f, 2.0f);
  expect_window(house.windows_about({0.3f, 1.0f}), {-2, -3}, {2, 3});
}

// Whose light one side of it sees, the other does not.
TEST(PlaneWindows, EndAtWallsThatStandFree) {
  House house(2);
  house.scene.instances.resize(1);
  house.wall({1, 2}, {8, 0}, 0.0f, 4.0f);
  expect_window(house.windows_about({0, 9}), {-25, 2}, {25, 25});
  expect_window(house.windows_about({3, -4}), {-25, -25}, {25, 2});
}

TEST(PlaneWindows, EndAtBoxes) {
  House house(9);
  const uint32_t cube = house.mesh(make_cube({.half_size = 1.0f}));
  for (const float side : {-1.0f, 1.0f}) {
    house.instance(cube, house.grey,
                   Affine(2.2f * house.x, 0.1f * house.y, 1.25f * house.z, house.place({0, 3.1f * side, 1.25f})));
  }
  expect_window(house.windows_about({0, 1}), {-2, -3}, {2, 3});
}

// Of a floor without walls, or of which too little is seen, the part about smaller ones.
TEST(PlaneWindows, ElseLieAboutObjects) {
  House house(4);
  const std::vector<PlaneWindow> open = house.windows_about({0, 0});
  ASSERT_EQ(open.size(), 2u);
  EXPECT_GT(open[1].upper.x, 2.5f);
  EXPECT_GT(open[1].upper.y, 3.5f);
  EXPECT_LT(open[1].upper.y, 20.0f);
  house.scene.instances.resize(1);
  EXPECT_EQ(house.windows_about({0, 0}).size(), 1u);
}

}  // namespace
}  // namespace fieldtrace
