// The sky by direction cells: against brute-force integrals of what make_lights() makes of the same scene.

#include "hybrid/sky/sky_radiance.h"
#include "field/bake/cell_lines.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "core/simd/vec_lanes.h"
#include "field/chart/chart.hd.h"
#include "field/maps/cell_visibility.hd.h"
#include "tests/support/light_test_scenes.h"

namespace fieldtrace {
namespace {

using namespace light_test;

constexpr int k_directions[] = {16, 32, 64};

double luminance(const DVec3& c) { return 0.2126 * c.x + 0.7152 * c.y + 0.0722 * c.z; }

std::vector<Vec3> random_normals(int count, uint32_t seed) {
  std::mt19937 random(seed);
  std::normal_distribution<float> normal;
  std::vector<Vec3> normals = {{1, 0, 0}, {0, 0, 1}, {0, 0, -1}};
  while (int(normals.size()) < count) {
    normals.push_back(glm::normalize(Vec3(normal(random), normal(random), normal(random))));
  }
  return normals;
}

// The grids of the world, a rotation, and a rotation that mirrors.
std::vector<Mat3> grids() {
  std::mt19937 random(3);
  const Mat3 rotation(random_rotation(random)), other(random_rotation(random));
  return {Mat3(1.0f), rotation, Mat3(-other[0], other[1], other[2])};
}

// Integrals over the sphere by equal areas: of the radiance of all lights, and of its product with each normal's
// cosine.
struct Integrals {
  DVec3 power = DVec3(0.0);
  std::vector<DVec3> irradiance;
};

Integrals integrate(const LightTable& lights, const std::vector<Vec3>& normals, int rows = 800) {
  Integrals all;
  all.irradiance.assign(normals.size(), DVec3(0.0));
  const double area = 4.0 * M_PI / (2.0 * rows * rows);
  for (int i = 0; i < rows; ++i) {
    const double z = 1.0 - (i + 0.5) * 2.0 / rows, r = std::sqrt(1.0 - z * z);
    for (int j = 0; j < 2 * rows; ++j) {
      const double phi = (j + 0.5) * M_PI / rows;
      const Vec3 d(float(r * std::cos(phi)), float(r * std::sin(phi)), float(z));
      DVec3 light(0.0);
      for (uint32_t k = 0; k < lights.size(); ++k) light += DVec3(emitted_radiance(lights, k, d)) * area;
      all.power += light;
      for (size_t k = 0; k < normals.size(); ++k) {
        all.irradiance[k] += light * std::max(double(glm::dot(normals[k], d)), 0.0);
      }
    }
  }
  return all;
}

DVec3 power(const SkyCells& cells, int directions) {
  DVec3 sum(0.0);
  for (size_t i = 0; i < cells.red.size(); ++i) sum += DVec3(cells.red[i], cells.green[i], cells.blue[i]);
  return sum * (4.0 * M_PI / (double(directions) * double(directions)));
}

DVec3 irradiance_of(const SkyCells& cells, int directions, const Vec3& n) {
  DVec3 sum(0.0);
  for (size_t i = 0; i < cells.red.size(); ++i) {
    const float mean = glm::dot(n, Vec3(cells.vx[i], cells.vy[i], cells.vz[i]));
    const double cosine = double(scalar::cosine_over_cell<float>(mean, cells.half_width[i]));
    sum += DVec3(cells.red[i], cells.green[i], cells.blue[i]) * cosine;
  }
  return sum * (4.0 * M_PI / (double(directions) * double(directions)));
}

// Sample k of samples x samples in cell i of a grid.
Vec3 direction_in(int i, int side, int k, int samples) {
  const auto place = [&](int cell, int x) {
    return (float(cell) + (float(x) + 0.5f) / float(samples)) * 2.0f / float(side) - 1.0f;
  };
  return to_vec(scalar::frame_from_square<float>(place(i / side, k / samples), place(i % side, k % samples)).c);
}

float noise(int x, int y) { return float(scalar::hash_uint(uint32_t(x * 977 + y + 1)) >> 8) * 0x1p-24f; }

// A blue sky over brown ground, with a band of haze over the horizon.
Rgb hazy_texel(int, int y) {
  const float haze = std::exp(-800.0f * (float(y) / 63.0f - 0.48f) * (float(y) / 63.0f - 0.48f));
  return y < 32 ? Rgb(0.3f, 0.5f, 0.9f) + 1.5f * haze : Rgb(0.12f, 0.1f, 0.08f);
}

Scene hazy_scene(int sun_x = -1, int sun_y = -1, float sun = 0.0f) {
  std::mt19937 random(11);
  return environment_scene(
      128, 64, [=](int x, int y) { return hazy_texel(x, y) + Rgb(x == sun_x && y == sun_y ? sun : 0.0f); },
      Mat3(random_rotation(random)));
}

struct NamedScene {
  const char* name;
  Scene scene;
};

std::vector<NamedScene> map_scenes() {
  std::vector<NamedScene> scenes = {
      {"hazy", hazy_scene()},
      {"smallest", environment_scene(2, 3, [](int x, int y) { return Rgb(float(x + 1), float(y + 1), 1.0f); })},
      {"noise", environment_scene(48, 25, [](int x, int y) { return Rgb(std::exp(3.0f * noise(x, y))); })},
      {"large",
       environment_scene(1024, 512, [](int x, int y) { return Rgb(1.0f + std::sin(float(x) / 50.0f), float(y), 9); })},
      {"with constants", hazy_scene()}};
  for (const float value : {0.5f, 2.0f}) {
    Emitter& constant = scenes.back().scene.emitters.emplace_back();
    constant.kind = EmitterKind::constant;
    constant.value = Rgb(value, 0.0f, 0.1f);
  }
  scenes.back().scene.emitters[0].value = Rgb(0.5f, 1.0f, 3.0f);
  return scenes;
}

TEST(CosineOverCell, IsTheMeanOverTheInterval) {
  std::mt19937 random(1);
  std::uniform_real_distribution<float> uniform;
  for (int i = 0; i < 200; ++i) {
    const float half = 0.3f * uniform(random) + 1e-3f, mean = uniform(random) * 3.0f * half - 1.5f * half;
    double sum = 0.0;
    constexpr int k_points = 2000;
    for (int k = 0; k < k_points; ++k) {
      sum += std::max(0.0, double(mean) + double(half) * ((k + 0.5) * 2.0 / k_points - 1.0));
    }
    // The midpoint rule errs by at most an eighth of a step, within one step.
    ASSERT_NEAR(scalar::cosine_over_cell<float>(mean, half), sum / k_points, 2e-7 * half + 1e-7 * std::abs(mean));
  }
  EXPECT_EQ(scalar::cosine_over_cell<float>(-0.1f, 0.1f), 0.0f);
  EXPECT_FLOAT_EQ(scalar::cosine_over_cell<float>(0.7f, 0.1f), 0.7f);
}

// The cosine over an interval stands for that over cells: both must vary as much.
TEST(SkyRadiance, TheHalfWidthHasTheVarianceOfCells) {
  const SkyRadiance sky(emitter_scene(EmitterKind::constant));
  for (const int directions : k_directions) {
    constexpr int k_samples = 16;
    double variance = 0.0;  // along a tangent, in the mean: half of E d^2 - (E d)^2
    for (int i = 0; i < directions * directions; ++i) {
      DVec3 mean(0.0);
      for (int k = 0; k < k_samples * k_samples; ++k) {
        mean += DVec3(direction_in(i, directions, k, k_samples)) / double(k_samples * k_samples);
      }
      variance += 0.5 * (1.0 - glm::dot(mean, mean)) / double(directions * directions);
    }
    const double half = double(sky.cells(Mat3(1.0f), directions).half_width[0]);
    EXPECT_NEAR(std::sqrt(3.0 * variance) / half, 1.0, 0.01) << directions;
  }
}

TEST(SkyRadiance, AConstantSkyIsExact) {
  Scene scene = emitter_scene(EmitterKind::constant);
  scene.emitters[0].value = Rgb(0.5f, 0.25f, 3.0f);
  scene.emitters.push_back(scene.emitters[0]);
  const Rgb value(1.0f, 0.5f, 6.0f);
  const SkyRadiance sky(scene);
  EXPECT_EQ(sky.concentrated(), nullptr);
  for (const Vec3& n : random_normals(10, 2)) EXPECT_EQ(sky.irradiance(n), value * k_pi);
  for (const Mat3& grid : grids()) {
    for (const int directions : k_directions) {
      const SkyCells cells = sky.cells(grid, directions);
      ASSERT_EQ(cells.red.size(), size_t(directions * directions));
      DVec3 sum(0.0);
      for (size_t i = 0; i < cells.red.size(); ++i) {
        ASSERT_EQ(Rgb(cells.red[i], cells.green[i], cells.blue[i]), value);
        const Vec3 v(cells.vx[i], cells.vy[i], cells.vz[i]), local = glm::transpose(grid) * v;
        sum += DVec3(v) / double(cells.red.size());
        ASSERT_LT(glm::length(v), 1.0f);
        scalar::CellAddress<float> cell;
        scalar::find_direction_cell(lanes(glm::normalize(local)), make_axis(directions), cell);
        ASSERT_EQ(cell.u * directions + cell.v, int(i));
      }
      // The map is symmetric; what is left is rounding, of the chart's polynomials most of all.
      EXPECT_LT(glm::length(sum), 1e-6);
    }
  }
}

// Each cell has the mean radiance of its own directions, whatever the grid's handedness.
TEST(SkyRadiance, CellsHoldTheirMeanRadiance) {
  constexpr int k_side = 16, k_samples = 16;
  for (const NamedScene& s : map_scenes()) {
    const LightTable lights = make_lights(s.scene);
    const SkyRadiance sky(s.scene);
    for (const Mat3& grid : grids()) {
      const SkyCells cells = sky.cells(grid, k_side);
      double error = 0.0, whole = 0.0;
      for (int i = 0; i < k_side * k_side; ++i) {
        double mean = 0.0;
        for (int k = 0; k < k_samples * k_samples; ++k) {
          const Vec3 d = direction_in(i, k_side, k, k_samples);
          for (uint32_t l = 0; l < lights.size(); ++l) {
            mean += luminance(DVec3(emitted_radiance(lights, l, grid * d))) / (k_samples * k_samples);
          }
        }
        const size_t cell = size_t(i);
        const double found = luminance(DVec3(cells.red[cell], cells.green[cell], cells.blue[cell]));
        error += (found - mean) * (found - mean), whole += mean * mean;
      }
      // Cells of the fine grid, an eighth as wide, go to the cell that their centre lies in.
      EXPECT_LT(std::sqrt(error / whole), 0.01) << s.name;
    }
  }
}

// Cells whose light varies are divided; all together they cover the sphere once and have the same light.
TEST(SkyRadiance, PartsShareTheLightOfTheirCells) {
  constexpr int k_side = 16, k_parts = 2;
  const SkyRadiance sky(hazy_scene());
  for (const Mat3& grid : grids()) {
    const SkyCells whole = sky.cells(grid, k_side), cells = sky.cells(grid, k_side, k_parts);
    std::vector<double> covered(whole.cells.size(), 0.0), light(whole.cells.size(), 0.0);
    int parts = 0;
    for (size_t i = 0; i < cells.cells.size(); ++i) {
      const SkyCell& cell = cells.cells[i];
      const double share = std::pow(double(k_side) / cell.side, 2.0);
      const auto of = size_t(cell.within(k_side));
      covered[of] += share, light[of] += share * double(cells.red[i]);
      parts += cell.side == k_side * k_parts;
      // In the cell, and where its light is.
      const int at = direction_cell(cells.directions[i], cell.side);
      ASSERT_EQ(at, cell.u * cell.side + cell.v);
      const Vec3 centre = grid * cells.directions[i];
      ASSERT_GT(glm::dot(centre, glm::normalize(Vec3(cells.vx[i], cells.vy[i], cells.vz[i]))), 1.0f - 1e-5f);
    }
    for (size_t i = 0; i < covered.size(); ++i) {
      ASSERT_EQ(covered[i], 1.0);
      ASSERT_NEAR(light[i] / double(whole.red[i]), 1.0, 1e-4);
    }
    // The band about the horizon is about a fifth of the sphere.
    EXPECT_GT(parts, k_side * k_side * k_parts * k_parts / 10);
    EXPECT_LT(parts, k_side * k_side * k_parts * k_parts * 9 / 10);
  }
  const SkyCells constant = SkyRadiance(emitter_scene(EmitterKind::constant)).cells(Mat3(1.0f), k_side, k_parts);
  EXPECT_EQ(constant.cells.size(), size_t(k_side * k_side));
}

TEST(SkyRadiance, IrradianceAgreesWithBruteForce) {
  const std::vector<Vec3> normals = random_normals(16, 7);
  for (const NamedScene& s : map_scenes()) {
    const Integrals expected = integrate(make_lights(s.scene), normals);
    const SkyRadiance sky(s.scene);
    ASSERT_EQ(sky.concentrated(), nullptr) << s.name;
    const double open = luminance(expected.power) / 4.0;  // mean irradiance over all normals
    for (size_t k = 0; k < normals.size(); ++k) {
      EXPECT_NEAR(luminance(DVec3(sky.irradiance(normals[k]))), luminance(expected.irradiance[k]), 0.001 * open)
          << s.name << " " << k;
    }
    for (const Mat3& grid : grids()) {
      for (const int directions : k_directions) {
        const SkyCells cells = sky.cells(grid, directions);
        EXPECT_NEAR(luminance(power(cells, directions)) / luminance(expected.power), 1.0, 0.001) << s.name;
        double squares = 0.0;
        for (size_t k = 0; k < normals.size(); ++k) {
          const DVec3 found = irradiance_of(cells, directions, normals[k]);
          squares += std::pow(luminance(found - expected.irradiance[k]) / open, 2.0) / double(normals.size());
        }
        // The cosine's error falls with the square of the cells' width.
        EXPECT_LT(std::sqrt(squares), 0.005 * std::pow(16.0 / directions, 2.0) + 0.0005) << s.name << " " << directions;
      }
    }
  }
}

// In grids as fine as the one that maps are filtered to, too, and of maps as narrow and as flat as they may be.
TEST(SkyRadiance, EveryCellHasTheLightOfAnEvenMap) {
  constexpr int k_sizes[][2] = {{8, 5}, {2, 3}, {8, 1024}, {2, 4096}, {2048, 3}};
  for (const auto& size : k_sizes) {
    const SkyRadiance sky(environment_scene(size[0], size[1], [](int, int) { return Rgb(3.0f); }));
    for (const Mat3& grid : grids()) {
      for (const int directions : {7, 24, 128, 200}) {
        for (const float red : sky.cells(grid, directions).red) ASSERT_NEAR(red, 3.0f, 1e-5f) << size[0];
      }
    }
  }
}

// The sky's brightest part is often the horizon, beside a dark ground: it must not be taken for the ground's, whichever
// rows of samples the border lies on, nor be made brighter.
TEST(SkyRadiance, ABrightHorizonLightsFloorsAndWalls) {
  for (const int height : {33, 64, 96, 100, 127, 128, 129, 256, 500, 512}) {
    const double horizon = 0.5 * (height - 1);
    const Scene scene = environment_scene(2 * height, height, [&](int, int y) {
      const double up = std::cos(M_PI * y / (height - 1));
      return Rgb(y < horizon ? float(0.1 + 6.0 * std::exp(-up / 0.08)) : 0.05f);
    });
    const SkyRadiance sky(scene);
    std::vector<Vec3> normals = random_normals(12, 3);
    normals[0] = Vec3(0.0f, 1.0f, 0.0f);
    const Integrals expected = integrate(make_lights(scene), normals);
    const double open = luminance(expected.power) / 4.0;
    for (size_t k = 0; k < normals.size(); ++k) {
      EXPECT_NEAR(luminance(DVec3(sky.irradiance(normals[k]))) / luminance(expected.irradiance[k]), 1.0, 0.006)
          << height << " " << k;
      EXPECT_NEAR(luminance(DVec3(sky.irradiance(normals[k]))) / open, luminance(expected.irradiance[k]) / open, 0.003)
          << height << " " << k;
    }
  }
}

// What cells have of a narrow band by the samples that fall in each is made good over the whole sphere.
TEST(SkyRadiance, NarrowBandsSendWhatTheyHave) {
  for (const int height : {96, 128, 160, 256}) {
    for (const int band : {height / 2, height / 2 - 3, height / 3, height / 5}) {
      const SkyRadiance sky(
          environment_scene(2 * height, height, [&](int, int y) { return Rgb(y == band ? 50.0f : 0.2f); }));
      double expected = 0.0;  // rows lie at whole numbers, and light is linear between them
      constexpr int k_steps = 100000;
      for (int k = 0; k < k_steps; ++k) {
        const double share = (k + 0.5) / k_steps, y = share * (height - 1);
        const double light = 0.2 + 49.8 * std::max(1.0 - std::abs(y - band), 0.0);
        expected += 2.0 * M_PI * light * std::sin(M_PI * share) * M_PI / k_steps;
      }
      for (const int directions : {16, 32, 128}) {
        const double found = luminance(power(sky.cells(Mat3(1.0f), directions), directions));
        EXPECT_NEAR(found / expected, 1.0, 0.001) << height << " " << band << " " << directions;
      }
    }
  }
}

// Nothing is left of a sky that is black but for a sun.
TEST(SkyRadiance, BlackSkiesHaveSunsAlone) {
  const SkyRadiance sky(
      environment_scene(64, 32, [](int x, int y) { return Rgb(x == 20 && y == 9 ? 1000.0f : 0.0f); }));
  ASSERT_NE(sky.concentrated(), nullptr);
  const SkyCells cells = sky.cells(Mat3(1.0f), 32);
  EXPECT_TRUE(std::all_of(cells.red.begin(), cells.red.end(), [](float red) { return red == 0.0f; }));
}

TEST(SkyRadiance, ASunIsCutOut) {
  const std::vector<Vec3> normals = random_normals(12, 5);
  const Scene scene = hazy_scene(40, 12, 3000.0f);
  const SkyRadiance sky(scene);
  ASSERT_NE(sky.concentrated(), nullptr);
  const Integrals whole = integrate(make_lights(scene), normals, 1500);
  const Integrals sun = integrate(*sky.concentrated(), normals, 1500);
  const Integrals rest = integrate(make_lights(hazy_scene()), normals);
  const double open = luminance(whole.power) / 4.0;
  EXPECT_NEAR(sky.concentrated_share(), luminance(sun.power) / luminance(whole.power), 0.001);
  // Nearly all of the sun, and nearly nothing but the sun.
  EXPECT_NEAR(luminance(sun.power) / luminance(whole.power - rest.power), 1.0, 0.005);
  for (size_t k = 0; k < normals.size(); ++k) {
    const double expected = luminance(whole.irradiance[k]), of_sun = luminance(sun.irradiance[k]);
    EXPECT_NEAR(luminance(DVec3(sky.irradiance(normals[k]))) + of_sun, expected, 0.001 * open) << k;
    ShadowBatch rays;
    ShadingPointBatch point = batch_of({{Vec3(0.0f), normals[k], normals[k]}}, 3);
    constexpr int k_samples = 4096;
    sample_light(*sky.concentrated(), 0, point, k_samples, Isa::automatic, rays);
    DVec3 mean(0.0);
    for (size_t i = 0; i < k_samples; ++i) {
      mean += DVec3(rays.red[i], rays.green[i], rays.blue[i]) * double(rays.weight[i]) / double(k_samples);
    }
    for (int c = 0; c < 3; ++c) mean[c] *= double(sky.concentrated()->lights[0].value[c]);
    EXPECT_NEAR(luminance(mean), of_sun, 0.002 * open) << k;
  }
  for (const Mat3& grid : grids()) {
    EXPECT_NEAR(luminance(power(sky.cells(grid, 32), 32) + sun.power) / luminance(whole.power), 1.0, 0.001);
  }
}

TEST(SkyRadiance, TheConeHoldsWhatIsCutOut) {
  // At the wrap of the columns, at both poles, alone under black, and two suns apart.
  std::vector<Scene> scenes = {hazy_scene(127, 20, 3000.0f), hazy_scene(5, 0, 1e6f), hazy_scene(5, 63, 1e6f)};
  scenes.push_back(environment_scene(128, 64, [](int x, int y) { return Rgb(x == 9 && y == 20 ? 1.0f : 0.0f); }));
  scenes.push_back(environment_scene(
      128, 64, [](int x, int y) { return Rgb((x == 9 && y == 20) || (x == 20 && y == 30) ? 100.0f : 0.01f); }));
  for (size_t s = 0; s < scenes.size(); ++s) {
    const SkyRadiance sky(scenes[s]);
    ASSERT_NE(sky.concentrated(), nullptr) << s;
    EXPECT_LT(sky.concentrated_angle(), 1.0f) << s;
    std::mt19937 random(4);
    std::normal_distribution<float> normal;
    int inside = 0;
    for (int i = 0; i < 400000; ++i) {
      const Vec3 near = sky.concentrated_axis() + 0.3f * Vec3(normal(random), normal(random), normal(random));
      const Vec3 d = glm::normalize(near);
      if (!(emitted_radiance(*sky.concentrated(), 0, d).x > 0.0f)) continue;
      ++inside;
      ASSERT_GT(glm::dot(d, sky.concentrated_axis()), std::cos(sky.concentrated_angle()) - 1e-6f) << s;
    }
    EXPECT_GT(inside, 50) << s;
  }
}

// Nothing is cut out of skies whose light is spread.
TEST(SkyRadiance, ASpreadLightIsNotCutOut) {
  EXPECT_EQ(SkyRadiance(hazy_scene(40, 12, 5.0f)).concentrated(), nullptr);  // .3 % of the power
  const auto wide = [](int x, int y) { return Rgb(x > 30 && x < 45 && y > 10 && y < 20 ? 50.0f : 0.1f); };
  EXPECT_EQ(SkyRadiance(environment_scene(128, 64, wide)).concentrated(), nullptr);
}

// But for those who ask for it: broad suns, and bands along the horizon.
TEST(SkyRadiance, ABroadSourceIsCutOutWhereItMayBe) {
  constexpr double k_largest = 1.0 / 64.0;
  const auto sun = [](int x, int y) {
    const float dx = float(x - 60), dy = float(y - 30);
    return hazy_texel(x, y) + Rgb(dx * dx + dy * dy < 9.0f ? 200.0f : 0.0f);
  };
  const auto band = [](int, int y) { return Rgb(y == 64 ? 50.0f : 0.2f); };
  const Scene scenes[] = {environment_scene(128, 64, sun), environment_scene(256, 128, band)};
  for (const Scene& scene : scenes) {
    const bool is_sun = &scene == &scenes[0];
    EXPECT_EQ(SkyRadiance(scene).concentrated(), nullptr);
    const SkyRadiance sky(scene, k_largest);
    ASSERT_NE(sky.concentrated(), nullptr);
    EXPECT_EQ(sky.concentrated_angle() < 0.3f, is_sun);
    EXPECT_EQ(sky.concentrated_angle() > 1.4f, !is_sun);
    const std::vector<Vec3> normals = random_normals(12, 5);
    const Integrals whole = integrate(make_lights(scene), normals, 1500);
    const Integrals cut = integrate(*sky.concentrated(), normals, 1500);
    EXPECT_NEAR(sky.concentrated_share(), luminance(cut.power) / luminance(whole.power), 0.001);
    for (size_t k = 0; k < normals.size(); ++k) {
      EXPECT_NEAR(luminance(DVec3(sky.irradiance(normals[k])) + cut.irradiance[k]), luminance(whole.irradiance[k]),
                  0.001 * luminance(whole.power) / 4.0)
          << k;
    }
  }
}

TEST(SkyRadiance, ExtremeValuesKeepTheirProportions) {
  const SkyRadiance black(environment_scene(4, 3, [](int, int) { return Rgb(0.0f); }));
  EXPECT_EQ(black.concentrated(), nullptr);
  EXPECT_EQ(black.irradiance(Vec3(0, 0, 1)), Rgb(0.0f));
  for (const float v : black.cells(Mat3(1.0f), 16).vx) EXPECT_TRUE(std::isfinite(v));
  const auto scaled_sky = [](float scale, bool has_sun) {
    Scene scene = has_sun ? hazy_scene(40, 12, 3000.0f) : hazy_scene();
    for (Rgb& c : scene.bitmaps[0].pixels) c *= scale;
    return SkyRadiance(scene);
  };
  for (const bool has_sun : {false, true}) {
    const SkyRadiance sky = scaled_sky(1.0f, has_sun);
    for (const float scale : {0x1p100f, 0x1p-60f}) {
      const SkyRadiance scaled = scaled_sky(scale, has_sun);
      EXPECT_EQ(scaled.concentrated() != nullptr, has_sun);
      EXPECT_FLOAT_EQ(scaled.concentrated_share(), sky.concentrated_share());
      const Vec3 n = glm::normalize(Vec3(1, -2, 3));
      EXPECT_NEAR(scaled.irradiance(n).x / scale, sky.irradiance(n).x, 1e-5f * sky.irradiance(n).x);
      const SkyCells cells = sky.cells(Mat3(1.0f), 16), scaled_cells = scaled.cells(Mat3(1.0f), 16);
      for (size_t i = 0; i < cells.red.size(); ++i) {
        ASSERT_FLOAT_EQ(scaled_cells.red[i] / scale, cells.red[i]);
        ASSERT_NEAR(scaled_cells.vx[i], cells.vx[i], 1e-5f);
      }
    }
  }
}

}  // namespace
}  // namespace fieldtrace
