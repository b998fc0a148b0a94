// Batches of nearest queries: against Embree under a transform that shears and mirrors, and the same on every
// instruction set.

#include "field/query/hit_batch.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/mesh/mesh_procedural.h"
#include "field/query/query.hd.h"
#include "hybrid/visibility/query_and_bake.h"
#include "hybrid/visibility/shadow_answerer.h"
#include "hybrid/visibility/shadow_instance.h"
#include "tests/support/field_fixture.h"
#include "tests/support/random_lines.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace {
namespace {

using scalar::k_verdict_blocked;
using scalar::k_verdict_clear;
using scalar::k_verdict_none;
using scalar::k_verdict_undecided;

constexpr size_t k_rays = 20000;

class HitBatches : public testing::Test {
 protected:
  HitBatches() : fixture_(make_knot({.along = 512, .around = 48}), {64, 128, 16}) { place(Vec3(3, -2, 1)); }

  // The object's transform: sheared, mirrored, and moved to `at`.
  void place(const Vec3& at) {
    to_world_ = Affine(Vec3(1.5f, 0.4f, 0.1f), Vec3(-0.3f, 0.8f, 0.5f), Vec3(0.2f, 0.1f, -1.2f), at);
    test::SceneMaker maker;
    const uint32_t instance = maker.instance(maker.mesh(fixture_.mesh()), 0, to_world_);
    to_object_ = maker.scene.instances[instance].to_object;
    const ShapeTraits traits = {.is_flat = false, .wants_field = true};
    task_ = make_shadow_instance(maker.scene, instance, traits, &fixture_.field(), nullptr, {}).cone.segment;
  }

  // Unit rays from all sides through the ball, a fifth of them from inside it.
  HitQueries random_queries(uint32_t seed, float reach) const {
    TestRandom random(seed);
    HitQueries queries;
    queries.resize(k_rays);
    for (size_t i = 0; i < k_rays; ++i) {
      const Sphere& ball = fixture_.ball();
      const Vec3 through = transform_point(to_world_, ball.centre + random.in_ball() * ball.radius);
      const Vec3 d = random.direction();
      queries.rays.set(i, i % 5 == 0 ? through : through - d * (reach * random.log_uniform(1.0f, 3.0f)), d, k_infinity);
      queries.limit[i] = queries.most_error[i] = queries.most_bend[i] = k_infinity;
    }
    return queries;
  }

  HitAnswers query(const HitQueries& queries, Isa isa) {
    HitAnswers answers;
    answers.resize(queries.rays.size);
    HitUnknowns unknowns;
    BakeCounters counters;
    const auto bake = [&](FieldLayer layer, std::vector<uint32_t>& slices) {
      sort_unique(slices);
      bake_slices(fixture_.field(), layer, slices, fixture_.accel(), 0, counters);
    };
    query_and_bake(
        queries.rays.size, unknowns,
        [&](std::span<const uint32_t> blocks) {
          segment_kernels(isa).nearest_hits(task_, queries, blocks, answers, unknowns);
        },
        [&] {
          bake(FieldLayer::visibility, unknowns.visibility);
          bake(FieldLayer::depth, unknowns.depth);
          bake(FieldLayer::primitive, unknowns.primitive);
          return true;
        });
    EXPECT_TRUE(unknowns.blocks.empty());
    return answers;
  }

  // The exact hit's distance, negative for a miss, and its unit normal in world space.
  float exact(const RayBatch& rays, size_t i, Vec3* normal = nullptr) {
    Vec3 n;
    const float t = fixture_.embree_nearest(transform_point(to_object_, rays.origin(i)),
                                            transform_vector(to_object_, rays.direction(i)), k_infinity, &n);
    if (normal) *normal = glm::normalize(glm::transpose(Mat3(to_object_)) * n);
    return t;
  }

  static size_t count(const HitAnswers& answers, int verdict) {
    return size_t(std::count(answers.verdict.begin(), answers.verdict.begin() + std::ptrdiff_t(k_rays), verdict));
  }

