// Whole lights answered at once: against single exact rays, on every instruction set, and where answers are hard.
#include <gtest/gtest.h>

#include "core/mesh/mesh_stress.h"
#include "field/query/query.hd.h"
#include "tests/support/cone_scene.h"

namespace fieldtrace {
namespace {

using namespace test;

// Of the rays of answered lights so many may differ from exact ones (docs/decisions/009-cones.md).
constexpr double k_wrong_share = 0.001;

struct Counts {
  int clear = 0, blocked = 0, open = 0;  // shading points
  int64_t rays = 0, wrong_clear = 0, wrong_blocked = 0;
  int64_t wrong() const { return wrong_clear + wrong_blocked; }
};

// next_point(r): a point of shading point r's cluster.
template <class NextPoint>
void count_answers(const ConeScene& s, const ShadingPointBatch& batch, const ShadowGroup& group, TestRandom& random,
                   Counts& counts, const NextPoint& next_point) {
  constexpr int k_rays = 32;
  for (size_t r = 0; r < batch.size; ++r) {
    const int32_t shadow = group.shadow[r];
    if (shadow == k_may_shadow) {
      ++counts.open;
      continue;
    }
    const int blocked = s.blocked_rays(k_rays, random, [&] { return next_point(r); });
    counts.rays += k_rays;
    if (shadow == 0) {
      ++counts.clear;
      counts.wrong_clear += blocked;
    } else {
      ++counts.blocked;
      counts.wrong_blocked += k_rays - blocked;
    }
  }
}

Vec3 centre_of(const ShadingPointBatch& batch, size_t r) { return {batch.px[r], batch.py[r], batch.pz[r]}; }

void count_answers(const ConeScene& s, const ShadingPointBatch& batch, const ShadowGroup& group, TestRandom& random,
                   Counts& counts) {
  count_answers(s, batch, group, random, counts, [&](size_t r) { return centre_of(batch, r); });
}

void query_and_count(ConeScene& s, const ShadingPointBatch& batch, TestRandom& random, Counts& counts) {
  Stats stats;
  count_answers(s, batch, s.query(batch, Isa::automatic, 0.1f, stats), random, counts);
}

void expect_few_wrong(const Counts& counts) {
  EXPECT_LE(double(counts.wrong()), k_wrong_share * double(counts.rays))
      << counts.clear << " clear, " << counts.blocked << " blocked, " << counts.open << " open";
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
  expect_few_wrong(counts);
}

// A solid of random shape and placement under a light of random width.
ConeScene solid_under_a_light(const TriangleMesh& mesh, TestRandom& random) {
  const float size = random.log_uniform(1e-3f, 1e3f);
  const Affine place = random_place(random, size, 2.0f);
  const float distance = size * random.uniform(4.0f, 9.0f);
  return ConeScene(mesh, place,
                   {Vec3(place[3]) + distance * random.direction(), distance * random.log_uniform(0.003f, 0.1f)});
}

TEST(Cones, AnswersOnTheObjectAreThoseOfExactRays) {
  TestRandom random(6);
  Counts counts;
  for (const TriangleMesh& mesh : solid_meshes()) {
    for (int i = 0; i < 24; ++i) {
      ConeScene s = solid_under_a_light(mesh, random);
      query_and_count(s, self_shading_points(s, 600, random, OwnSide::front), random, counts);
    }
  }
  EXPECT_GT(counts.clear, 10000);
  EXPECT_GT(counts.blocked, 500);  // by other parts of the object
  expect_few_wrong(counts);
}

// How far below the surface between itself and the light a point within the object lies, in radii of the ball: under
// the plane of the triangle that the ray to the light's centre meets.
float depth_below(const ConeScene& s, const Vec3& point) {
  const Affine& to_object = s.maker.scene.instances[k_object].to_object;
  const Vec3 p = transform_point(to_object, point), d = transform_point(to_object, s.light.centre) - p;
  RayBatch ray;
  ray.resize(1);
  ray.set(0, p, d, k_infinity);
  ShapeHits hits;
  hits.resize(1);
  s.accel->shape_intersect(0, ray, hits);
  const Vec3 normal = glm::normalize(Vec3(hits.nx[0], hits.ny[0], hits.nz[0]));
  return hits.t[0] * std::abs(glm::dot(d, normal)) / s.field->ball().radius;
}

// An answer holds for all points of a cluster's ball.
TEST(Cones, AnswersForClustersHoldAllOverThem) {
  TestRandom random(13);
  Counts counts;
  for (const TriangleMesh& mesh : solid_meshes()) {
    for (int i = 0; i < 16; ++i) {
      const ConeScene s = solid_under_a_light(mesh, random);
      ShadingPointBatch batch = shadowed_shading_points(s, world_ball(s), 200, random);
      const float widest = world_ball(s).radius * 0.2f;
      for (size_t r = 0; r < batch.size; ++r) batch.radius[r] = widest * random.log_uniform(0.01f, 1.0f);
      Stats stats;
      const ShadowGroup group = s.query(batch, Isa::automatic, 0.1f, stats);
      count_answers(s, batch, group, random, counts,
                    [&](size_t r) { return centre_of(batch, r) + batch.radius[r] * random.in_ball(); });
    }
  }
  EXPECT_GT(counts.clear, 1000);
  EXPECT_GT(counts.blocked, 400);
  EXPECT_GT(counts.open, 500);
  expect_few_wrong(counts);
}

// On the object, for points of the surface about the cluster's centre.
TEST(Cones, AnswersForClustersOnTheObjectHoldAllOverThem) {
  TestRandom random(14);
  Counts counts;
  for (const TriangleMesh& mesh : solid_meshes()) {
    for (int i = 0; i < 24; ++i) {
      const ConeScene s = solid_under_a_light(mesh, random);
      std::vector<std::array<Vec3, 3>> corners;
      ShadingPointBatch batch = self_shading_points(s, 600, random, OwnSide::front, &corners);
      const auto in_triangle = [&](size_t r) {
        float u = random.uniform(), v = random.uniform();
        if (u + v > 1.0f) u = 1.0f - u, v = 1.0f - v;
        const auto& [a, b, c] = corners[r];
        const Vec3 centre = centre_of(batch, r), middle = (a + b + c) / 3.0f;
        Vec3 offset = (b - a) * u + (c - a) * v + (a - middle);
        const float length = glm::length(offset);
        if (length > batch.radius[r]) offset *= batch.radius[r] / length;
        return centre + offset;
      };
      const float widest = world_ball(s).radius / 64.0f;
      for (size_t r = 0; r < batch.size; ++r) batch.radius[r] = widest * random.log_uniform(0.05f, 2.0f);
      Stats stats;
      const ShadowGroup group = s.query(batch, Isa::automatic, 0.1f, stats);
      count_answers(s, batch, group, random, counts, in_triangle);
    }
  }
  EXPECT_GT(counts.clear, 10000);
  EXPECT_GT(counts.blocked, 400);
  expect_few_wrong(counts);
}

// Within a solid all is dark. What is called so is; what is called clear lies so near below the surface that a
// certificate, which speaks of one plane fit and knows no sides, takes it to lie on it.
TEST(Cones, AnswersWithinTheObjectAreWrongJustBelowItsSurfaceAlone) {
  // Of a cell's lines the farthest from its plane, in radii of the ball (k_max_residual); shading points count as in
  // front from k_front_share of twice that below the plane on, which is rounded up by a sixteenth at most
  // (field/store/encode.h).
  constexpr float k_residual = 0.005f;
  constexpr float k_below = k_residual + 2.0f * k_residual * scalar::k_front_share * (1.0f + 1.0f / 16.0f) + 0x1p-14f;
  TestRandom random(12);
  Counts counts;
  int deep = 0;
  for (const TriangleMesh& mesh : solid_meshes()) {
    for (int i = 0; i < 24; ++i) {
      ConeScene s = solid_under_a_light(mesh, random);
      const ShadingPointBatch batch = self_shading_points(s, 600, random, OwnSide::back);
      Stats stats;
      const ShadowGroup group = s.query(batch, Isa::automatic, 0.1f, stats);
      count_answers(s, batch, group, random, counts);
      for (size_t r = 0; r < batch.size; ++r) {
        if (group.shadow[r] == 0) deep += depth_below(s, {batch.px[r], batch.py[r], batch.pz[r]}) > k_below;
      }
    }
  }
  EXPECT_GT(counts.blocked, 10000);
  EXPECT_LE(double(counts.wrong_blocked), k_wrong_share * double(counts.rays));
  EXPECT_LE(double(deep), k_wrong_share * double(counts.clear + counts.blocked)) << counts.clear;
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
  EXPECT_GT(counts.clear, 5000);
  EXPECT_GT(counts.blocked, 1000);
  EXPECT_EQ(counts.wrong_blocked, 0);
  expect_few_wrong(counts);
}

TEST(Cones, AreTheSameOnEveryInstructionSet) {
  TestRandom random(7);
  for (const TriangleMesh& mesh : solid_meshes()) {
    const Affine place = random_place(random, 1.0f, 3.0f);
    ConeScene s(mesh, place, {Vec3(place[3]) + 4.0f * random.direction(), 0.2f});
    for (const bool self : {false, true}) {
      ShadingPointBatch batch =
          self ? self_shading_points(s, 333, random) : shadowed_shading_points(s, world_ball(s), 333, random);
      for (size_t r = 0; r < batch.size; r += 2) batch.radius[r] = random.log_uniform(1e-4f, 1e-1f);
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

// Lights that the shading point's own plane cuts, boxes behind and beside the shading point: nothing wrong may be
// claimed, but something.
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
      // In full sight of the light, and well behind the box.
      {{0.6f, 0.6f, 0.5f}, {1.0f, 0.0f}, {2.0f, 0.0f, 6.0f}, 0.3f},
      {{0.6f, 0.6f, 0.5f}, {0.9f, 0.0f}, {-6.0f, 0.0f, 2.0f}, 0.1f},
  };
  int clear = 0, hidden = 0;
  for (const Case& c : cases) {
    int blocked = 0, rays = 0;
    const int32_t shadow = shadow_on_floor(c.box, c.at, {c.light, c.radius}, blocked, rays);
    SCOPED_TRACE(std::to_string(c.at.x) + " " + std::to_string(c.light.y) + ": " + std::to_string(blocked) + " of " +
                 std::to_string(rays));
    if (shadow == 0) {
      ++clear;
      EXPECT_EQ(blocked, 0);
    } else if (shadow == k_light_blocked) {
      ++hidden;
      EXPECT_EQ(blocked, rays);
    }
  }
  EXPECT_GE(clear, 4);
  EXPECT_GE(hidden, 1);
}

// An object squeezed along one axis: in its unit space the light is wider there.
TEST(Cones, OfSqueezedObjectsHoldOnTheObject) {
  TestRandom random(11);
  Counts counts;
  for (int i = 0; i < 48; ++i) {
    const Vec3 x = random.direction(), z = glm::normalize(glm::cross(x, random.direction())), y = glm::cross(z, x);
    const Affine place(x, y, z * 0.15f, Vec3(0.0f));
    ConeScene s(make_knot({.along = 256, .around = 24}), place, {4.0f * random.direction(), 0.4f});
    query_and_count(s, self_shading_points(s, 600, random, OwnSide::front), random, counts);
  }
  EXPECT_GT(counts.clear, 1000);
  expect_few_wrong(counts);
}

// Lights around the shading point or too wide for it, and lights whose middle lies within the object's ball: nothing is
// claimed. Of others no more than that share is wrong.
TEST(Cones, LeaveWhatTheyCannotJudge) {
  constexpr float k_widest_sine = 0.6f;  // scalar::k_widest_cone_sine; a transform makes no light narrower
  TestRandom random(9);
  int beyond_judgement = 0;
  Counts judged;
  for (int i = 0; i < 300; ++i) {
    ConeScene s = tangled_scene(random);
    const ShadowAnswerer answerer = s.answerer(Isa::automatic, 0.1f);
    const Scene& scene = s.maker.scene;
    const Vec3 centre = transform_point(scene.instances[k_object].to_object, s.light.centre);
    const Sphere& ball = s.field->ball();
    const bool is_within = glm::length(centre - ball.centre) < ball.radius;
    const ShadingPointBatch all = tangled_shading_points(s, 40, random);
    for (size_t r = 0; r < all.size; ++r) {
      const Vec3 p(all.px[r], all.py[r], all.pz[r]);
      ShadingPointBatch one;
      one.resize(1);
      set_shading_point(one, 0, p, {all.gx[r], all.gy[r], all.gz[r]}, k_none);
      Stats stats;
      const ShadowGroup group = s.find(answerer, one, 256, stats);
      const bool is_wide = glm::length(s.light.centre - p) * k_widest_sine <= s.light.radius;
      if (is_wide || is_within) {
        ++beyond_judgement;
        ASSERT_EQ(stats.cones_clear + stats.cones_blocked, 0u) << i << " " << r;
      }
      // Culling may know that the object stands nowhere near.
      count_answers(s, one, group, random, judged);
    }
  }
  EXPECT_GT(beyond_judgement, 3000);
  EXPECT_GT(judged.clear, 200);
  EXPECT_GT(judged.blocked, 10);
  expect_few_wrong(judged);
}

}  // namespace
}  // namespace fieldtrace
