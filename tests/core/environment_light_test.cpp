// Environment maps: radiance by direction, sampling, and irradiance.

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "core/platform/error.h"
#include "tests/support/chi_square.h"
#include "tests/support/light_test_scenes.h"

namespace fieldtrace {
namespace {

using namespace light_test;

struct NamedMap {
  const char* name;
  Scene scene;
};

// A rotation with no entry equal to 0 or 1.
Mat3 tilted() {
  std::mt19937 random(5);
  return Mat3(random_rotation(random));
}

std::vector<NamedMap> maps() {
  const auto one = [](int bright_x, int bright_y) {
    return [=](int x, int y) { return Rgb(x == bright_x && y == bright_y ? 3.0f : 0.0f); };
  };
  return {{"white", environment_scene(8, 5, [](int, int) { return Rgb(2.0f); })},
          {"spotted", environment_scene(17, 9, spotted_texel)},
          {"spotted, tilted", environment_scene(17, 9, spotted_texel, tilted())},
          {"smallest", environment_scene(2, 3, [](int x, int y) { return Rgb(float(x + 1), float(y + 1), 1.0f); })},
          {"one texel", environment_scene(12, 7, one(4, 3))},
          {"first column", environment_scene(12, 7, one(0, 2))},
          {"last column", environment_scene(12, 7, one(11, 5))},
          {"north pole", environment_scene(12, 7, [](int, int y) { return Rgb(y == 0 ? 1.0f : 0.0f); })},
          {"south pole", environment_scene(12, 7, one(3, 6))},
          {"blue", environment_scene(9, 9, [](int x, int y) { return Rgb(0.0f, 0.0f, float(x * y)); })}};
}

// Radiance by definition, in double precision and independent of the code under test: bilinear between texel centres.
DVec3 reference_radiance(const Scene& scene, const DVec3& direction) {
  const Bitmap& map = scene.bitmaps[0];
  const DVec3 d = glm::transpose(DMat3(scene.emitters[0].rotation)) * glm::normalize(direction);
  const double u = std::atan2(d.x, -d.z) / (2 * M_PI) * map.width - 0.5;
  const double v = std::acos(glm::clamp(d.y, -1.0, 1.0)) / M_PI * (map.height - 1);
  const double x0 = std::floor(u), y0 = std::min(std::floor(v), map.height - 2.0);
  const auto texel = [&](double x, double y) {
    const int column = (int(x) % map.width + map.width) % map.width;
    return DVec3(glm::max(map.pixels[size_t(y) * map.width + column], Rgb(0.0f)));
  };
  const DVec3 above = glm::mix(texel(x0, y0), texel(x0 + 1, y0), u - x0);
  const DVec3 below = glm::mix(texel(x0, y0 + 1), texel(x0 + 1, y0 + 1), u - x0);
  return DVec3(scene.emitters[0].value) * glm::mix(above, below, v - y0);
}

// Largest texel value, which bounds the effect of a small displacement in the map.
double contrast(const Scene& scene) {
  float largest = 0.0f;
  for (const Rgb& p : scene.bitmaps[0].pixels) largest = std::max({largest, p.x, p.y, p.z});
  return double(largest);
}

std::vector<Vec3> random_directions(int count) {
  std::mt19937 random(17);
  std::normal_distribution<float> normal;
  // Exactly at the poles the map has a different value for each azimuth.
  std::vector<Vec3> directions = {{1, 0, 0}, {-1, 0, 0}, {0, 0, 1}, {0, 0, -1}, {1e-3f, -1, 0}, {0, 1, -1e-3f}};
  while (int(directions.size()) < count) directions.push_back({normal(random), normal(random), normal(random)});
  return directions;
}

TEST(EnvironmentMap, RadianceIsBilinearBetweenTexelCentres) {
  for (const NamedMap& m : maps()) {
    const LightTable lights = make_lights(m.scene);
    for (const Vec3& d : random_directions(2000)) {
      const Rgb radiance = emitted_radiance(lights, 0, d);
      const DVec3 expected = reference_radiance(m.scene, DVec3(d));
      // Angles are off by about 2^-20; times the largest width of these maps, 17 texels, that is below 2^-15 of a
      // texel.
      for (int c = 0; c < 3; ++c) {
        ASSERT_NEAR(radiance[c], expected[c], 0x1p-15 * contrast(m.scene)) << m.name << " " << d.x << " " << d.y;
      }
    }
  }
}

// Mitsuba's axes, by hand: texel (x, y) of a 4 x 3 map at phi = (x + 1/2) 90 degrees from -z towards +x, theta from +y.
TEST(EnvironmentMap, TexelsLieWhereMitsubaHasThem) {
  const LightTable lights = make_lights(environment_scene(4, 3, [](int x, int y) { return Rgb(float(y * 4 + x)); }));
  const auto grey = [&](const Vec3& d) { return emitted_radiance(lights, 0, d).x; };
  EXPECT_NEAR(grey({1, 0, -1}), 4.0f, 1e-5f);
  EXPECT_NEAR(grey({1, 0, 1}), 5.0f, 1e-5f);
  EXPECT_NEAR(grey({-1, 0, 1}), 6.0f, 1e-5f);
  EXPECT_NEAR(grey({-1, 0, -1}), 7.0f, 1e-5f);
  EXPECT_NEAR(grey({1, 0, 0}), 4.5f, 1e-5f);
  EXPECT_NEAR(grey({0, 0, -1}), 5.5f, 1e-5f) << "the last column and the first";
  EXPECT_NEAR(grey({1e-5f, 1, -1e-5f}), 0.0f, 1e-3f);
  EXPECT_NEAR(grey({1e-5f, -1, 1e-5f}), 9.0f, 1e-3f);
}

TEST(EnvironmentMap, RotationTurnsTheMap) {
  const LightTable upright = make_lights(environment_scene(17, 9, spotted_texel));
  const LightTable turned = make_lights(environment_scene(17, 9, spotted_texel, tilted()));
  for (const Vec3& d : random_directions(500)) {
    const Rgb a = emitted_radiance(upright, 0, d), b = emitted_radiance(turned, 0, tilted() * d);
    for (int c = 0; c < 3; ++c) ASSERT_NEAR(a[c], b[c], 1e-3f);
    const float p = light_pdf(upright, 0, Vec3(0), Vec3(0, 0, 1), true, d, {});
    const float q = light_pdf(turned, 0, Vec3(0), Vec3(0, 0, 1), true, tilted() * d, {});
    ASSERT_NEAR(p, q, 1e-3f);
  }
}

TEST(EnvironmentMap, ScaleOnlyScales) {
  Scene scene = environment_scene(17, 9, spotted_texel);
  const LightTable one = make_lights(scene);
  for (const float factor : {1e-30f, 0.25f, 7.0f, 1e30f}) {
    for (Rgb& p : scene.bitmaps[0].pixels) p *= factor;
    scene.emitters[0].value = Rgb(1.0f / factor);
    const LightTable other = make_lights(scene);
    for (const Vec3& d : random_directions(100)) {
      const Rgb a = emitted_radiance(one, 0, d), b = emitted_radiance(other, 0, d);
      for (int c = 0; c < 3; ++c) ASSERT_NEAR(a[c], b[c], 1e-5f * (a[c] + 1e-3f)) << factor;
      const float p = light_pdf(one, 0, Vec3(0), Vec3(0, 0, 1), true, d, {});
      ASSERT_NEAR(light_pdf(other, 0, Vec3(0), Vec3(0, 0, 1), true, d, {}), p, 1e-5f * p) << factor;
    }
    for (Rgb& p : scene.bitmaps[0].pixels) p /= factor;
  }
}

// ---------------------------------------------------------------- sampling

double density(const LightTable& lights, const Vec3& d) {
  return double(light_pdf(lights, 0, Vec3(0), Vec3(0, 0, 1), true, d, {}));
}

TEST(EnvironmentSampling, DensityIntegratesToOne) {
  for (const NamedMap& m : maps()) {
    const LightTable lights = make_lights(m.scene);
    // Midpoints in azimuth and cosine about the map's axis, so that a strip's corners are covered evenly.
    constexpr int k_n = 1024;
    double sum = 0.0;
    for (int i = 0; i < k_n * k_n; ++i) {
      const double z = 2 * (i / k_n + 0.5) / k_n - 1, phi = 2 * M_PI * (i % k_n + 0.5) / k_n, r = std::sqrt(1 - z * z);
      sum += density(lights, m.scene.emitters[0].rotation * Vec3(DVec3(r * std::cos(phi), z, r * std::sin(phi))));
    }
    EXPECT_NEAR(sum * 4 * M_PI / (k_n * k_n), 1.0, 2e-4) << m.name;
  }
}

TEST(EnvironmentSampling, SamplesFollowTheDensity) {
  constexpr size_t k_count = 200000;
  for (const NamedMap& m : maps()) {
    const LightTable lights = make_lights(m.scene);
    ShadingPoint shading_point;
    shading_point.transmits = true;  // no horizon
    ShadowBatch out;
    sample_light(lights, 0, batch_of(std::vector<ShadingPoint>(k_count, shading_point), 31), 1, Isa::automatic, out);
    ASSERT_EQ(out.active, k_count) << m.name;
    test::SphereHistogram observed, expected;
    for (size_t i = 0; i < k_count; ++i) observed.add(out.rays.direction(i));
    expected.integrate([&](const Vec3& d) { return density(lights, d); }, double(k_count), 24);
    EXPECT_LT(test::chi_square_deviation(observed.cells, expected.cells), 5.0) << m.name;
  }
}

TEST(EnvironmentSampling, SamplesCarryTheirDensityAndRadiance) {
  for (const NamedMap& m : maps()) {
    const LightTable lights = make_lights(m.scene);
    const Vec3 shading = glm::normalize(Vec3(0.3f, 0.1f, 1.0f));
    for (const bool transmits : {false, true}) {
      ShadowBatch out;
      const ShadingPoint shading_point = {Vec3(1, 2, 3), Vec3(0, 0, 1), shading, 0.0f, transmits};
      sample_light(lights, 0, batch_of(std::vector<ShadingPoint>(300, shading_point), 8), 7, Isa::automatic, out);
      if (transmits) {
        EXPECT_EQ(out.active, 2100u) << m.name;  // nothing lies below a horizon
      }
      for (size_t i = 0; i < out.rays.size; ++i) {
        if (out.rays.tmax[i] < 0.0f) continue;
        const Vec3 d = out.rays.direction(i);
        ASSERT_EQ(out.rays.tmax[i], k_infinity);
        ASSERT_NEAR(glm::length(d), 1.0f, 0x1p-20f);
        ASSERT_NEAR(double(out.weight[i]) * double(out.pdf[i]), std::fabs(glm::dot(d, shading)), 1e-5) << m.name;
        // A position in the map is off by about 2^-19 of a texel; where the map is nearly black, so is the density.
        const double largest =
            double(contrast(m.scene)) *
            double(lights.lights[0].luminance[0] + lights.lights[0].luminance[1] + lights.lights[0].luminance[2]);
        ASSERT_NEAR(density(lights, 3.0f * d), out.pdf[i], 0x1p-15 * std::max(largest, 1.0)) << m.name;
        const DVec3 radiance = reference_radiance(m.scene, DVec3(d));
        const Rgb value(lights.lights[0].value[0]);
        ASSERT_NEAR(value.x * out.red[i], radiance.x, 0x1p-14 * contrast(m.scene)) << m.name;
        ASSERT_NEAR(value.x * out.green[i], radiance.y, 0x1p-14 * contrast(m.scene)) << m.name;
        ASSERT_NEAR(value.x * out.blue[i], radiance.z, 0x1p-14 * contrast(m.scene)) << m.name;
      }
    }
  }
}

// Irradiance from light samples alone, without visibility, against quadrature of the definition.
TEST(EnvironmentSampling, IrradianceOfAPlane) {
  for (const NamedMap& m : maps()) {
    const LightTable lights = make_lights(m.scene);
    for (const Vec3& normal : {Vec3(0, 0, 1), glm::normalize(Vec3(0.5f, -1.0f, 0.2f)), Vec3(0, 1, 0)}) {
      constexpr int k_n = 816;  // for most of these maps half a texel is a whole number of cells
      DVec3 expected(0.0), fluence(0.0);
      for (int i = 0; i < k_n * k_n; ++i) {
        const double theta = M_PI * (i / k_n + 0.5) / k_n, phi = 2 * M_PI * (i % k_n + 0.5) / k_n;
        const DVec3 d(std::sin(theta) * std::cos(phi), std::cos(theta), std::sin(theta) * std::sin(phi));
        const DVec3 radiance = reference_radiance(m.scene, d) * (2 * M_PI * M_PI / (k_n * k_n) * std::sin(theta));
        expected += radiance * std::max(glm::dot(d, DVec3(normal)), 0.0);
        fluence += radiance;
      }
      constexpr int k_samples = 1 << 12, k_seeds = 64;
      ShadowBatch out;
      ShadingPointBatch b = batch_of(std::vector<ShadingPoint>(k_seeds, {Vec3(0), normal, normal}), 5);
      std::fill(b.sample.begin(), b.sample.end(), 0);
      sample_light(lights, 0, b, k_samples, Isa::automatic, out);
      DVec3 sum(0.0), squares(0.0);  // over the shading points' means
      for (size_t r = 0; r < k_seeds; ++r) {
        DVec3 mean(0.0);
        for (size_t k = r * k_samples; k < (r + 1) * k_samples; ++k)
          mean += double(out.weight[k]) * DVec3(out.red[k], out.green[k], out.blue[k]);
        mean *= double(lights.lights[0].value[0]) / k_samples;
        sum += mean;
        squares += mean * mean;
      }
      sum /= k_seeds;
      // Five standard errors, and the quadrature's error.
      const double level = std::max({fluence.x, fluence.y, fluence.z});
      for (int c = 0; c < 3; ++c) {
        const double error = std::sqrt(std::max(squares[c] / k_seeds - sum[c] * sum[c], 0.0) / (k_seeds - 1));
        EXPECT_NEAR(sum[c], expected[c], 5 * error + 3e-5 * level) << m.name << " channel " << c;
        EXPECT_LT(error, 3e-4 * level) << m.name;
      }
    }
  }
}

// ---------------------------------------------------------------- odd maps

TEST(EnvironmentMap, NegativeValuesCountAsZero) {
  const LightTable lights = make_lights(
      environment_scene(6, 5, [](int x, int y) { return x == 2 && y == 2 ? Rgb(-5.0f, 1.0f, -1.0f) : Rgb(0.0f); }));
  for (const Vec3& d : random_directions(300)) {
    const Rgb radiance = emitted_radiance(lights, 0, d);
    EXPECT_EQ(radiance.x, 0.0f);
    EXPECT_GE(radiance.y, 0.0f);
    EXPECT_EQ(radiance.z, 0.0f);
    EXPECT_GE(density(lights, d), 0.0);
  }
}

TEST(EnvironmentMap, BlackMapsAreNotSampled) {
  const LightTable lights = make_lights(environment_scene(6, 5, [](int, int) { return Rgb(0.0f); }));
  EXPECT_EQ(lights.lights[0].kind, LightKind::none);
  EXPECT_EQ(emitted_radiance(lights, 0, Vec3(0, 1, 0)), Rgb(0.0f));
  Scene dark = environment_scene(17, 9, spotted_texel);
  dark.emitters[0].value = Rgb(0.0f);
  EXPECT_EQ(make_lights(dark).lights[0].kind, LightKind::none);
}

TEST(EnvironmentMap, SizesAndNumbersOfMapsAreChecked) {
  const auto white = [](int, int) { return Rgb(1.0f); };
  EXPECT_THROW(make_lights(environment_scene(1, 8, white)), Error);
  EXPECT_THROW(make_lights(environment_scene(8, 1, white)), Error);
  EXPECT_THROW(make_lights(environment_scene(8, 2, white)), Error);
  EXPECT_NO_THROW(make_lights(environment_scene(2, 3, white)));
  Scene two = environment_scene(8, 4, white);
  two.emitters.push_back(two.emitters[0]);
  EXPECT_THROW(make_lights(two), Error);
  Scene none = environment_scene(8, 4, white);
  none.emitters[0].bitmap = k_none;
  EXPECT_THROW(make_lights(none), Error);
}

}  // namespace
}  // namespace fieldtrace