  FieldFixture fixture_;
  Affine to_world_ = Affine(1.0f), to_object_ = Affine(1.0f);
  SegmentTask task_;
};

TEST_F(HitBatches, AgreeWithExactRays) {
  // From further away the reference loses as much to rounding as the queries do.
  for (const float reach : {4.0f, 400.0f}) {
    const HitQueries queries = random_queries(1, reach);
    const HitAnswers a = query(queries, Isa::scalar);
    size_t hits = 0, misses = 0, wrong_hits = 0, wrong_misses = 0, odd_normals = 0, before = 0;
    for (size_t i = 0; i < k_rays; ++i) {
      Vec3 normal;
      const float t = exact(queries.rays, i, &normal);
      if (a.verdict[i] == k_verdict_clear) {
        ++misses;
        wrong_misses += t >= 0.0f;
      }
      if (a.verdict[i] == k_verdict_blocked || a.verdict[i] == k_verdict_undecided)
        before += t >= 0.0f && t < a.from[i];
      if (a.verdict[i] != k_verdict_blocked) continue;
      ++hits;
      const Vec3 n(a.nx[i], a.ny[i], a.nz[i]);
      EXPECT_NEAR(glm::length(n), 1.0f, 1e-5f);
      EXPECT_LT(glm::dot(n, queries.rays.direction(i)), 0.0f);
      EXPECT_LT(size_t(a.primitive[i]), fixture_.mesh().triangles.size());
      EXPECT_LE(a.from[i], a.t[i] + a.error[i]);
      wrong_hits += !(std::abs(t - a.t[i]) <= 4.0f * a.error[i]);
      odd_normals += t >= 0.0f && std::abs(glm::dot(n, normal)) < 0.8f;
    }
    EXPECT_GT(hits, k_rays / 8) << reach;
    EXPECT_GT(misses, k_rays / 8) << reach;
    // The aim of docs/decisions/003-certificates.md.
    EXPECT_LE(wrong_hits, hits / 500) << reach;
    EXPECT_LE(wrong_misses, misses / 500) << reach;
    EXPECT_LE(odd_normals, 3 + hits / 100) << reach;
    EXPECT_LE(before, 3 + hits / 100) << reach;
  }
}

TEST_F(HitBatches, AreTheSameOnEveryInstructionSet) {
  HitQueries queries = random_queries(2, 4.0f);
  TestRandom random(3);
  for (size_t i = 0; i < k_rays; ++i) {
    queries.limit[i] = random.log_uniform(1.0f, 30.0f);
    queries.most_error[i] = random.log_uniform(1e-4f, 1.0f);
    queries.most_bend[i] = random.log_uniform(1e-2f, 1.0f);
    if (i % 11 == 0) queries.rays.tmax[i] = -1.0f;
    if (i % 7 == 0) queries.instance[i] = task_.instance;
  }
  const HitAnswers expected = query(queries, Isa::scalar);
  for (const int verdict : {k_verdict_none, k_verdict_clear, k_verdict_undecided, k_verdict_blocked}) {
    EXPECT_GT(count(expected, verdict), 100u) << verdict;
  }
  for (const Isa isa : supported_isas()) {
    const HitAnswers a = query(queries, isa);
    size_t different = 0;
    for (size_t i = 0; i < k_rays; ++i) {
      bool same = a.verdict[i] == expected.verdict[i];
      if (same && a.verdict[i] >= k_verdict_blocked) same = a.from[i] == expected.from[i];
      if (same && a.verdict[i] == k_verdict_blocked) {
        same = a.t[i] == expected.t[i] && a.error[i] == expected.error[i] && a.nx[i] == expected.nx[i] &&
               a.ny[i] == expected.ny[i] && a.nz[i] == expected.nz[i] && a.primitive[i] == expected.primitive[i];
      }
      different += !same;
    }
    EXPECT_EQ(different, 0u) << isa_name(isa);
  }
}

// Each bound alone leaves hits undecided, and changes nothing else.
TEST_F(HitBatches, RefuseWhatIsTooInexactOrTooBent) {
  const HitQueries all = random_queries(4, 4.0f);
  const HitAnswers free = query(all, Isa::scalar);
  const size_t hits = count(free, k_verdict_blocked);
  for (const auto bound : {&HitQueries::most_error, &HitQueries::most_bend}) {
    HitQueries queries = all;
    std::fill((queries.*bound).begin(), (queries.*bound).end(), 0.0f);
    EXPECT_EQ(count(query(queries, Isa::scalar), k_verdict_blocked), 0u);
    const float some = bound == &HitQueries::most_error ? 1e-3f : 0.2f;
    std::fill((queries.*bound).begin(), (queries.*bound).end(), some);
    const HitAnswers a = query(queries, Isa::scalar);
    EXPECT_GT(count(a, k_verdict_blocked), 0u);
    EXPECT_LT(count(a, k_verdict_blocked), hits);
    EXPECT_EQ(count(a, k_verdict_clear), count(free, k_verdict_clear));
    EXPECT_EQ(count(a, k_verdict_blocked) + count(a, k_verdict_undecided), hits + count(free, k_verdict_undecided));
    for (size_t i = 0; i < k_rays; ++i) {
      if (a.verdict[i] == k_verdict_blocked && bound == &HitQueries::most_error) {
        EXPECT_LE(a.error[i], some * a.t[i]);
      }
    }
  }
}

// Nothing is reported beyond the limit, and answers before it do not change.
TEST_F(HitBatches, TellNothingBeyondTheLimit) {
  const HitQueries all = random_queries(5, 4.0f);
  const HitAnswers free = query(all, Isa::scalar);
  HitQueries queries = all;
  TestRandom random(6);
  for (size_t i = 0; i < k_rays; ++i) {
    if (free.verdict[i] == k_verdict_blocked) queries.limit[i] = free.t[i] * random.uniform(0.5f, 1.5f);
  }
  const HitAnswers a = query(queries, Isa::scalar);
  size_t within = 0, beyond = 0;
  for (size_t i = 0; i < k_rays; ++i) {
    if (free.verdict[i] != k_verdict_blocked) continue;
    const bool is_within = free.from[i] <= queries.limit[i];
    (is_within ? within : beyond) += 1;
    EXPECT_EQ(a.verdict[i], is_within ? k_verdict_blocked : k_verdict_none);
    if (!is_within) continue;
    EXPECT_EQ(a.t[i], free.t[i]);
  }
  EXPECT_GT(within, 1000u);
  EXPECT_GT(beyond, 1000u);
}

}  // namespace
}  // namespace fieldtrace
