// Segment and nearest queries of baked fields against Embree.
#include <gtest/gtest.h>

#include <functional>
#include <string>
#include <vector>

#include "core/mesh/mesh_procedural.h"
#include "core/mesh/mesh_stress.h"
#include "tests/support/field_fixture.h"

namespace fieldtrace {
namespace {

TriangleMesh crossing_plates() {
  TriangleMesh mesh = make_plane({.half_size = 0.6f, .columns = 8, .rows = 8});
  const auto count = uint32_t(mesh.positions.size());
  const size_t triangles = mesh.triangles.size();
  for (uint32_t i = 0; i < count; ++i) {
    const Vec3 p = mesh.positions[i];
    mesh.positions.push_back({p.z, p.x, p.y});
  }
  mesh.normals.clear();
  mesh.texcoords.clear();
  for (size_t i = 0; i < triangles; ++i) mesh.triangles.push_back(mesh.triangles[i] + count);
  return mesh;
}

struct Case {
  const char* name;
  TriangleMesh (*make)();
  bool open;               // an open surface: shading points lie on both sides
  double wrong_limit;      // share of certified answers that may differ from Embree
  double undecided_limit;  // share of segments that may stay undecided
};

// Wrong answers: the aim for solid meshes, .2 %; of an open plane fit and of a comb what
// docs/decisions/003-certificates.md gives for shading points on them. Asks: as docs/decisions/011-hard-meshes.md left
// them.
const std::vector<Case> k_cases = {
    {"sphere", [] { return make_sphere({.around = 64, .along = 32}); }, false, 0.002, 0.15},
    {"supershape", [] { return make_supershape({.around = 64, .along = 32}); }, false, 0.002, 0.25},
    {"knot", [] { return make_knot({.along = 256, .around = 16}); }, false, 0.002, 0.30},
    {"cube", [] { return make_cube(); }, false, 0.002, 0.15},
    {"sheet", [] { return make_wavy_sheet({.cells = 32}); }, true, 0.003, 0.58},
    {"comb", [] { return make_comb({.slats = 10}); }, false, 0.0051, 0.60},
    {"plates", [] { return crossing_plates(); }, true, 0.003, 0.25},
};

struct Score {
  int segments = 0, queried = 0, answered = 0, wrong = 0;
};

// One segment against Embree at the default tolerance, and at both ends of the tolerance scale.
void score_segment(FieldFixture& f, const Vec3& o, const Vec3& d, float t_max, bool self, Score& score) {
  const FieldVerdict verdict = f.probe().occluded(query_policy(0.1f), o, d, t_max, self);
  ++score.segments;
  if (verdict == FieldVerdict::undecided) {
    ++score.queried;
  } else {
    ++score.answered;
    score.wrong += (verdict == FieldVerdict::blocked) != f.embree_blocked(o, d, t_max);
  }
  ASSERT_NE(f.probe().occluded(query_policy(1.0f), o, d, t_max, self), FieldVerdict::undecided)
      << "tolerance 1 answers everything";
}

void expect_within(const Score& score, const Case& c, const char* kind) {
  ASSERT_GT(score.answered, 0) << c.name << " " << kind;
  EXPECT_LE(score.wrong, 2 + c.wrong_limit * score.answered) << c.name << " " << kind << ": of " << score.answered;
  EXPECT_LE(score.queried, c.undecided_limit * score.segments) << c.name << " " << kind << ": of " << score.segments;
}

// Points given in units of the ball, about its centre.
class FieldSegments : public ::testing::TestWithParam<size_t> {
 protected:
  FieldSegments() : fixture(k_cases[GetParam()].make()), random(uint32_t(100 + GetParam())) {}
  const Case& test_case() const { return k_cases[GetParam()]; }
  Vec3 at(const Vec3& p) { return fixture.ball().centre + p * fixture.ball().radius; }
  void score_points(const Vec3& from, const Vec3& to, Score& score) {
    score_segment(fixture, at(from), at(to) - at(from), 1.0f, false, score);
  }
  Vec3 outside() { return random.direction() * random.uniform(1.05f, 4.0f); }

