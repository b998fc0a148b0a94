// Whole lights answered at once: against single exact rays, on every instruction set, and where answers are hard.
#include <gtest/gtest.h>

#include "core/mesh/mesh_stress.h"
#include "tests/support/cone_scene.h"

namespace fieldtrace {
namespace {

using namespace test;

struct Counts {
  int clear = 0, blocked = 0, open = 0;
  int64_t rays = 0, wrong = 0;
};

void count_answers(const ConeScene& s, const ShadingPointBatch& batch, const ShadowGroup& group, TestRandom& random,
                   Counts& counts) {
  constexpr int k_rays = 32;
  for (size_t r = 0; r < batch.size; ++r) {
    const int32_t shadow = group.shadow[r];
    if (shadow == k_may_shadow) {
      ++counts.open;
      continue;
    }
    const int blocked = s.blocked_rays({batch.px[r], batch.py[r], batch.pz[r]}, k_rays, random);
    ++(shadow == 0 ? counts.clear : counts.blocked);
    counts.rays += k_rays;
    counts.wrong += shadow == 0 ? blocked : k_rays - blocked;
  }
}

void query_and_count(ConeScene& s, const ShadingPointBatch& batch, TestRandom& random, Counts& counts) {
  Stats stats;
  count_answers(s, batch, s.query(batch, Isa::automatic, 0.1f, stats), random, counts);
}

TEST(Cones, AnswersThroughTheObjectAreThoseOfExactRays) {
  TestRandom random(5);
  Counts counts;
  for (const TriangleMesh& mesh : solid_meshes()) {
    for (int i = 0; i < 12; ++i) {
      const float size = random.log_uniform(1e-3f, 1e3f);
      const Affine place = random_place(random, size, 3.0f);
      const float distance = size * random.uniform(3.0f, 9.0f);
      ConeScene s(mesh, place,
                  {Vec3(place[3]) + distance * random.direction(), distance * random.log_uniform(0.003f, 0.15f)});
      query_and_count(s, shadowed_shading_points(s, world_ball(s), 200, random), random, counts);
    }
  }
  EXPECT_GT(counts.clear, 1000);
  EXPECT_GT(counts.blocked, 400);
  EXPECT_GT(counts.open, 500);  // penumbrae
  EXPECT_LE(double(counts.wrong), 0.001 * double(counts.rays));
}

TEST(Cones, AnswersOnTheObjectAreThoseOfExactRays) {
  TestRandom random(6);
  Counts counts;
  for (const TriangleMesh& mesh : solid_meshes()) {
    for (int i = 0; i < 12; ++i) {
      const float size = random.log_uniform(1e-3f, 1e3f);
      const Affine place = random_place(random, size, 2.0f);
      const float distance = size * random.uniform(4.0f, 9.0f);
      ConeScene s(mesh, place,
                  {Vec3(place[3]) + distance * random.direction(), distance * random.log_uniform(0.003f, 0.1f)});
      query_and_count(s, self_shading_points(s, 600, random), random, counts);
    }
  }
  EXPECT_GT(counts.clear, 1000);
  EXPECT_LE(double(counts.wrong), 0.002 * double(counts.rays));
}

// A shell with holes: parallel lines through a hole in front meet the back, but slanting rays pass both.
TEST(Cones, LeaveLightLeaksBetweenSurfacesThatHideEachOther) {
  TestRandom random(11);
  Counts counts;
  for (int i = 0; i < 16; ++i) {
    const float size = random.log_uniform(1e-2f, 1e2f);
    const Affine place = random_place(random, size, 1.0f);
    const float distance = size * random.uniform(3.0f, 9.0f);
    ConeScene s(make_holy_sphere({}), place,
                {Vec3(place[3]) + distance * random.direction(), distance * random.uniform(0.02f, 0.05f)},
                {.directions = 128, .plane = 256});
    query_and_count(s, shadowed_shading_points(s, world_ball(s), 2000, random), random, counts);
  }
  EXPECT_GT(counts.blocked, 1000);
  EXPECT_LE(double(counts.wrong), 1e-5 * double(counts.rays));
}

TEST(Cones, AreTheSameOnEveryInstructionSet) {
  TestRandom random(7);
  for (const TriangleMesh& mesh : solid_meshes()) {
    const Affine place = random_place(random, 1.0f, 3.0f);
    ConeScene s(mesh, place, {Vec3(place[3]) + 4.0f * random.direction(), 0.2f});
    for (const bool self : {false, true}) {
      const ShadingPointBatch batch =
          self ? self_shading_points(s, 333, random) : shadowed_shading_points(s, world_ball(s), 333, random);
      Stats scalar_stats;
      const ShadowGroup scalar = s.query(batch, Isa::scalar, 0.1f, scalar_stats);
      for (const Isa isa : supported_isas()) {
        Stats stats;
        const ShadowGroup other = s.query(batch, isa, 0.1f, stats);
        EXPECT_EQ(scalar.shadow, other.shadow) << isa_name(isa);
        EXPECT_EQ(scalar_stats.cones_clear, stats.cones_clear) << isa_name(isa);
        EXPECT_EQ(scalar_stats.cones_blocked, stats.cones_blocked) << isa_name(isa);
      }
    }
  }
}

TEST(Cones, AreNotAskedAtToleranceZero) {
  TestRandom random(8);
  ConeScene s(make_sphere({}), random_place(random, 1.0f, 1.5f), {Vec3(0, 6, 0), 0.1f});
  const ShadingPointBatch batch = shadowed_shading_points(s, world_ball(s), 100, random);
  Stats stats;
  const ShadowGroup group = s.query(batch, Isa::automatic, 0.0f, stats);
  EXPECT_EQ(stats.lookups, 0u);
  EXPECT_TRUE(std::all_of(group.shadow.begin(), group.shadow.begin() + 100,
                          [](int32_t flag) { return flag == 0 || flag == k_may_shadow; }));
}

// A box of half extents h about the origin, on a floor, and one shading point on the floor, in units of the box's ball.
// Where the floor cuts the light, only rays above it count.
int32_t shadow_on_floor(const Vec3& h, const Vec2& at, const Sphere& light, int& blocked, int& rays) {
  TriangleMesh box = make_cube({});
  const Vec3 size = 0.5f * box.bounds().diagonal(), centre = box.bounds().centre();
  for (Vec3& p : box.positions) p = (p - centre) / size * h;
  ConeScene s(box, Affine(1.0f), light);
  ShadingPointBatch batch;
  batch.resize(1);
  const Vec3 p(at.x, at.y, -h.z - 1e-5f);
  set_shading_point(batch, 0, p, Vec3(0, 0, 1), k_none);
  Stats stats;
  const int32_t shadow = s.query(batch, Isa::automatic, 0.1f, stats).shadow[0];
  TestRandom random(10);
  RayBatch one;
  one.resize(1);
  const std::vector<uint32_t> index = {0};
  for (int i = 0; i < 1000; ++i) {
    const Vec3 d = light.centre + light.radius * random.direction() - p;
    if (d.z <= 0.0f) continue;
    one.set(0, p, d, 1.0f);
    uint8_t hit = 0;
    s.accel->occluded_by(k_object, one, index, &hit);
    blocked += hit;
    ++rays;
  }
  return shadow;
}

// Lights that the shading point's tangent plane cuts, boxes behind and beside the shading point: no answer may be
// wrong.
TEST(Cones, OfShadingPointsBesideTheObjectClaimNothingWrong) {
  struct Case {
    Vec3 box;
    Vec2 at;
    Vec3 light;
    float radius;
  };
  const Case cases[] = {
      {{0.6f, 0.6f, 0.5f}, {0.75f, 0.0f}, {4.5f, 0.0f, -0.7f}, 1.5f},
      {{0.6f, 0.6f, 0.5f}, {1.0f, 0.0f}, {4.5f, 0.0f, -0.8f}, 1.5f},
      {{0.6f, 0.6f, 0.5f}, {0.7f, 0.0f}, {6.0f, 0.0f, -0.6f}, 0.5f},
      {{0.95f, 0.1f, 0.25f}, {0.5f, 0.12f}, {6.0f, 0.3f, 1.0f}, 2.0f},
      {{0.95f, 0.1f, 0.25f}, {0.5f, 0.12f}, {6.0f, 0.6f, 1.0f}, 2.0f},
      {{0.95f, 0.1f, 0.25f}, {0.5f, 0.12f}, {6.0f, 1.2f, 1.0f}, 2.0f},
      {{0.6f, 0.6f, 0.5f}, {0.62f, 0.0f}, {6.0f, 0.0f, 0.25f}, 0.1f},
      {{0.9922f, 0.12f, 0.02f}, {1.5f, 0.0f}, {-6.0f, 0.0f, 0.6f}, 0.3f},
  };
  for (const Case& c : cases) {
    int blocked = 0, rays = 0;
    const int32_t shadow = shadow_on_floor(c.box, c.at, {c.light, c.radius}, blocked, rays);
    SCOPED_TRACE(std::to_string(c.at.x) + " " + std::to_string(c.light.y) + ": " + std::to_string(blocked) + " of " +
                 std::to_string(rays));
    if (shadow == 0) {
      EXPECT_EQ(blocked, 0);
    } else if (shadow == k_light_blocked) {
      EXPECT_EQ(blocked, rays);
    }
  }
}

// An object squeezed along one axis: in its unit space the light is wider there.
TEST(Cones, OfSqueezedObjectsHoldOnTheObject) {
  TestRandom random(11);
  Counts counts;
  for (int i = 0; i < 12; ++i) {
    const Vec3 x = random.direction(), z = glm::normalize(glm::cross(x, random.direction())), y = glm::cross(z, x);
    const Affine place(x, y, z * 0.15f, Vec3(0.0f));
    ConeScene s(make_knot({.along = 256, .around = 24}), place, {4.0f * random.direction(), 0.4f});
    query_and_count(s, self_shading_points(s, 150, random), random, counts);
  }
  EXPECT_GT(counts.clear, 100);
  EXPECT_LE(double(counts.wrong), 0.004 * double(counts.rays));
}

// Lights around the shading point, within the object, or behind it, and objects around both: no crash, and hardly a
// wrong answer.
TEST(Cones, LeaveWhatTheyCannotJudge) {
  TestRandom random(9);
  for (int i = 0; i < 300; ++i) {
    ConeScene s = tangled_scene(random);
    const ShadingPointBatch batch = tangled_shading_points(s, 40, random);
    Counts counts;
    query_and_count(s, batch, random, counts);
    ASSERT_LE(double(counts.wrong), 0.02 * double(counts.rays) + 1.0) << i;
  }
}

}  // namespace
}  // namespace fieldtrace
