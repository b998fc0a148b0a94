// Addresses and query answers agree bit for bit between the scalar code and every instruction set.
#include <gtest/gtest.h>

#include <cstring>
#include <vector>

#include "core/mesh/mesh_procedural.h"
#include "core/simd/isa.h"
#include "field/query/nearest.hd.h"
#include "tests/support/chart_parity.h"
#include "tests/support/field_fixture.h"

namespace fieldtrace {
namespace {

// The reference, one float at a time.
void trace_parity_scalar(const FieldView& field, const QueryPolicy& policy, const RayBatch& rays, bool self,
                         ParityResults& out) {
  for (size_t i = 0; i < rays.size; ++i) {
    const auto s = scalar::segment_in_unit_space<float>(k_parity_transform, {rays.ox[i], rays.oy[i], rays.oz[i]},
                                                        {rays.dx[i], rays.dy[i], rays.dz[i]}, rays.tmax[i]);
    const auto at = scalar::address_of_line(s.direction, s.foot, field.directions, field.plane);
    out.u[i] = at.u, out.v[i] = at.v, out.a[i] = at.a, out.b[i] = at.b;
    const auto segment = scalar::query_segment(field, policy, s, self && s.crosses);
    out.verdict[i] = segment.verdict;
    out.slice[i] = segment.verdict > scalar::k_verdict_undecided ? segment.slice : 0;
    const auto nearest = scalar::nearest_on_segment(field, policy, s, self && s.crosses);
    out.nearest[i] = nearest.verdict;
    out.distance[i] = nearest.distance;
  }
}

// Random rays, some of them along axes, through the centre, with denormal components, or from far away.
void fill_rays(TestRandom& random, RayBatch& rays) {
  for (size_t i = 0; i < rays.size; ++i) {
    Vec3 d = random.direction() * random.log_uniform(1e-3f, 1e3f);
    Vec3 o = random.in_ball() * random.log_uniform(0.1f, 10.0f);
    const uint32_t kind = random.index(16);
    if (kind == 0) d[int(random.index(3))] = random.uniform() < 0.5f ? 0.0f : -0.0f;
    if (kind == 1) d[int(random.index(3))] *= 1e-38f;
    if (kind == 2) o = -d * random.log_uniform(1.0f, 1e4f);
    if (kind == 3) {
      d = Vec3(0.0f);
      d[int(random.index(3))] = random.uniform() < 0.5f ? 1.0f : -1.0f;
    }
    rays.set(i, o, d, random.uniform() < 0.5f ? k_infinity : random.log_uniform(1e-3f, 1e3f));
  }
}

template <class T>
void expect_same(const AlignedVector<T>& a, const AlignedVector<T>& b, const char* what, Isa isa) {
  size_t different = 0;
  for (size_t i = 0; i < a.size(); ++i) different += std::memcmp(&a[i], &b[i], sizeof(T)) != 0;
  EXPECT_EQ(different, 0u) << what << " on " << isa_name(isa) << ", of " << a.size();
}

void compare(const FieldView& field, const QueryPolicy& policy, bool self, int batches, uint32_t seed) {
  constexpr size_t k_batch = 1 << 16;
  TestRandom random(seed);
  RayBatch rays;
  rays.resize(k_batch);
  ParityResults reference(k_batch), result(k_batch);
  for (int b = 0; b < batches; ++b) {
    fill_rays(random, rays);
    trace_parity_scalar(field, policy, rays, self, reference);
    for (const Isa isa : supported_isas()) {
      const ParityTrace trace = parity_trace(isa);
      if (trace == nullptr) continue;
      trace(field, policy, rays, self, result);
      expect_same(reference.u, result.u, "u", isa);
      expect_same(reference.v, result.v, "v", isa);
      expect_same(reference.a, result.a, "a", isa);
      expect_same(reference.b, result.b, "b", isa);
      expect_same(reference.verdict, result.verdict, "verdict", isa);
      expect_same(reference.slice, result.slice, "slice", isa);
      expect_same(reference.nearest, result.nearest, "nearest verdict", isa);
      expect_same(reference.distance, result.distance, "distance", isa);
    }
  }
}

TEST(ChartParity, AddressesAgreeOnEveryInstructionSet) {
  for (const auto& [directions, plane] : {std::pair{32, 512}, {64, 128}, {256, 64}}) {
    Field field({Vec3(0.0f), 1.0f}, {.directions = directions, .plane = plane});
    compare(field.view(), query_policy(0.1f), false, 8, uint32_t(directions));
  }
}

TEST(ChartParity, AnswersAgreeOnEveryInstructionSet) {
  // A coarse field baked by some thousand queries, so that all verdicts occur, unknown ones included.
  FieldFixture fixture(make_knot({.along = 128, .around = 12}), {.directions = 32, .plane = 64, .lines = 8});
  TestRandom random(31);
  for (int i = 0; i < 6000; ++i) {
    const Vec3 p = fixture.ball().centre + random.in_ball() * fixture.ball().radius;
    fixture.probe().nearest(query_policy(0.1f), p, random.direction(), 0.0f, k_infinity, i % 2 == 0);
  }
  for (const float tolerance : {0.0f, 0.1f, 0.5f, 1.0f}) {
    for (const bool self : {false, true}) {
      compare(fixture.field().view(), query_policy(tolerance), self, 2, 7);
    }
  }
}

TEST(ChartParity, EveryVerdictOccurs) {
  FieldFixture fixture(make_knot({.along = 128, .around = 12}), {.directions = 32, .plane = 64, .lines = 8});
  TestRandom random(31);
  RayBatch rays;
  rays.resize(1 << 14);
  fill_rays(random, rays);
  for (size_t i = 0; i < rays.size; i += 4) {
    fixture.probe().occluded(query_policy(0.1f), rays.origin(i), rays.direction(i), rays.tmax[i], false);
  }
  ParityResults results(rays.size);
  trace_parity_scalar(fixture.field().view(), query_policy(0.1f), rays, false, results);
  std::vector<int> count(6, 0);
  for (const int32_t v : results.verdict) ++count[size_t(v)];
  for (size_t v = 0; v < count.size(); ++v) EXPECT_GT(count[v], 0) << "verdict " << v;
}

}  // namespace
}  // namespace fieldtrace
