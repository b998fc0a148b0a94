// Parts of lights filtered from coverage tiles: against exact rays, on every instruction set, and at the extremes.
#include <gtest/gtest.h>

#include <array>

#include "core/light/light_sampling.h"
#include "tests/support/cone_scene.h"

namespace fieldtrace {
namespace {

using namespace test;

constexpr LightSampleRange k_sixteen = {16, 0, 16, 4};

struct Strata {
  std::vector<uint32_t> shading_points;  // those answered by strata
  ShadingPointBatch chosen;              // a batch of these
  ShadowBatch batch;
  std::vector<uint8_t> undecided;  // per stratum
  Stats stats;
};

ShadingPointBatch choose(const ShadingPointBatch& all, const std::vector<uint32_t>& indices) {
  ShadingPointBatch chosen;
  chosen.resize(indices.size());
  for (size_t i = 0; i < indices.size(); ++i) {
    const size_t r = indices[i];
    set_shading_point(chosen, i, {all.px[r], all.py[r], all.pz[r]}, {all.gx[r], all.gy[r], all.gz[r]}, all.instance[r]);
    chosen.radius[i] = all.radius[r];
    chosen.seed[i] = uint32_t(r + 1) * 2654435761u;
  }
  return chosen;
}

Strata query_strata(const ConeScene& s, const LightTable& lights, const ShadingPointBatch& shading_points, Isa isa) {
  Strata strata;
  const ShadowAnswerer answerer = s.answerer(isa, 0.1f);
  const ShadowGroup group = s.find(answerer, shading_points, 4 * k_sixteen.total, strata.stats);
  for (uint32_t r = 0; r < shading_points.size; ++r) {
    if (group.shadow[r] == k_may_shadow && !group.by_rays[r]) strata.shading_points.push_back(r);
  }
  strata.chosen = choose(shading_points, strata.shading_points);
  sample_light(lights, 0, strata.chosen, k_sixteen, resolve_isa(isa), strata.batch);
  answerer.filter(
      {group, shading_points, strata.shading_points, k_sixteen.count, strata.batch, strata.undecided, strata.stats});
  return strata;
}

using Shares = std::array<double, 16>;  // of a light's strata

// Mean visibility of each stratum from each cluster, by exact rays: `samples` light samples for each of side x side
// points, one in each cell of a grid over a square in the cluster's circle, across its normal.
std::vector<Shares> exact_shares(const ConeScene& s, const LightTable& lights, const ShadingPointBatch& clusters,
                                 int side, int samples, TestRandom& random) {
  const size_t points = size_t(side * side), rays = points * size_t(samples);
  ShadingPointBatch spread;
  spread.resize(clusters.size * points);
  for (size_t r = 0; r < clusters.size; ++r) {
    const Vec3 n(clusters.gx[r], clusters.gy[r], clusters.gz[r]);
    const Vec3 x = glm::normalize(glm::cross(n, random.direction())), y = glm::cross(n, x);
    const float half = clusters.radius[r] * std::sqrt(0.5f);
    for (size_t j = 0; j < points; ++j) {
      const auto along = [&](size_t cell) {
        return half * (2.0f * (float(cell) + random.uniform()) / float(side) - 1.0f);
      };
      const Vec3 offset = along(j % size_t(side)) * x + along(j / size_t(side)) * y;
      const size_t i = r * points + j;
      set_shading_point(spread, i, Vec3(clusters.px[r], clusters.py[r], clusters.pz[r]) + offset, n, k_none);
      spread.seed[i] = clusters.seed[r];
      spread.sample[i] = uint32_t(j);
    }
  }
  ShadowBatch batch;
  sample_light(lights, 0, spread, {samples, 0, samples, 0, 4, 4}, Isa::automatic, batch);
  std::vector<uint32_t> all;
  for (uint32_t i = 0; i < batch.rays.size; ++i) {
    if (batch.rays.tmax[i] >= 0.0f) all.push_back(i);
  }
  s.accel->occluded_by(k_object, batch.rays, all, batch.blocked.data());
  std::vector<Shares> shares(clusters.size);
  for (size_t r = 0; r < clusters.size; ++r) {
    std::array<int, 16> count{}, clear{};
    for (size_t i = r * rays; i < (r + 1) * rays; ++i) {
      ++count[batch.cell[i]];
      clear[batch.cell[i]] += !batch.blocked[i];
    }
    for (size_t k = 0; k < 16; ++k) shares[r][k] = double(clear[k]) / std::max(count[k], 1);
  }
  return shares;
}

struct Errors {
  double strata = 0.0, rays = 0.0, bias = 0.0;      // sums over clusters of squares, and of differences
  double settled_strata = 0.0, settled_rays = 0.0;  // of those whose strata are all decided
  int gross = 0;  // of these, clusters that err by more than a third of the light: in no sum of squares
  int clusters = 0, partial = 0;
  int decided = 0, undecided = 0;  // strata
};

// Adds the errors of the strata that are decided, and of side x side rays to the same ones, against 1,024 rays. With
// `needs_whole`, of lights alone that lie above the horizon.
void add_errors(const ConeScene& s, const ShadingPointBatch& clusters, int side, bool needs_whole, TestRandom& random,
                Errors& errors) {
  const LightTable lights = make_lights(s.maker.scene);
  const Strata strata = query_strata(s, lights, clusters, Isa::automatic);
  const std::vector<Shares> truth = exact_shares(s, lights, strata.chosen, 8, 16, random);
  ShadingPointBatch again = strata.chosen;
  for (size_t r = 0; r < again.size; ++r) again.seed[r] ^= 0x5bd1e995u;
  const std::vector<Shares> few = exact_shares(s, lights, again, side, 1, random);
  for (size_t r = 0; r < strata.shading_points.size(); ++r) {
    const float* tmax = &strata.batch.rays.tmax[16 * r];
    if (needs_whole && std::any_of(tmax, tmax + 16, [](float t) { return t < 0.0f; })) continue;
    double error = 0.0, of_rays = 0.0;
    bool partial = false, settled = true;
    for (size_t k = 0; k < 16; ++k) {
      const float clear = strata.batch.clear[16 * r + k];
      EXPECT_GE(clear, 0.0f);
      EXPECT_LE(clear, 1.0f);
      if (strata.undecided[16 * r + k]) {
        ++errors.undecided;
        settled = false;
        continue;
      }
      ++errors.decided;
      error += (double(clear) - truth[r][k]) / 16.0;
      of_rays += (few[r][k] - truth[r][k]) / 16.0;
      partial = partial || (truth[r][k] > 0.0 && truth[r][k] < 1.0);
    }
    errors.bias += error;
    ++errors.clusters;
    if (settled && std::abs(error) > 1.0 / 3.0) {
      ++errors.gross;
      continue;
    }
    errors.strata += error * error;
    errors.rays += of_rays * of_rays;
    if (settled) {
      errors.settled_strata += error * error;
      errors.settled_rays += of_rays * of_rays;
    }
    errors.partial += partial;
  }
}

// A placement that only scales to unit space, so that the light's width is known.
ConeScene lit_scene(const TriangleMesh& mesh, TestRandom& random, float half_angle) {
  const Affine place = random_place(random, random.log_uniform(1e-2f, 1e2f), 1.0f);
  const float distance = 5.0f * glm::length(place[0]);
  return ConeScene(mesh, place, {Vec3(place[3]) + distance * random.direction(), distance * std::tan(half_angle)});
}

// Errors over placements of all meshes, under lights of the given half angle, beside side x side rays. Clusters have
// radii of up to that share of their distance from the light.
Errors errors_under(float half_angle, int side, float widest, uint32_t seed) {
  TestRandom random(seed);
  Errors errors;
  for (const TriangleMesh& mesh : solid_meshes()) {
    for (int i = 0; i < 8; ++i) {
      const ConeScene s = lit_scene(mesh, random, half_angle);
      ShadingPointBatch clusters = shadowed_shading_points(s, world_ball(s), 150, random);
      for (size_t r = 0; r < clusters.size; ++r) {
        const float distance = glm::length(s.light.centre - Vec3(clusters.px[r], clusters.py[r], clusters.pz[r]));
        clusters.radius[r] = widest * distance * random.log_uniform(0.1f, 1.0f);
      }
      add_errors(s, clusters, side, false, random, errors);
    }
  }
  EXPECT_EQ(errors.gross, 0);
  return errors;
}

// Half a step of a picture of 8 bits: what a mean visibility may be off by unseen.
constexpr double k_bias = 0.5 / 255.0;

TEST(Strata, OfWideLightsAreAsGoodAsSixtyFourRays) {
  const Errors errors = errors_under(0.17f, 8, 0.0f, 21);
  EXPECT_GT(errors.partial, 500);
  EXPECT_LT(errors.undecided, errors.decided / 4);
  EXPECT_LE(errors.strata, errors.rays);
  EXPECT_LE(std::abs(errors.bias) / errors.clusters, k_bias);
}

TEST(Strata, OfNarrowLightsAreBetterThanSixteenRays) {
  const Errors errors = errors_under(0.06f, 4, 0.0f, 22);
  EXPECT_GT(errors.partial, 300);
  EXPECT_LT(errors.undecided, errors.decided);
  EXPECT_LE(errors.strata, errors.rays);
  EXPECT_LE(std::abs(errors.bias) / errors.clusters, k_bias);
}

// Clusters of up to about two texels (k_widest_near), as wide as strata are filtered for at the default tolerance.
constexpr float k_cluster_width = 0.01f;

TEST(Strata, OfClustersUnderWideLightsAreAsGoodAsSixtyFourRays) {
  const Errors errors = errors_under(0.17f, 8, k_cluster_width, 26);
  EXPECT_GT(errors.partial, 500);
  EXPECT_LT(errors.undecided, errors.decided / 4);
  EXPECT_LE(errors.strata, errors.rays);
  EXPECT_LE(std::abs(errors.bias) / errors.clusters, k_bias);
}

// What a light narrower than a texel shows is as wide as the cluster, in all strata alike.
TEST(Strata, OfClustersUnderNarrowLightsAreBetterThanSixteenRays) {
  for (const float half_angle : {0.06f, 0.015f}) {
    const Errors errors = errors_under(half_angle, 4, k_cluster_width, 27);
    EXPECT_GT(errors.decided, 1000);
    SCOPED_TRACE(half_angle);
    EXPECT_LE(errors.strata, errors.rays);
    EXPECT_LE(std::abs(errors.bias) / errors.clusters, k_bias);
  }
}

TEST(Strata, AreTheSameOnEveryInstructionSet) {
  TestRandom random(23);
  for (const TriangleMesh& mesh : solid_meshes()) {
    ConeScene s = lit_scene(mesh, random, 0.1f);
    const LightTable lights = make_lights(s.maker.scene);
    ShadingPointBatch shading_points = shadowed_shading_points(s, world_ball(s), 333, random);
    for (size_t r = 0; r < shading_points.size; r += 2) shading_points.radius[r] = random.log_uniform(1e-4f, 1e-1f);
    const Strata scalar = query_strata(s, lights, shading_points, Isa::scalar);
    EXPECT_GT(scalar.shading_points.size(), 50u);
    EXPECT_GT(std::count(scalar.undecided.begin(), scalar.undecided.end(), 0), 400);
    for (const Isa isa : supported_isas()) {
      const Strata other = query_strata(s, lights, shading_points, isa);
      EXPECT_EQ(scalar.shading_points, other.shading_points) << isa_name(isa);
      EXPECT_EQ(scalar.undecided, other.undecided) << isa_name(isa);
      for (size_t i = 0; i < scalar.batch.rays.size; ++i) {
        ASSERT_EQ(scalar.batch.clear[i], other.batch.clear[i]) << isa_name(isa) << " " << i;
      }
    }
  }
}

// A light of which the disc at the blocker is a fraction of a texel: only whole answers, or none. (Most shading points
// have such answers before strata are asked about: these are the others, at the object's silhouettes.)
TEST(Strata, OfTinyLightsAreRefused) {
  TestRandom random(24);
  int whole = 0, refused = 0;
  for (int i = 0; i < 8; ++i) {
    ConeScene s = lit_scene(make_knot({.along = 256, .around = 24}), random, 1e-4f);
    const ShadingPointBatch shading_points = shadowed_shading_points(s, world_ball(s), 500, random);
    const Strata strata = query_strata(s, make_lights(s.maker.scene), shading_points, Isa::automatic);
    for (size_t k = 0; k < strata.undecided.size(); ++k) {
      if (strata.undecided[k]) {
        ++refused;
        continue;
      }
      ++whole;
      const float share = strata.batch.clear[k];
      EXPECT_TRUE(share == 0.0f || share == 1.0f) << share;
    }
  }
  EXPECT_GT(refused, 1600);
  EXPECT_GT(whole, 160);
}

// Lights around the shading point, within the object, or behind it, and objects around both: shares stay shares, and
// where all of a light is decided, it is as right as sixteen rays, but for about 1 in 3,000 that is taken for hidden
// or clear through what is thinner than a texel. (Where the horizon cuts the light, strata and samples do not stand for
// the same parts.) Strata beside undecided ones are less so.
TEST(Strata, LeaveWhatTheyCannotJudge) {
  TestRandom random(25);
  Errors errors;
  for (int i = 0; i < 600; ++i) {
    const ConeScene s = tangled_scene(random);
    add_errors(s, tangled_shading_points(s, 160, random), 4, true, random, errors);
  }
  EXPECT_GT(errors.decided, 4800);
  EXPECT_GT(errors.undecided, 4800);
  EXPECT_LE(errors.settled_strata, errors.settled_rays);
  EXPECT_LE(errors.gross, 1);
  EXPECT_LE(std::sqrt(errors.strata / errors.clusters), 0.01);
  EXPECT_LE(std::abs(errors.bias) / errors.clusters, k_bias);
}

// A sheared rectangle is sampled by area: the samples of a grid are the centres of its cells, whatever the seed.
TEST(Strata, OfAParallelogramAreTheCentresOfAGrid) {
  SceneMaker maker;
  const uint32_t bsdf = maker.bsdf(BsdfKind::diffuse, Rgb(0.5f));
  const Vec3 edge_x(1, 0, 0.5f), edge_y(0, 0, 2), centre(0, 5, 0);
  maker.area_light(
      maker.instance(maker.shape(ShapeKind::rectangle), bsdf, Affine(edge_x, edge_y, Vec3(0, -1, 0), centre)),
      Rgb(1.0f));
  const LightTable lights = make_lights(maker.scene);
  ASSERT_EQ(lights.lights[0].kind, LightKind::parallelogram);
  ShadingPointBatch shading_points;
  shading_points.resize(7);
  for (size_t r = 0; r < shading_points.size; ++r) {
    set_shading_point(shading_points, r, Vec3(0.3f * float(r), 0, 0), Vec3(0, 1, 0), k_none);
    shading_points.seed[r] = uint32_t(r) * 77u;
    shading_points.sample[r] = uint32_t(r);
  }
  for (const Isa isa : supported_isas()) {
    // Counts that are multiples of the vector length, and others.
    for (const LightSampleRange& range : {LightSampleRange{64, 0, 64, 8}, LightSampleRange{12, 0, 12, 3}}) {
      ShadowBatch batch;
      sample_light(lights, 0, shading_points, range, isa, batch);
      const int columns = range.columns, rows = range.total / columns;
      for (size_t i = 0; i < shading_points.size * size_t(range.count); ++i) {
        const int k = int(i) % range.total;
        const float x = float(2 * (k % columns) + 1) / float(columns) - 1.0f;
        const float y = float(2 * (k / columns) + 1) / float(rows) - 1.0f;
        const Vec3 expected = centre + x * edge_x + y * edge_y;
        ASSERT_GE(batch.rays.tmax[i], 0.0f);
        // The ray's end may lie off the light by its rounding bound.
        ASSERT_LT(glm::length(batch.rays.origin(i) + batch.rays.direction(i) - expected), 1e-4f) << k;
      }
    }
  }
}

}  // namespace
}  // namespace fieldtrace