  FieldFixture fixture;
  TestRandom random;
};

TEST_P(FieldSegments, OutsideToOutside) {
  Score score;
  for (int i = 0; i < 2000; ++i) {
    const Vec3 through = random.in_ball(), d = random.direction();
    score_points(through - d * random.uniform(2.0f, 50.0f), through + d * random.uniform(2.0f, 50.0f), score);
  }
  expect_within(score, test_case(), "outside-outside");
}

TEST_P(FieldSegments, InsideToOutsideAndBack) {
  Score out, in;
  for (int i = 0; i < 1000; ++i) {
    const Vec3 p = random.in_ball(), q = outside();
    score_points(p, q, out);
    score_points(q, p, in);
  }
  expect_within(out, test_case(), "inside-outside");
  expect_within(in, test_case(), "outside-inside");
}

TEST_P(FieldSegments, InsideToInside) {
  Score score;
  for (int i = 0; i < 1000; ++i) score_points(random.in_ball(), random.in_ball(), score);
  ASSERT_GT(score.answered, 0);
  EXPECT_LE(score.wrong, 2 + test_case().wrong_limit * score.answered) << test_case().name << " of " << score.answered;
}

TEST_P(FieldSegments, FromTheSurfaceItself) {
  Score away, to_a_point;
  for (int i = 0; i < 1200; ++i) {
    const auto r = fixture.shading_point(random, test_case().open);
    Vec3 d = random.direction();
    if (glm::dot(d, r.normal) < 0.0f) d = -d;
    score_segment(fixture, r.position, d, k_infinity, true, away);
    const Vec3 q = at(outside());
    if (glm::dot(q - r.position, r.normal) > 0.0f) {
      score_segment(fixture, r.position, q - r.position, 1.0f, true, to_a_point);
    }
  }
  // Shading points on a mesh of few large triangles and thin slats lie in creases more often than those of other
  // meshes.
  expect_within(away, test_case(), "surface, any direction");
  expect_within(to_a_point, test_case(), "surface, to a point");
}

TEST_P(FieldSegments, AdversarialLines) {
  // Past vertices and edges by 1e-6 ... 1e-2 radii, through the centre, along axes. Such lines graze silhouettes, so
  // they are often undecided and may err more; the limits only rule out random answers.
  Score score;
  const TriangleMesh& mesh = fixture.mesh();
  for (int i = 0; i < 1000; ++i) {
    const UVec3 t = mesh.triangles[random.index(uint32_t(mesh.triangles.size()))];
    const Vec3 a = mesh.positions[t.x], b = mesh.positions[t.y];
    const float s = random.uniform() < 0.3f ? 0.0f : random.uniform();
    const Vec3 p = a + (b - a) * s + random.direction() * (fixture.ball().radius * random.log_uniform(1e-6f, 1e-2f));
    const Vec3 d = random.direction() * fixture.ball().radius;
    score_segment(fixture, p - d * 3.0f, d, 6.0f, false, score);
  }
  for (int i = 0; i < 300; ++i) {
    Vec3 d(0.0f);
    d[int(random.index(3))] = random.uniform() < 0.5f ? 3.0f : -3.0f;
    if (random.uniform() < 0.5f) d = random.direction() * 3.0f;
    const Vec3 shift = random.direction() * random.log_uniform(1e-8f, 1e-3f);
    score_points(shift - d, shift + d, score);
  }
  ASSERT_GT(score.answered, 100);
  EXPECT_LE(score.wrong, 0.05 * score.answered) << test_case().name << " of " << score.answered;
}

TEST_P(FieldSegments, TinyAndHugeSegments) {
  Score score;
  for (int i = 0; i < 300; ++i) {
    const Vec3 p = random.in_ball(), d = random.direction();
    score_points(p, p + d * random.log_uniform(1e-7f, 1e-3f), score);
    const float far = random.log_uniform(1e2f, 1e4f);
    score_points(p - d * far, p + d * far, score);
    // Segments that do not reach the ball.
    EXPECT_EQ(fixture.probe().occluded(query_policy(0.1f), at(d * 3.0f), d, k_infinity, false), FieldVerdict::clear);
    EXPECT_EQ(fixture.probe().occluded(query_policy(0.1f), at(d * 3.0f), -d * fixture.ball().radius, 1.9f, false),
              FieldVerdict::clear);
  }
  ASSERT_GT(score.answered, 300);
  EXPECT_LE(score.wrong, 2 + test_case().wrong_limit * score.answered) << test_case().name << " of " << score.answered;
}

TEST_P(FieldSegments, ToleranceZeroAnswersNothing) {
  for (int i = 0; i < 300; ++i) {
    const Vec3 through = random.in_ball(), d = random.direction() * 3.0f;
    EXPECT_EQ(fixture.probe().occluded(query_policy(0.0f), at(through - d), d * fixture.ball().radius, 2.0f, false),
              FieldVerdict::undecided);
    EXPECT_EQ(fixture.probe().nearest(query_policy(0.0f), at(through - d), d, 0.0f, k_infinity, false).verdict,
              FieldVerdict::undecided);
  }
}

TEST_P(FieldSegments, BakingIsAPureFunctionOfTheCell) {
  // A second field, baked in the opposite order, answers alike.
  struct Query {
    Vec3 o, d;
  };
  std::vector<Query> queries;
  for (int i = 0; i < 200; ++i) {
    const Vec3 p = random.in_ball(), d = random.direction();
    queries.push_back({at(p), d});
  }
  FieldFixture other(test_case().make());
  std::vector<FieldVerdict> first, second;
  const QueryPolicy policy = query_policy(0.1f);
  for (const Query& q : queries) first.push_back(fixture.probe().occluded(policy, q.o, q.d, k_infinity, false));
  for (size_t i = queries.size(); i-- > 0;) {
    second.push_back(other.probe().occluded(policy, queries[i].o, queries[i].d, k_infinity, false));
  }
  EXPECT_TRUE(std::equal(first.begin(), first.end(), second.rbegin()));
}

TEST_P(FieldSegments, NearestHitsLieWithinTheirBounds) {
  int hits = 0, beyond = 0, misses = 0, wrong_misses = 0, wrong_hits = 0, queries = 0, undecided = 0, odd_normals = 0;
  const auto check = [&](const Vec3& o, const Vec3& d, float t_min, float t_max, bool self) {
    const FieldHit hit = fixture.probe().nearest(query_policy(0.1f), o, d, t_min, t_max, self);
    ASSERT_NE(fixture.probe().nearest(query_policy(1.0f), o, d, t_min, t_max, self).verdict, FieldVerdict::undecided);
    Vec3 normal;
    const float exact = fixture.embree_nearest(o + d * t_min, d, t_max - t_min, &normal);
    ++queries;
    if (hit.verdict == FieldVerdict::undecided) {
      ++undecided;
    } else if (hit.verdict == FieldVerdict::clear) {
      ++misses;
      wrong_misses += exact >= 0.0f;
    } else {
      ++hits;
      ASSERT_NEAR(glm::length(hit.normal), 1.0f, 1e-5f);
      ASSERT_LE(hit.t, t_max);
      ASSERT_LT(hit.primitive, fixture.mesh().triangles.size());
      if (exact < 0.0f) {
        ++wrong_hits;
      } else {
        beyond += std::abs(hit.t - (t_min + exact)) > hit.t_error;
        if (glm::dot(normal, d) > 0.0f) normal = -normal;
        odd_normals += glm::dot(normal, hit.normal) < 0.3f;
      }
    }
  };
  for (int i = 0; i < 900; ++i) {
    const Vec3 through = random.in_ball();
    const Vec3 d = random.direction() * (fixture.ball().radius * random.log_uniform(0.1f, 10.0f));
    const float reach = 3.0f * fixture.ball().radius / glm::length(d);
    check(at(through) - d * reach, d, random.uniform(0.0f, 0.3f) * reach, k_infinity, false);
    check(at(through) - d * reach, d, 0.0f, random.uniform(0.5f, 1.5f) * reach, false);
  }
  for (int i = 0; i < 1000; ++i) {
    const auto r = fixture.shading_point(random, test_case().open);
    Vec3 d = random.direction();
    if (glm::dot(d, r.normal) < 0.0f) d = -d;
    check(r.position, d, 0.0f, k_infinity, true);
  }
  ASSERT_GT(hits, 100);
  ASSERT_GT(misses, 100);
  EXPECT_LE(wrong_misses, 3 + test_case().wrong_limit * misses) << test_case().name << " of " << misses;
  EXPECT_LE(wrong_hits, 3 + test_case().wrong_limit * hits) << test_case().name << " of " << hits;
  EXPECT_LE(beyond, 3 + 0.01 * hits) << test_case().name << " of " << hits;
  EXPECT_LE(odd_normals, 3 + 0.01 * hits) << test_case().name << " of " << hits;
  EXPECT_LE(undecided, 0.7 * queries) << test_case().name << " of " << queries;
}

INSTANTIATE_TEST_SUITE_P(Meshes, FieldSegments, ::testing::Range(size_t(0), k_cases.size()),
                         [](const auto& name_of) { return std::string(k_cases[name_of.param].name); });

}  // namespace
}  // namespace fieldtrace
