// Parts of lights filtered from coverage tiles: against exact rays, on every instruction set, and at the extremes.
#include <gtest/gtest.h>

#include "core/light/light_sampling.h"
#include "hybrid/light/direct_light.h"
#include "tests/support/cone_scene.h"

namespace fieldtrace {
namespace {

using namespace test;

constexpr LightSampleRange k_sixteen = {16, 0, 16, 4};

struct Strata {
  std::vector<uint32_t> shading_points;  // those answered by strata
  ShadingPointBatch chosen;              // a batch of these
  ShadowBatch batch;
  std::vector<uint8_t> refused;
  Stats stats;
};

ShadingPointBatch choose(const ShadingPointBatch& all, const std::vector<uint32_t>& indices) {
  ShadingPointBatch chosen;
  chosen.resize(indices.size());
  for (size_t i = 0; i < indices.size(); ++i) {
    const size_t r = indices[i];
    set_shading_point(chosen, i, {all.px[r], all.py[r], all.pz[r]}, {all.gx[r], all.gy[r], all.gz[r]}, all.instance[r]);
    chosen.seed[i] = uint32_t(r + 1) * 2654435761u;
  }
  return chosen;
}

Strata query_strata(const ConeScene& s, const LightTable& lights, const ShadingPointBatch& shading_points,
                    const LightSampleRange& range, Isa isa) {
  Strata strata;
  const ShadowAnswerer answerer = s.answerer(isa, 0.1f);
  const ShadowGroup group = s.find(answerer, shading_points, 4 * range.total, strata.stats);
  for (uint32_t r = 0; r < shading_points.size; ++r) {
    if (group.shadow[r] == k_may_shadow && !group.by_rays[r]) strata.shading_points.push_back(r);
  }
  strata.chosen = choose(shading_points, strata.shading_points);
  sample_light(lights, 0, strata.chosen, range, resolve_isa(isa), strata.batch);
  answerer.filter(group, strata.shading_points, range.count, strata.batch, strata.refused, strata.stats);
  return strata;
}

// Mean visibility of `count` light samples of each shading point, by exact rays.
std::vector<double> exact_shares(const ConeScene& s, const LightTable& lights, const ShadingPointBatch& shading_points,
                                 int count) {
  ShadowBatch batch;
  sample_light(lights, 0, shading_points, count, Isa::automatic, batch);
  std::vector<uint32_t> all;
  for (uint32_t i = 0; i < batch.rays.size; ++i) {
    if (batch.rays.tmax[i] >= 0.0f) all.push_back(i);
  }
  s.accel->occluded_by(k_object, batch.rays, all, batch.blocked.data());
  std::vector<double> shares;
  for (size_t r = 0; r < shading_points.size; ++r) {
    double clear = 0.0;
    for (size_t k = 0; k < size_t(count); ++k) clear += !batch.blocked[r * size_t(count) + k];
    shares.push_back(clear / count);
  }
  return shares;
}

double mean_of(const Strata& strata, size_t r, int count) {
  double sum = 0.0;
  for (size_t k = 0; k < size_t(count); ++k) sum += strata.batch.clear[r * size_t(count) + k];
  return sum / count;
}

struct Errors {
  double strata = 0.0, rays = 0.0, bias = 0.0;  // sums of squares and of differences
  int shading_points = 0, partial = 0, refused = 0;
};

// Adds the errors of strata, and of as many rays as `rays`, against 1,024 rays.
void add_errors(const ConeScene& s, const ShadingPointBatch& shading_points, int rays, Errors& errors) {
  const LightTable lights = make_lights(s.maker.scene);
  const Strata strata = query_strata(s, lights, shading_points, k_sixteen, Isa::automatic);
  const std::vector<double> truth = exact_shares(s, lights, strata.chosen, 1024);
  ShadingPointBatch again = strata.chosen;
  for (size_t r = 0; r < again.size; ++r) again.seed[r] ^= 0x5bd1e995u;
  const std::vector<double> few = exact_shares(s, lights, again, rays);
  for (size_t r = 0; r < strata.shading_points.size(); ++r) {
    errors.refused += strata.refused[r];
    if (strata.refused[r]) continue;
    const double error = mean_of(strata, r, k_sixteen.count) - truth[r];
    errors.strata += error * error;
    errors.bias += error;
    errors.rays += (few[r] - truth[r]) * (few[r] - truth[r]);
    ++errors.shading_points;
    errors.partial += truth[r] > 0.0 && truth[r] < 1.0;
  }
}

// A placement that only scales to unit space, so that the light's width is known.
ConeScene lit_scene(const TriangleMesh& mesh, TestRandom& random, float half_angle) {
  const Affine place = random_place(random, random.log_uniform(1e-2f, 1e2f), 1.0f);
  const float distance = 5.0f * glm::length(place[0]);
  return ConeScene(mesh, place, {Vec3(place[3]) + distance * random.direction(), distance * std::tan(half_angle)});
}

// Errors over placements of all meshes, under lights of the given half angle.
Errors errors_under(float half_angle, int rays, uint32_t seed) {
  TestRandom random(seed);
  Errors errors;
  for (const TriangleMesh& mesh : solid_meshes()) {
    for (int i = 0; i < 8; ++i) {
      const ConeScene s = lit_scene(mesh, random, half_angle);
      add_errors(s, shadowed_shading_points(s, world_ball(s), 150, random), rays, errors);
    }
  }
  return errors;
}

// Half a step of a picture of 8 bits: what a mean visibility may be off by unseen.
constexpr double k_bias = 0.5 / 255.0;

TEST(Strata, OfWideLightsAreAsGoodAsSixtyFourRays) {
  const Errors errors = errors_under(0.17f, 64, 21);
  EXPECT_GT(errors.partial, 500);
  EXPECT_LT(errors.refused, errors.shading_points / 4);
  EXPECT_LE(errors.strata, errors.rays);
  EXPECT_LE(std::abs(errors.bias) / errors.shading_points, k_bias);
}

TEST(Strata, OfNarrowLightsAreBetterThanSixteenRays) {
  const Errors errors = errors_under(0.06f, 16, 22);
  EXPECT_GT(errors.partial, 300);
  EXPECT_LT(errors.refused, errors.shading_points);
  EXPECT_LE(errors.strata, errors.rays);
  EXPECT_LE(std::abs(errors.bias) / errors.shading_points, k_bias);
}

TEST(Strata, AreTheSameOnEveryInstructionSet) {
  TestRandom random(23);
  for (const TriangleMesh& mesh : solid_meshes()) {
    ConeScene s = lit_scene(mesh, random, 0.1f);
    const LightTable lights = make_lights(s.maker.scene);
    const ShadingPointBatch shading_points = shadowed_shading_points(s, world_ball(s), 333, random);
    const Strata scalar = query_strata(s, lights, shading_points, k_sixteen, Isa::scalar);
    EXPECT_GT(scalar.shading_points.size(), 50u);
    EXPECT_GT(std::count(scalar.refused.begin(), scalar.refused.end(), 0), 25);
    for (const Isa isa : supported_isas()) {
      const Strata other = query_strata(s, lights, shading_points, k_sixteen, isa);
      EXPECT_EQ(scalar.shading_points, other.shading_points) << isa_name(isa);
      EXPECT_EQ(scalar.refused, other.refused) << isa_name(isa);
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
    const Strata strata =
        query_strata(s, make_lights(s.maker.scene), shadowed_shading_points(s, world_ball(s), 500, random), k_sixteen,
                     Isa::automatic);
    for (size_t r = 0; r < strata.shading_points.size(); ++r) {
      if (strata.refused[r]) {
        ++refused;
        continue;
      }
      ++whole;
      const double share = mean_of(strata, r, k_sixteen.count);
      EXPECT_TRUE(share == 0.0 || share == 1.0) << share;
    }
  }
  EXPECT_GT(refused, 100);
  EXPECT_GT(whole, 10);
}

// Lights around the shading point, within the object, or behind it, and objects around both: shares stay shares, and
// what is not refused is as right as sixteen rays.
TEST(Strata, LeaveWhatTheyCannotJudge) {
  TestRandom random(25);
  double wrong = 0.0, wrong_rays = 0.0;
  int shading_points = 0, refused = 0;
  for (int i = 0; i < 200; ++i) {
    const ConeScene s = tangled_scene(random);
    const ShadingPointBatch batch = tangled_shading_points(s, 160, random);
    const LightTable lights = make_lights(s.maker.scene);
    const Strata strata = query_strata(s, lights, batch, k_sixteen, Isa::automatic);
    const std::vector<double> truth = exact_shares(s, lights, strata.chosen, 256);
    ShadingPointBatch again = strata.chosen;
    for (size_t r = 0; r < again.size; ++r) again.seed[r] ^= 0x5bd1e995u;
    const std::vector<double> few = exact_shares(s, lights, again, 16);
    for (size_t i_stratum = 0; i_stratum < strata.batch.rays.size; ++i_stratum) {
      ASSERT_GE(strata.batch.clear[i_stratum], 0.0f);
      ASSERT_LE(strata.batch.clear[i_stratum], 1.0f);
    }
    for (size_t r = 0; r < strata.shading_points.size(); ++r) {
      refused += strata.refused[r];
      if (strata.refused[r]) continue;
      const ShadowBatch& b = strata.batch;
      // Where the shading point's horizon cuts the light, strata and samples do not stand for the same parts.
      bool whole = true;
      for (size_t k = r * 16; k < r * 16 + 16; ++k) whole = whole && b.rays.tmax[k] >= 0.0f;
      if (!whole) continue;
      const double error = mean_of(strata, r, 16) - truth[r];
      wrong += error * error;
      wrong_rays += (few[r] - truth[r]) * (few[r] - truth[r]);
      ++shading_points;
    }
  }
  EXPECT_GT(shading_points, 100);
  EXPECT_GT(refused, 100);
  EXPECT_LE(wrong, wrong_rays);
}

TEST(Strata, GridsAreAboutAsWideAsHighAndNeverOfMoreCellsThanSamples) {
  for (int m = 1; m < 3000; ++m) {
    const LightSampleRange grid = stratum_grid(m);
    ASSERT_GE(grid.total, 1);
    ASSERT_LE(grid.total, m);
    ASSERT_EQ(grid.total % grid.columns, 0);
    const int rows = grid.total / grid.columns;
    ASSERT_LE(grid.columns, rows);
    ASSERT_LE(rows, grid.columns + 2);
  }
  EXPECT_EQ(stratum_grid(64).total, 20);
  EXPECT_EQ(stratum_grid(1024).total, 256);
}

// A sheared rectangle is sampled by area: the samples of a grid are the centres of its cells, whatever the seed, scaled
// outwards for a lattice.
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
    for (const LightSampleRange& range :
         {LightSampleRange{64, 0, 64, 8}, LightSampleRange{12, 0, 12, 3}, LightSampleRange{16, 0, 16, 4, 1.25f}}) {
      ShadowBatch batch;
      sample_light(lights, 0, shading_points, range, isa, batch);
      const int columns = range.columns, rows = range.total / columns;
      for (size_t i = 0; i < shading_points.size * size_t(range.count); ++i) {
        const int k = int(i) % range.total;
        const float x = range.stretch * (float(2 * (k % columns) + 1) / float(columns) - 1.0f);
        const float y = range.stretch * (float(2 * (k / columns) + 1) / float(rows) - 1.0f);
        const Vec3 expected = centre + x * edge_x + y * edge_y;
        ASSERT_GE(batch.rays.tmax[i], 0.0f);
        // The ray's end may lie off the light by its rounding bound.
        ASSERT_LT(glm::length(batch.rays.origin(i) + batch.rays.direction(i) - expected), 1e-4f) << k;
      }
    }
  }
}

// A ball about (0, 0, 6), and lights of other shapes there that face the origin.
LightTable lights_above(std::initializer_list<ShapeKind> shapes, bool adds_sheared = false) {
  SceneMaker maker;
  const uint32_t bsdf = maker.bsdf(BsdfKind::diffuse, Rgb(0.5f));
  Affine place = test::scaling(Vec3(0.5f));
  place[3] = {0, 0, 6};
  maker.area_light(maker.instance(maker.shape(ShapeKind::sphere), bsdf, place), Rgb(1.0f));
  place[2] = -place[2];
  for (const ShapeKind shape : shapes) maker.area_light(maker.instance(maker.shape(shape), bsdf, place), Rgb(1.0f));
  place[0] += 0.25f * place[1];
  if (adds_sheared) maker.area_light(maker.instance(maker.shape(ShapeKind::rectangle), bsdf, place), Rgb(1.0f));
  return make_lights(maker.scene);
}

// The outer points of a lattice lie along the rim of a ball or disk, evenly.
TEST(Strata, LatticesRunAlongTheRimsOfRoundLights) {
  constexpr int k_side = 4;
  constexpr float k_extent = 0.98f;
  const LightTable lights = lights_above({ShapeKind::disk});
  ShadingPointBatch shading_points;
  shading_points.resize(1);
  set_shading_point(shading_points, 0, Vec3(0, 0, 0), Vec3(0, 0, 1), k_none);
  for (const uint32_t light : {0u, 1u}) {
    // Sine of the half angle of the ball, tangent of the disk's.
    const bool is_ball = light == 0;
    for (const Isa isa : supported_isas()) {
      ShadowBatch batch;
      sample_light(lights, light, shading_points, {16, 0, 16, k_side, k_extent * k_side / (k_side - 1)}, isa, batch);
      std::vector<float> turns;
      for (size_t i = 0; i < 16; ++i) {
        ASSERT_GE(batch.rays.tmax[i], 0.0f) << i;
        const Vec3 d = batch.rays.direction(i);
        const float across = std::hypot(d.x, d.y) / (is_ball ? glm::length(d) : d.z) / (0.5f / 6.0f);
        EXPECT_LE(across, 1.001f);
        if (across > 0.9f) turns.push_back(std::atan2(d.y, d.x));
      }
      ASSERT_EQ(turns.size(), 12u) << light;
      std::sort(turns.begin(), turns.end());
      for (size_t i = 1; i < turns.size(); ++i) EXPECT_NEAR(turns[i] - turns[i - 1], k_pi / 6.0f, 0.01f) << light;
    }
  }
}

// A sample point given for each shading point is sampled as the same point of a grid is.
TEST(Strata, OwnPointsAreSampledAsThoseOfGrids) {
  constexpr int k_side = 4;
  const LightTable lights = lights_above({ShapeKind::disk, ShapeKind::rectangle}, true);
  ASSERT_EQ(lights.lights[3].kind, LightKind::parallelogram);
  for (const size_t n : {size_t(1), size_t(16), size_t(37)}) {
    for (const uint8_t transmits : {uint8_t(0), uint8_t(1)}) {
      ShadingPointBatch shading_points;
      shading_points.resize(n);
      for (size_t r = 0; r < n; ++r) {
        set_shading_point(shading_points, r, Vec3(0.1f * float(r), 0, 0), Vec3(0, 0, 1), k_none);
        shading_points.sample[r] = uint32_t(r);
        shading_points.transmits[r] = r % 3 == 0 ? transmits : 0;
      }
      for (uint32_t light = 0; light < lights.size(); ++light) {
        for (const Isa isa : supported_isas()) {
          ShadowBatch grid, single;
          sample_light(lights, light, shading_points, {k_side * k_side, 0, k_side * k_side, k_side}, isa, grid);
          for (int k = 0; k < k_side * k_side; ++k) {
            const auto centre = [](int i) { return (float(2 * i) + 1.0f) / float(k_side) - 1.0f; };
            const AlignedVector<float> x(padded(n), centre(k % k_side)), y(padded(n), centre(k / k_side));
            sample_light(lights, light, shading_points, {1, 0, 1, 0, 1.0f, x.data(), y.data()}, isa, single);
            ASSERT_EQ(single.rays.size, n);
            ASSERT_GT(single.active, 0u);
            for (size_t r = 0; r < n; ++r) {
              const size_t i = r * k_side * k_side + size_t(k);
              ASSERT_EQ(single.rays.tmax[r], grid.rays.tmax[i]);
              ASSERT_EQ(single.rays.direction(r), grid.rays.direction(i)) << light << " " << k;
              ASSERT_EQ(single.rays.origin(r), grid.rays.origin(i));
              ASSERT_EQ(single.weight[r], grid.weight[i]);
              ASSERT_EQ(single.pdf[r], grid.pdf[i]);
            }
          }
        }
      }
    }
  }
}

}  // namespace
}  // namespace fieldtrace
