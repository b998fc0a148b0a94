// Light sampling against analytic irradiance; densities, parity of instruction sets, numerical extremes.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <random>

#include "core/platform/error.h"
#include "tests/support/light_test_scenes.h"

namespace fieldtrace {
namespace {

using namespace light_test;

struct NamedLight {
  const char* name;
  LightTable table;
};

std::vector<NamedLight> all_lights() {
  const DAffine lamp = affine(DVec3(0.7, 0.1, 0), DVec3(-0.1, 0.7, 0), DVec3(0, 0, 0.70710678), DVec3(0.2, 0.3, 3));
  const DAffine skewed = affine(DVec3(0.7, 0.1, 0), DVec3(0.3, 0.5, 0), DVec3(0.1, 0, 0.9), DVec3(0.2, 0.3, 3));
  const DAffine big = scaled(9.0, DVec3(0.2, 0.3, 1));
  return {{"sphere", make_lights(area_scene(ShapeKind::sphere, scaled(0.7, DVec3(0.2, 0.3, 3))))},
          {"sphere_inside", make_lights(area_scene(ShapeKind::sphere, big, true))},
          {"rectangle", make_lights(area_scene(ShapeKind::rectangle, lamp, true))},
          {"parallelogram", make_lights(area_scene(ShapeKind::rectangle, skewed, true))},
          {"disk", make_lights(area_scene(ShapeKind::disk, skewed, true))},
          {"ellipsoid", make_lights(area_scene(ShapeKind::sphere, skewed))},
          {"cylinder", make_lights(area_scene(ShapeKind::cylinder, skewed))},
          {"mesh", make_lights(area_scene(mesh_shape(), skewed, true))},
          {"point", make_lights(emitter_scene(EmitterKind::point))},
          {"directional", make_lights(emitter_scene(EmitterKind::directional))},
          {"constant", make_lights(emitter_scene(EmitterKind::constant))},
          {"environment", make_lights(environment_scene(17, 9, spotted_texel))}};
}

std::vector<ShadingPoint> random_shading_points(size_t count, uint32_t seed, bool transmitting) {
  std::mt19937 random(seed);
  std::normal_distribution<float> normal;
  std::uniform_real_distribution<float> exponent(-6.0f, 6.0f);
  std::vector<ShadingPoint> shading_points(count);
  for (ShadingPoint& r : shading_points) {
    const float scale = std::pow(10.0f, exponent(random) * (random() % 4 == 0 ? 1.0f : 0.1f));
    r.point = scale * Vec3(normal(random), normal(random), normal(random));
    r.normal = glm::normalize(Vec3(normal(random), normal(random), normal(random)));
    r.shading = glm::normalize(r.normal + 0.3f * Vec3(normal(random), normal(random), normal(random)));
    r.error = scale * 1e-6f;
    r.transmits = transmitting && random() % 2 == 0;
  }
  return shading_points;
}

// ---------------------------------------------------------------- parity and validity

TEST(LightSampling, EveryInstructionSetGivesTheSameBits) {
  for (const NamedLight& light : all_lights()) {
    for (bool transmitting : {false, true}) {
      const ShadingPointBatch shading_points = batch_of(random_shading_points(77, 11, transmitting), 12);
      for (int m : {1, 2, 3, 4, 8, 16, 17, 64}) {
        ShadowBatch reference;
        sample_light(light.table, 0, shading_points, m, Isa::scalar, reference);
        for (Isa isa : supported_isas()) {
          ShadowBatch other;
          sample_light(light.table, 0, shading_points, m, isa, other);
          const auto same = [&](const auto& a, const auto& b) {
            return std::memcmp(a.data(), b.data(), reference.rays.size * sizeof(a[0])) == 0;
          };
          const RayBatch &r = reference.rays, &o = other.rays;
          ASSERT_TRUE(same(r.ox, o.ox) && same(r.oy, o.oy) && same(r.oz, o.oz) && same(r.dx, o.dx) &&
                      same(r.dy, o.dy) && same(r.dz, o.dz) && same(r.tmax, o.tmax) &&
                      same(reference.weight, other.weight) && same(reference.pdf, other.pdf) &&
                      same(reference.instance, other.instance))
              << light.name << " M " << m << " " << isa_name(isa);
          if (light.table.lights[0].kind != LightKind::environment) continue;
          ASSERT_TRUE(same(reference.red, other.red) && same(reference.green, other.green) &&
                      same(reference.blue, other.blue))
              << light.name << " M " << m << " " << isa_name(isa);
        }
      }
    }
  }
}

// Camera samples of one pixel share a sequence, which the vector loops exploit.
TEST(LightSampling, SamplesOfOnePixelAreTheSamePointsHoweverTheyAreBatched) {
  const LightTable lights = make_lights(area_scene(ShapeKind::sphere, scaled(0.7, DVec3(0.2, 0.3, 3))));
  for (const uint32_t first : {0u, 5u, 250u, 65530u}) {
    ShadingPointBatch pixel = batch_of(std::vector<ShadingPoint>(64), 3);
    for (uint32_t i = 0; i < 64; ++i) pixel.seed[i] = 9, pixel.sample[i] = first + i, pixel.instance[i] = 0;
    for (const Isa isa : supported_isas()) {
      ShadowBatch together, alone;
      sample_light(lights, 0, pixel, 1, isa, together);
      ASSERT_EQ(together.active, 64u);
      for (uint32_t i = 0; i < 64; ++i) {
        ShadingPointBatch one = batch_of({ShadingPoint{}}, 3);
        one.seed[0] = 9, one.sample[0] = first + i;
        sample_light(lights, 0, one, 1, isa, alone);
        ASSERT_EQ(together.rays.direction(i), alone.rays.direction(0)) << isa_name(isa) << " " << first + i;
      }
    }
  }
}

// The cell of a sample is that of the point of a fine grid over the sample square which is nearest as seen from the
// shading point: it lies in the same cell, or in one beside it.
TEST(LightSampling, CellsAreThoseOfTheSampleSquare) {
  constexpr int k_fine = 64, k_columns = 4, k_rows = 8, k_samples = 256;
  int tested = 0;
  for (const NamedLight& light : all_lights()) {
    // Others have no sample square, or one whose opposite sides meet.
    const LightKind kind = light.table.lights[0].kind;
    const LightKind kinds[] = {LightKind::sphere,        LightKind::sphere_inside, LightKind::rectangle,
                               LightKind::parallelogram, LightKind::disk,          LightKind::cylinder};
    if (std::find(std::begin(kinds), std::end(kinds), kind) == std::end(kinds)) continue;
    ++tested;
    ShadingPoint point;
    point.point = {0.1f, -0.2f, 0.05f};
    point.transmits = true;  // all directions count
    ShadingPointBatch one = batch_of({point}, 5);
    ShadowBatch fine;
    sample_light(light.table, 0, one, {k_fine * k_fine, 0, k_fine * k_fine, k_fine, k_columns, k_rows}, Isa::scalar,
                 fine);
    const auto cell = [&](int fine_index) {
      return (fine_index / k_fine) * k_rows / k_fine * k_columns + (fine_index % k_fine) * k_columns / k_fine;
    };
    for (int i = 0; i < k_fine * k_fine; ++i) ASSERT_EQ(int(fine.cell[size_t(i)]), cell(i)) << light.name << " " << i;
    for (const Isa isa : supported_isas()) {
      ShadowBatch batch;
      sample_light(light.table, 0, one, {k_samples, 0, k_samples, 0, k_columns, k_rows}, isa, batch);
      int compared = 0, beside = 0;
      std::vector<int> of_cell(k_columns * k_rows, 0);
      for (size_t k = 0; k < k_samples; ++k) {
        ASSERT_LT(batch.cell[k], uint32_t(k_columns * k_rows));
        if (batch.rays.tmax[k] < 0.0f) continue;
        const Vec3 d = batch.rays.direction(k);
        const auto gap = [&](int i) {
          return fine.rays.tmax[size_t(i)] < 0.0f ? k_infinity : glm::length(d - fine.rays.direction(size_t(i)));
        };
        int nearest = 0;
        for (int i = 1; i < k_fine * k_fine; ++i) nearest = gap(i) < gap(nearest) ? i : nearest;
        if (gap(nearest) == k_infinity) continue;
        ++compared;
        ++of_cell[batch.cell[k]];
        bool found = false;
        for (int y = -1; y <= 1; ++y) {
          for (int x = -1; x <= 1; ++x) {
            const int row = std::clamp(nearest / k_fine + y, 0, k_fine - 1),
                      column = std::clamp(nearest % k_fine + x, 0, k_fine - 1);
            found = found || cell(row * k_fine + column) == int(batch.cell[k]);
          }
        }
        beside += !found;
      }
      EXPECT_GT(compared, k_samples / 4) << light.name;
      EXPECT_EQ(beside, 0) << light.name << " " << isa_name(isa) << " of " << compared;
      EXPECT_GT(std::count_if(of_cell.begin(), of_cell.end(), [](int n) { return n > 0; }), k_columns) << light.name;
    }
  }
  EXPECT_EQ(tested, 6);
}

TEST(LightSampling, SlotsAreFiniteAndPaddingInactive) {
  for (const NamedLight& light : all_lights()) {
    for (bool transmitting : {false, true}) {
      const std::vector<ShadingPoint> list = random_shading_points(501, 13, transmitting);
      const ShadingPointBatch shading_points = batch_of(list, 14);
      ShadowBatch out;
      sample_light(light.table, 0, shading_points, 3, Isa::automatic, out);
      size_t active = 0;
      for (size_t i = 0; i < out.rays.size; ++i) {
        const bool on = out.rays.tmax[i] >= 0.0f;
        active += on;
        for (float x : {out.rays.ox[i], out.rays.oy[i], out.rays.oz[i], out.rays.dx[i], out.rays.dy[i], out.rays.dz[i],
                        out.weight[i], out.pdf[i]}) {
          ASSERT_TRUE(std::isfinite(x)) << light.name << " " << i;
        }
        ASSERT_GT(glm::dot(out.rays.direction(i), out.rays.direction(i)), 0.0f);
        ASSERT_GE(out.weight[i], 0.0f);
        ASSERT_EQ(out.instance[i], i / 3 + 7);
        ASSERT_TRUE(on || out.weight[i] == 0.0f);
        if (on && !list[i / 3].transmits) {
          ASSERT_GT(glm::dot(out.rays.direction(i), list[i / 3].normal), 0.0f) << light.name;
        }
      }
      for (size_t i = out.rays.size; i < padded(out.rays.size); ++i) ASSERT_LT(out.rays.tmax[i], 0.0f);
      EXPECT_GT(active, out.rays.size / 10) << light.name;
    }
  }
}

TEST(LightSampling, OriginLeavesTheSurfaceOnTheSideOfTheDirection) {
  const std::vector<ShadingPoint> list = random_shading_points(200, 15, true);
  for (const NamedLight& light : all_lights()) {
    ShadowBatch out;
    sample_light(light.table, 0, batch_of(list, 16), 4, Isa::automatic, out);
    EXPECT_GT(out.active, out.rays.size / 10) << light.name;
    for (size_t i = 0; i < out.rays.size; ++i) {
      if (out.rays.tmax[i] < 0.0f) continue;
      const ShadingPoint& r = list[i / 4];
      const DVec3 offset = DVec3(out.rays.origin(i)) - DVec3(r.point);
      const double side = glm::dot(DVec3(out.rays.direction(i)), DVec3(r.normal));
      const double moved = glm::dot(offset, DVec3(r.normal)) * (side > 0 ? 1.0 : -1.0);
      ASSERT_GE(moved, double(r.error) * (1.0 - 0x1p-20)) << light.name;
    }
  }
}

// ---------------------------------------------------------------- irradiance

TEST(SphereLight, IrradianceAtAllScales) {
  std::mt19937 random(21);
  std::uniform_real_distribution<double> exponent(-6.0, 6.0), unit(0.0, 1.0);
  for (int probe = 0; probe < 300; ++probe) {
    const double distance = std::pow(10.0, exponent(random));
    double radius = std::pow(10.0, exponent(random));
    if (radius >= distance) radius = distance * (0.02 + 0.9 * unit(random));
    const DVec3 direction = glm::normalize(DVec3(0.3, -0.2, 1.0));
    ShadingPoint r;
    // Tilted so that the whole sphere stays above the horizon.
    r.normal = r.shading = Vec3(radius < 0.5 * distance ? DVec3(0, 0, 1) : direction);
    const LightTable lights = make_lights(area_scene(ShapeKind::sphere, scaled(radius, distance * direction)));
    const double expected = M_PI * std::pow(radius / distance, 2.0) * glm::dot(direction, DVec3(r.normal));
    // Measured: below 1e-4 at 4,096 samples of a scrambled net; float sums of positions cost up to 1e-5 more.
    EXPECT_NEAR(irradiance(lights, r, 4096, uint32_t(probe)), expected, 2e-4 * expected)
        << "radius " << radius << " distance " << distance;
  }
}

TEST(SphereLight, TouchingInsideAndFlipped) {
  const LightTable outside = make_lights(area_scene(ShapeKind::sphere, scaled(2.0, DVec3(0, 0, 2))));
  const LightTable inside = make_lights(area_scene(ShapeKind::sphere, scaled(2.0, DVec3(0, 0, 2)), true));
  ShadingPoint touching;
  EXPECT_GE(irradiance(outside, touching, 256, 1), 0.0);
  ShadingPoint near;
  near.point = Vec3(0, 0, -1e-4f);
  EXPECT_NEAR(irradiance(outside, near, 4096, 1), M_PI * std::pow(2.0 / 2.0001, 2.0), 2e-3);
  ShadingPoint centre;
  centre.point = Vec3(0.3f, 0.2f, 1.5f);
  EXPECT_EQ(irradiance(outside, centre, 256, 1), 0.0) << "a sphere does not shine inwards";
  EXPECT_NEAR(irradiance(inside, centre, 16384, 1), M_PI, 2e-3);
  EXPECT_EQ(irradiance(inside, ShadingPoint{Vec3(0, 0, 5), Vec3(0, 0, 1), Vec3(0, 0, 1)}, 256, 1), 0.0);
}

std::vector<DVec3> corners(const DAffine& t) {
  std::vector<DVec3> c;
  for (const glm::dvec2& p : {glm::dvec2(-1, -1), glm::dvec2(1, -1), glm::dvec2(1, 1), glm::dvec2(-1, 1)})
    c.push_back(t[0] * p.x + t[1] * p.y + t[3]);
  return c;
}

TEST(RectangleLight, IrradianceAtAllScales) {
  std::mt19937 random(22);
  std::uniform_real_distribution<double> exponent(-6.0, 6.0), unit(-1.0, 1.0);
  for (int probe = 0; probe < 400; ++probe) {
    const double distance = std::pow(10.0, exponent(random));
    const double w = distance * std::pow(10.0, exponent(random) * 0.5),
                 h = distance * std::pow(10.0, exponent(random) * 0.5);
    const DVec3 centre = distance * DVec3(unit(random), unit(random), 1.0);
    const DAffine t = affine(DVec3(w, 0, 0), DVec3(0, -h, 0), DVec3(0, 0, -distance), centre);
    ShadingPoint r;
    const LightTable lights = make_lights(area_scene(ShapeKind::rectangle, t));
    ASSERT_EQ(lights.lights[0].kind, LightKind::rectangle);
    const double expected = polygon_irradiance(corners(t), DVec3(0), DVec3(0, 0, 1));
    EXPECT_NEAR(irradiance(lights, r, 4096, uint32_t(probe)), expected, 2e-3 * expected)
        << "distance " << distance << " half size " << w << " " << h;
  }
}

TEST(RectangleLight, GrazingBehindAndTouching) {
  const DAffine t = affine(DVec3(1, 0, 0), DVec3(0, -1, 0), DVec3(0, 0, -1), DVec3(0, 0, 0));
  const LightTable lights = make_lights(area_scene(ShapeKind::rectangle, t));
  for (double height : {1e-5, 1e-4, 1e-3, 0.1}) {
    ShadingPoint r{Vec3(0.2f, 0.1f, float(-height)), Vec3(0, 0, 1), Vec3(0, 0, 1)};
    const double facing = polygon_irradiance(corners(t), DVec3(r.point), DVec3(0, 0, 1));
    EXPECT_NEAR(irradiance(lights, r, 4096, 3), facing, 2e-3 * facing) << height;
  }
  EXPECT_EQ(irradiance(lights, ShadingPoint{Vec3(0, 0, 1)}, 64, 3), 0.0);
  EXPECT_EQ(irradiance(lights, ShadingPoint{Vec3(0, 0, 1), Vec3(0, 0, -1), Vec3(0, 0, -1)}, 64, 3), 0.0);
  EXPECT_EQ(irradiance(lights, ShadingPoint{Vec3(0, 0, 0)}, 64, 3), 0.0);
  EXPECT_EQ(irradiance(lights, ShadingPoint{Vec3(3, 0, 0)}, 64, 3), 0.0);
}

TEST(AreaLights, IrradianceAgainstPolygonsAndQuadrature) {
  const DAffine skewed = affine(DVec3(0.7, 0.1, 0), DVec3(0.3, 0.5, 0.1), DVec3(0.1, 0, 0.9), DVec3(0.2, 0.3, 3));
  const auto at = [&](double x, double y, double z) {
    return skewed[0] * x + skewed[1] * y + skewed[2] * z + skewed[3];
  };
  const ShadingPoint r{Vec3(0.5f, 0.2f, -0.1f), Vec3(0, 0, 1), glm::normalize(Vec3(0.1f, 0.2f, 1.0f))};
  const DVec3 p(r.point), n(r.shading);
  const auto expect = [&](const Scene& scene, double expected, const char* name) {
    EXPECT_NEAR(irradiance(make_lights(scene), r, 16384, 5), expected, 1e-3 * expected) << name;
  };
  expect(area_scene(ShapeKind::rectangle, skewed, true), polygon_irradiance(corners(skewed), p, n), "parallelogram");

  const auto disk = [&](double a, double b) { return at(a * std::cos(2 * M_PI * b), a * std::sin(2 * M_PI * b), 0.0); };
  expect(area_scene(ShapeKind::disk, skewed, true), quadrature_irradiance(disk, p, n, -1.0, 400), "disk");

  const auto sphere = [&](double a, double b) {
    const double z = 2 * a - 1, s = std::sqrt(std::max(1 - z * z, 0.0));
    return at(s * std::cos(2 * M_PI * b), s * std::sin(2 * M_PI * b), z);
  };
  expect(area_scene(ShapeKind::sphere, skewed), quadrature_irradiance(sphere, p, n, -1.0, 1000), "ellipsoid");

  const auto cylinder = [&](double a, double b) { return at(std::cos(2 * M_PI * a), std::sin(2 * M_PI * a), b); };
  expect(area_scene(ShapeKind::cylinder, skewed), quadrature_irradiance(cylinder, p, n, 1.0, 400), "cylinder");
  expect(area_scene(ShapeKind::cylinder, skewed, true), quadrature_irradiance(cylinder, p, n, -1.0, 400), "flipped");

  const Shape mesh = mesh_shape();
  double expected = 0.0;
  for (const UVec3& t : mesh.mesh.triangles) {
    std::vector<DVec3> v;
    for (int i = 0; i < 3; ++i) {
      const Vec3& q = mesh.mesh.positions[t[i]];
      v.push_back(at(q.x, q.y, q.z));
    }
    const DVec3 normal = -glm::cross(v[1] - v[0], v[2] - v[0]);
    if (glm::dot(normal, p - v[0]) > 0) expected += polygon_irradiance(v, p, n);
  }
  expect(area_scene(mesh, skewed, true), expected, "mesh");
}

TEST(AreaLights, MirroringKeepsTheNormalOfTheInverseTranspose) {
  // Mirrored in x, the plane keeps its normal (0, 0, 1); mirrored in z, the normal flips.
  const DAffine x = affine(DVec3(-1, 0, 0), DVec3(0, 1, 0), DVec3(0, 0, 1), DVec3(0, 0, 0));
  const DAffine z = affine(DVec3(1, 0, 0), DVec3(0, 1, 0), DVec3(0, 0, -1), DVec3(0, 0, 0));
  const ShadingPoint above{Vec3(0, 0, 2), Vec3(0, 0, -1), Vec3(0, 0, -1)}, below{Vec3(0, 0, -2)};
  Shape triangle = mesh_shape();
  triangle.mesh.triangles.resize(1);
  for (const Shape& shape : {Shape{ShapeKind::rectangle, "", {}, {}}, Shape{ShapeKind::disk, "", {}, {}}, triangle}) {
    EXPECT_GT(irradiance(make_lights(area_scene(shape, x)), above, 64, 1), 0.0);
    EXPECT_EQ(irradiance(make_lights(area_scene(shape, x)), below, 64, 1), 0.0);
    EXPECT_GT(irradiance(make_lights(area_scene(shape, z)), below, 64, 1), 0.0);
    EXPECT_EQ(irradiance(make_lights(area_scene(shape, z)), above, 64, 1), 0.0);
    EXPECT_GT(irradiance(make_lights(area_scene(shape, x, true)), below, 64, 1), 0.0);
  }
  EXPECT_GT(irradiance(make_lights(area_scene(ShapeKind::sphere, z)), above, 64, 1), 0.0);
}

TEST(DeltaLights, FallOff) {
  ShadingPoint r;
  const Vec3 position(0.5f, -0.25f, 3.0f);
  const double d2 = glm::dot(DVec3(position), DVec3(position));
  EXPECT_NEAR(irradiance(make_lights(emitter_scene(EmitterKind::point)), r, 4, 1), 3.0 / std::pow(d2, 1.5), 1e-6);
  const Vec3 direction = glm::normalize(Vec3(0.2f, 0.1f, -1.0f));
  EXPECT_NEAR(irradiance(make_lights(emitter_scene(EmitterKind::directional)), r, 4, 1), -direction.z, 1e-6);
}

TEST(ConstantLight, FurnaceForOpaqueAndTransmitting) {
  const LightTable lights = make_lights(emitter_scene(EmitterKind::constant));
  ShadingPoint r;
  EXPECT_NEAR(irradiance(lights, r, 1024, 1), M_PI, 1e-5);
  r.transmits = true;
  EXPECT_NEAR(irradiance(lights, r, 4096, 1), 2.0 * M_PI, 2e-3);
  ShadowBatch out;
  sample_light(lights, 0, batch_of({r}, 1), 16, Isa::automatic, out);
  for (int k = 0; k < 16; ++k) {
    EXPECT_EQ(out.rays.tmax[size_t(k)], k_infinity);
    EXPECT_NEAR(glm::length(out.rays.direction(size_t(k))), 1.0f, 0x1p-21f);
  }
}

TEST(LightTable, BlackAndDegenerateLightsAreNotSampled) {
  Scene black = area_scene(ShapeKind::disk, scaled(1.0, DVec3(0, 0, 2)), true);
  black.emitters[0].value = Rgb(0.0f);
  EXPECT_EQ(make_lights(black).lights[0].kind, LightKind::none);
  Shape line = mesh_shape();
  line.mesh.triangles = {{0, 1, 1}};
  const LightTable degenerate = make_lights(area_scene(line, scaled(1.0, DVec3(0, 0, 2))));
  EXPECT_EQ(irradiance(degenerate, ShadingPoint{}, 16, 1), 0.0);
  Scene orphan = emitter_scene(EmitterKind::area);
  EXPECT_THROW(make_lights(orphan), Error);
}

}  // namespace
}  // namespace fieldtrace
