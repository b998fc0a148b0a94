// The sky by direction cells: irradiance against integrals of the emitters' radiance, and suns cut out of maps.

#include "hybrid/sky/sky_radiance.h"

#include <gtest/gtest.h>

#include "core/math/frame.h"
#include "core/simd/vec_lanes.h"
#include "field/maps/cell_visibility.hd.h"
#include "tests/support/random_lines.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace {
namespace {

using test::SceneMaker;

// A rotation, which may mirror.
Mat3 random_rotation(TestRandom& random, bool mirrors) {
  const Frame f = frame_about(random.direction());
  const float angle = random.uniform(0.0f, 2.0f * k_pi), c = std::cos(angle), s = std::sin(angle);
  return Mat3(f.s * c + f.t * s, f.t * c - f.s * s, mirrors ? -f.n : f.n);
}

// Directions all over the sphere, of equal solid angles: by z and azimuth, a grid that shares nothing with cells.
constexpr int k_bands = 512, k_columns = 1024;
template <class Visit>
void for_all_directions(const Visit& visit) {
  for (int i = 0; i < k_bands * k_columns; ++i) {
    const double z = (double(i / k_columns) + 0.5) * 2.0 / k_bands - 1.0;
    const double phi = (double(i % k_columns) + 0.5) * 2.0 * M_PI / k_columns, r = std::sqrt(1.0 - z * z);
    visit(Vec3(float(r * std::cos(phi)), float(r * std::sin(phi)), float(z)));
  }
}

// The sum of a table's lights, at all those directions.
std::vector<Rgb> radiances(const LightTable& table) {
  std::vector<Rgb> all;
  for_all_directions([&](const Vec3& d) {
    Rgb sum(0.0f);
    for (uint32_t i = 0; i < table.size(); ++i) {
      if (table.lights[i].kind != LightKind::none) sum += emitted_radiance(table, i, d);
    }
    all.push_back(sum);
  });
  return all;
}

DVec3 integral(const std::vector<Rgb>& radiance, const Vec3& n) {
  DVec3 sum(0.0);
  size_t i = 0;
  for_all_directions([&](const Vec3& d) { sum += DVec3(radiance[i++]) * std::max(double(glm::dot(n, d)), 0.0); });
  return sum * (4.0 * M_PI / double(k_bands * k_columns));
}

DVec3 sum_of_cells(const SkyCells& cells, int directions, const Vec3& n) {
  DVec3 sum(0.0);
  for (size_t i = 0; i < size_t(directions * directions); ++i) {
    const float mean = glm::dot(n, Vec3(cells.vx[i], cells.vy[i], cells.vz[i]));
    const double cosine = double(scalar::cosine_over_cell<float>(mean, cells.half_width));
    sum += DVec3(cells.red[i], cells.green[i], cells.blue[i]) * cosine;
  }
  return sum * (4.0 * M_PI / double(directions * directions));
}

double largest(const DVec3& v) { return std::max({std::abs(v.x), std::abs(v.y), std::abs(v.z)}); }

struct Errors {
  double table = 0.0, cells = 0.0;  // largest, in the irradiance that the sky has in the mean over all normals
};

// The table's cells are 2.8 degrees wide.
constexpr double k_table_error = 0.0025;
// With 16 and 32 cells a side: the aims for objects and for floors.
double cell_error(int directions) { return directions < 32 ? 0.01 : 0.005; }

// Of irradiance() and of sums over cells, for random normals and grids, without what is cut out.
Errors errors_of(const Scene& scene, const SkyRadiance& sky, int directions, TestRandom& random) {
  const std::vector<Rgb> all = radiances(make_lights(scene));
  std::vector<Rgb> sun(all.size(), Rgb(0.0f));
  if (sky.concentrated()) sun = radiances(*sky.concentrated());
  DVec3 mean(0.0);
  for (const Rgb& c : all) mean += DVec3(c) * (M_PI / double(all.size()));
  Errors errors;
  for (int trial = 0; trial < 12; ++trial) {
    const Vec3 n = random.direction();
    const DVec3 expected = integral(all, n) - integral(sun, n);
    const double scale = largest(mean);
    errors.table = std::max(errors.table, largest(DVec3(sky.irradiance(n)) - expected) / scale);
    const SkyCells cells = sky.cells(random_rotation(random, trial % 2), directions);
    errors.cells = std::max(errors.cells, largest(sum_of_cells(cells, directions, n) - expected) / scale);
  }
  return errors;
}

TEST(SkyRadiance, OfAConstantSkyIsConstant) {
  SceneMaker maker;
  maker.light(EmitterKind::constant, Rgb(0.5f, 1.0f, 3.0f));
  maker.light(EmitterKind::constant, Rgb(0.25f));
  const SkyRadiance sky(maker.scene);
  EXPECT_EQ(sky.concentrated(), nullptr);
  TestRandom random(1);
  for (const int directions : {8, 16, 32}) {
    const SkyCells cells = sky.cells(random_rotation(random, directions == 16), directions);
    for (size_t i = 0; i < cells.red.size(); ++i) {
      EXPECT_EQ(Rgb(cells.red[i], cells.green[i], cells.blue[i]), Rgb(0.75f, 1.25f, 3.25f));
      EXPECT_LE(glm::length(Vec3(cells.vx[i], cells.vy[i], cells.vz[i])), 1.0f + 1e-6f);
    }
    const Errors e = errors_of(maker.scene, sky, directions, random);
    EXPECT_LT(e.table, 1e-4) << directions;
    // Cells across the horizon are all taken to be as wide, an error of second order.
    EXPECT_LT(e.cells, 2.0 / (directions * directions)) << directions;
  }
}

TEST(SkyRadiance, OfMapsIsTheirIntegral) {
  TestRandom random(2);
  for (const int height : {3, 9, 33, 200}) {
    for (const int directions : {16, 32}) {
      SceneMaker maker;
      const int width = height == 3 ? 2 : 2 * height - 2;
      // Noise over a bright horizon.
      maker.environment(
          width, height,
          [&](int, int y) {
            const float up = std::cos(k_pi * float(y) / float(height - 1));
            return Rgb(random.uniform(), random.uniform(0.0f, 2.0f), 1.0f) * std::exp(-8.0f * up * up);
          },
          random_rotation(random, false));
      maker.scene.emitters[0].value = Rgb(2.0f, 0.5f, 1.0f);
      const SkyRadiance sky(maker.scene);
      EXPECT_EQ(sky.concentrated(), nullptr);
      const Errors e = errors_of(maker.scene, sky, directions, random);
      EXPECT_LT(e.table, k_table_error) << height << " " << directions;
      EXPECT_LT(e.cells, cell_error(directions)) << height << " " << directions;
    }
  }
}

// A map whose sun is a few texels wide, beside another emitter.
SceneMaker sunny(int height, int sun_row, int sun_column, float radiance, TestRandom& random) {
  SceneMaker maker;
  maker.environment(
      2 * height - 2, height,
      [&](int x, int y) {
        const bool is_sun = std::abs(y - sun_row) <= 1 && std::abs(x - sun_column) <= 1;
        return is_sun ? Rgb(1.0f, 0.9f, 0.7f) * radiance : Rgb(0.2f, 0.3f, 0.5f) * random.uniform(0.5f, 1.0f);
      },
      random_rotation(random, false));
  maker.light(EmitterKind::constant, Rgb(0.1f));
  return maker;
}

TEST(SkyRadiance, SunsAreCutOutAndNothingIsLost) {
  TestRandom random(3);
  for (const int row : {10, 40, 72}) {
    for (const float radiance : {500.0f, 1e30f}) {
      const SceneMaker maker = sunny(129, row, 0, radiance, random);  // across the map's seam
      const SkyRadiance sky(maker.scene);
      ASSERT_NE(sky.concentrated(), nullptr) << row;
      const std::vector<Rgb> sun = radiances(*sky.concentrated());
      const float cosine = std::cos(sky.concentrated_angle());
      size_t i = 0;
      for_all_directions([&](const Vec3& d) {
        if (sun[i++].x > 0.0f) {
          EXPECT_GE(glm::dot(d, sky.concentrated_axis()), cosine - 1e-6f);
        }
      });
      // Three texels a side and the slopes beside them, each 1.4 degrees wide.
      EXPECT_LT(sky.concentrated_angle(), 0.1f);
      const Errors e = errors_of(maker.scene, sky, 16, random);
      EXPECT_LT(e.table, k_table_error) << row << " " << radiance;
      EXPECT_LT(e.cells, cell_error(16)) << row << " " << radiance;
    }
  }
}

TEST(SkyRadiance, SunsOnBlackAreCutOutWhole) {
  SceneMaker maker;
  maker.environment(256, 129, [](int x, int y) { return Rgb(x == 70 && y == 40 ? 3.0f : 0.0f); });
  const SkyRadiance sky(maker.scene);
  ASSERT_NE(sky.concentrated(), nullptr);
  EXPECT_EQ(radiances(*sky.concentrated()), radiances(make_lights(maker.scene)));
  EXPECT_EQ(sky.irradiance(sky.concentrated_axis()), Rgb(0.0f));
}

TEST(SkyRadiance, BlackMapsAreBlack) {
  SceneMaker maker;
  maker.environment(16, 9, [](int, int) { return Rgb(0.0f); });
  const SkyRadiance sky(maker.scene);
  EXPECT_EQ(sky.concentrated(), nullptr);
  EXPECT_EQ(sky.irradiance(Vec3(0, 0, 1)), Rgb(0.0f));
  const SkyCells cells = sky.cells(Mat3(1.0f), 16);
  for (size_t i = 0; i < cells.red.size(); ++i) {
    EXPECT_EQ(Rgb(cells.red[i], cells.green[i], cells.blue[i]), Rgb(0.0f));
    EXPECT_NEAR(glm::length(Vec3(cells.vx[i], cells.vy[i], cells.vz[i])), 1.0f, 0.02f);
  }
}

TEST(SkyRadiance, OfHugeValuesIsFinite) {
  TestRandom random(4);
  SceneMaker maker;
  maker.environment(32, 17, [&](int, int) { return Rgb(1e30f) * random.uniform(); });
  const SkyRadiance sky(maker.scene);
  const Errors e = errors_of(maker.scene, sky, 16, random);
  EXPECT_LT(e.table, k_table_error);
  EXPECT_LT(e.cells, cell_error(16));
}

}  // namespace
}  // namespace fieldtrace
