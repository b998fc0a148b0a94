// light_pdf against the samples of sample_light (chi-square, integral, pointwise), and rays that must not hit their
// light.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <string>

#include "tests/support/light_test_scenes.h"

namespace fieldtrace {
namespace {

using namespace light_test;

// A light's surface as a function of (a, b) in [0, 1]^2, in object space; `side` is the sign that turns d/da x d/db
// into the emitting normal.
struct Parametrised {
  std::string name;
  ShapeKind kind;
  DAffine to_world;
  bool flip;
  double side;

  DVec3 object_point(double a, double b) const {
    const double c = std::cos(2 * M_PI * b), s = std::sin(2 * M_PI * b);
    switch (kind) {
      case ShapeKind::sphere: {
        const double z = 2 * a - 1, r = std::sqrt(std::max(1 - z * z, 0.0));
        return {r * c, r * s, z};
      }
      case ShapeKind::disk:
        return {std::sqrt(a) * c, std::sqrt(a) * s, 0};
      case ShapeKind::cylinder:
        return {c, s, a};
      default:
        return {2 * a - 1, 2 * b - 1, 0};
    }
  }
  DVec3 point(double a, double b) const { return transform_point(to_world, object_point(a, b)); }
  glm::dvec2 parameters(const DVec3& world) const {
    const DVec3 p = transform_point(inverse_affine(to_world), world);
    const double turn = std::atan2(p.y, p.x) / (2 * M_PI), b = turn < 0 ? turn + 1 : turn;
    switch (kind) {
      case ShapeKind::sphere:
        return {0.5 * (p.z / glm::length(p) + 1), b};
      case ShapeKind::disk:
        return {p.x * p.x + p.y * p.y, b};
      case ShapeKind::cylinder:
        return {p.z, b};
      default:
        return {0.5 * (p.x + 1), 0.5 * (p.y + 1)};
    }
  }
  // Emitting normal scaled by the area element of d/da, d/db.
  DVec3 area_normal(double a, double b) const {
    constexpr double k_step = 1e-6;
    a = glm::clamp(a, 2 * k_step, 1 - 2 * k_step);  // the parametrisations end there
    const DVec3 da = (point(a + k_step, b) - point(a - k_step, b)) / (2 * k_step);
    const DVec3 db = (point(a, b + k_step) - point(a, b - k_step)) / (2 * k_step);
    return side * glm::cross(da, db);
  }
};

std::vector<Parametrised> parametrised_lights() {
  const DAffine lamp = affine(DVec3(1.1, 0, 0.2), DVec3(0, -0.6, 0), DVec3(0.05, 0, -0.275), DVec3(0.2, 0.3, 1));
  const DAffine skewed = affine(DVec3(0.7, 0.1, 0), DVec3(0.3, 0.5, 0), DVec3(0.1, 0, 0.9), DVec3(0.2, 0.3, 1.5));
  const DAffine beside = affine(DVec3(0.7, 0.1, 0), DVec3(0.3, 0.5, 0), DVec3(0.1, 0, 0.9), DVec3(2, 1, 0.1));
  const DAffine far = affine(DVec3(1.1, 0, 0), DVec3(0, -0.6, 0), DVec3(0, 0, -1), DVec3(2, 3, 100));
  return {{"sphere", ShapeKind::sphere, scaled(0.7, DVec3(0.2, 0.3, 1)), false, -1},
          {"far sphere", ShapeKind::sphere, scaled(0.7, DVec3(20, 30, 100)), false, -1},
          {"inside of a sphere", ShapeKind::sphere, scaled(3, DVec3(0.2, 0.3, 1)), true, 1},
          {"rectangle", ShapeKind::rectangle, lamp, false, 1},
          {"far rectangle", ShapeKind::rectangle, far, false, 1},
          {"parallelogram", ShapeKind::rectangle, skewed, true, -1},
          {"disk", ShapeKind::disk, skewed, true, -1},
          {"ellipsoid", ShapeKind::sphere, skewed, false, -1},
          {"cylinder", ShapeKind::cylinder, beside, false, -1},
          {"flipped cylinder", ShapeKind::cylinder, skewed, true, 1}};
}

TEST(LightDensity, DescribesTheSamples) {
  constexpr int k_side = 12, k_fine = 24, k_count = 40000;
  for (const Parametrised& light : parametrised_lights()) {
    const LightTable lights = make_lights(area_scene(light.kind, light.to_world, light.flip));
    ShadingPoint shading_point;
    shading_point.transmits = true;  // no horizon: every direction of the density counts

    // Expected probability of each bin: integral of the density over the solid angle of the bin's visible part.
    std::vector<double> expected(k_side * k_side, 0.0);
    constexpr int k_n = k_side * k_fine;
    for (int i = 0; i < k_n; ++i) {
      for (int j = 0; j < k_n; ++j) {
        const double a = (i + 0.5) / k_n, b = (j + 0.5) / k_n;
        const DVec3 d = light.point(a, b), n = light.area_normal(a, b);
        const double facing = -glm::dot(n, d), r = glm::length(d);
        if (facing <= 0) continue;
        LightHit hit;
        hit.t = 1;
        hit.normal = Vec3(glm::normalize(n));
        const float pdf = light_pdf(lights, 0, shading_point.point, shading_point.shading, true, Vec3(d), hit);
        expected[size_t(i / k_fine * k_side + j / k_fine)] += double(pdf) * facing / (r * r * r) / (k_n * k_n);
      }
    }
    double total = 0.0;
    for (double e : expected) total += e;

    ShadowBatch out;
    sample_light(lights, 0, batch_of(std::vector<ShadingPoint>(k_count, shading_point), 31), 1, Isa::automatic, out);
    std::vector<double> observed(expected.size(), 0.0);
    double kept = 0.0;
    for (size_t i = 0; i < k_count; ++i) {
      if (out.rays.tmax[i] < 0) continue;  // samples of the far side (shapes sampled by area), where the density is 0
      const DVec3 d(out.rays.direction(i)), y = DVec3(out.rays.origin(i)) + d;
      const glm::dvec2 ab = glm::clamp(light.parameters(y), 0.0, 1.0 - 1e-9);
      observed[size_t(ab.x * k_side) * k_side + size_t(ab.y * k_side)] += 1.0;
      kept += 1.0;

      // Pointwise: density and weight of each ray.
      LightHit hit;
      hit.t = 1;
      hit.normal = Vec3(glm::normalize(light.area_normal(ab.x, ab.y)));
      const float pdf = light_pdf(lights, 0, out.rays.origin(i), shading_point.shading, true, Vec3(d), hit);
      const double cosine = std::fabs(glm::dot(d, DVec3(shading_point.shading))) / glm::length(d);
      ASSERT_NEAR(double(out.weight[i]) * double(out.pdf[i]), cosine, 1e-4) << light.name;
      const double facing = -glm::dot(DVec3(hit.normal), d) / glm::length(d);
      ASSERT_TRUE(facing < 0.05 || std::fabs(pdf - out.pdf[i]) < 2e-3f * out.pdf[i])
          << light.name << pdf << " " << out.pdf[i];
    }
    // Shapes sampled by area also draw hidden points, which are dropped. At most three standard deviations of the share
    // kept, plus the midpoint rule's error at the rim of the visible part.
    EXPECT_NEAR(total, kept / k_count, 1.5 / std::sqrt(double(k_count)) + 3e-3) << light.name;
    EXPECT_GT(kept, 0.1 * k_count) << light.name;
    double statistic = 0.0;
    int bins = 0;
    for (size_t i = 0; i < expected.size(); ++i) {
      const double e = expected[i] * k_count;
      if (e < 5) continue;
      statistic += (observed[i] - e) * (observed[i] - e) / e;
      ++bins;
    }
    // Normal approximation of chi-square at 6 standard deviations, plus a quadrature error of 1 % per bin.
    EXPECT_LT(statistic, bins + 6 * std::sqrt(2.0 * bins) + 1e-4 * k_count) << light.name << ", kept " << kept;
  }
}

TEST(LightDensity, ConstantLight) {
  const LightTable lights = make_lights(emitter_scene(EmitterKind::constant));
  for (bool transmits : {false, true}) {
    ShadingPoint r;
    r.shading = glm::normalize(Vec3(0.3f, 0.1f, 1.0f));
    r.transmits = transmits;
    ShadowBatch out;
    sample_light(lights, 0, batch_of({r}, 3), 256, Isa::automatic, out);
    EXPECT_GT(out.active, 200u);
    for (size_t i = 0; i < 256; ++i) {
      if (out.rays.tmax[i] < 0) continue;
      const float pdf = light_pdf(lights, 0, r.point, r.shading, transmits, 3.0f * out.rays.direction(i), {});
      EXPECT_NEAR(pdf, out.pdf[i], 1e-6f);
    }
    const float below = light_pdf(lights, 0, r.point, r.shading, transmits, -r.shading, {});
    EXPECT_FLOAT_EQ(below, transmits ? float(0.25 / M_PI) : 0.0f);
  }
}

TEST(LightDensity, MeshTrianglesShareByArea) {
  const LightTable lights = make_lights(area_scene(mesh_shape(), scaled(1, DVec3(0, 0, 3)), true));
  ShadingPoint r;
  int facing = 0;
  for (uint32_t i = 0; i < lights.lights[0].triangle_count; ++i) {
    const LightTriangle& t = lights.triangles[i];
    const Vec3 p0(t.p0[0], t.p0[1], t.p0[2]), e1(t.edge1[0], t.edge1[1], t.edge1[2]);
    const Vec3 e2(t.edge2[0], t.edge2[1], t.edge2[2]), normal(t.normal[0], t.normal[1], t.normal[2]);
    const Vec3 d = p0 + (e1 + e2) / 3.0f;
    LightHit hit;
    hit.t = 1;
    hit.normal = normal;
    hit.primitive = i;
    const float pdf = light_pdf(lights, 0, r.point, r.shading, false, d, hit);
    const double cosine = -glm::dot(DVec3(normal), DVec3(d)) / glm::length(DVec3(d));
    if (glm::length(glm::cross(e1, e2)) == 0.0f || cosine <= 0) {
      EXPECT_EQ(pdf, 0.0f);
    } else {
      const double expected = glm::dot(DVec3(d), DVec3(d)) / cosine / double(lights.lights[0].area);
      EXPECT_NEAR(pdf, expected, 1e-3 * expected) << i;
      ++facing;
    }
  }
  EXPECT_GT(facing, 1);
}

TEST(LightDensity, DeltaLightsHaveNone) {
  for (EmitterKind kind : {EmitterKind::point, EmitterKind::directional}) {
    const LightTable lights = make_lights(emitter_scene(kind));
    EXPECT_EQ(light_pdf(lights, 0, Vec3(0), Vec3(0, 0, 1), true, Vec3(0, 0, 1), {}), 0.0f);
    EXPECT_TRUE(sampled_in_closed_form(lights.lights[0]));
  }
  EXPECT_FALSE(sampled_in_closed_form(make_lights(emitter_scene(EmitterKind::constant)).lights[0]));
}

// ---------------------------------------------------------------- rays that end before the light

struct ExtremeCase {
  double size, distance;
  DVec3 position;
};

std::vector<ExtremeCase> extreme_cases() {
  std::mt19937 random(41);
  std::uniform_real_distribution<double> exponent(-6.0, 6.0), unit(-1.0, 1.0);
  std::vector<ExtremeCase> cases(200);
  for (ExtremeCase& c : cases) {
    c.size = std::pow(10.0, exponent(random)), c.distance = std::pow(10.0, exponent(random));
    // Half of them are far from the origin, so that the coordinates' rounding dominates.
    const double far = random() % 2 ? std::pow(10.0, exponent(random)) : 0.0;
    c.position = far * DVec3(unit(random), unit(random), unit(random));
  }
  return cases;
}

TEST(SphereLight, RaysStayOffTheSphere) {
  std::mt19937 random(42);
  size_t active = 0;
  for (const ExtremeCase& c : extreme_cases()) {
    // `distance` is measured from the light's surface, so small values almost touch.
    const DVec3 direction = random_rotation(random)[0];
    const LightTable lights = make_lights(area_scene(ShapeKind::sphere, scaled(c.size, c.position)));
    const DVec3 centre(Vec3(c.position));
    const double radius = double(float(c.size));
    for (bool transmits : {false, true}) {
      ShadingPoint r;
      r.point = Vec3(c.position - direction * (c.size + c.distance));
      r.normal = r.shading = Vec3(direction);
      r.error = 1e-6f * (std::fabs(r.point.x) + std::fabs(r.point.y) + std::fabs(r.point.z));
      r.transmits = transmits;
      ShadowBatch out;
      sample_light(lights, 0, batch_of({r}, 43), 256, Isa::automatic, out);
      for (size_t i = 0; i < 256; ++i) {
        if (out.rays.tmax[i] < 0) continue;
        ++active;
        ASSERT_LE(out.rays.tmax[i], 1.0f);
        const DVec3 o = DVec3(out.rays.origin(i)) - centre, d(out.rays.direction(i));
        const double t = std::clamp(-glm::dot(o, d) / glm::dot(d, d), 0.0, double(out.rays.tmax[i]));
        // Half of the displacement is reserved for the tracer's rounding.
        const double margin = 0.5 * double(lights.lights[0].error_base);
        ASSERT_GT(glm::length(o + t * d), radius + margin) << "radius " << c.size << " distance " << c.distance;
      }
    }
  }
  EXPECT_GT(active, size_t(200 * 256 / 4));
}

TEST(PlaneLights, RaysStayOffThePlane) {
  std::mt19937 random(44);
  size_t active = 0;
  for (const ExtremeCase& c : extreme_cases()) {
    for (ShapeKind kind : {ShapeKind::rectangle, ShapeKind::disk}) {
      const DMat3 m = random_rotation(random);
      const DAffine to_world = affine(m[0] * c.size, m[1] * c.size, m[2] * c.size, c.position);
      const Scene scene = area_scene(kind, to_world);
      const LightTable lights = make_lights(scene);
      const Affine& placed = scene.instances[0].to_world;  // as rounded, which is what a tracer sees
      const DVec3 normal = glm::normalize(glm::cross(DVec3(placed[0]), DVec3(placed[1])));
      ShadingPoint r;
      r.point = Vec3(c.position + (m[2] + 0.3 * m[0]) * c.distance);
      r.normal = r.shading = Vec3(-m[2]);
      r.error = 1e-6f * (std::fabs(r.point.x) + std::fabs(r.point.y) + std::fabs(r.point.z));
      ShadowBatch out;
      sample_light(lights, 0, batch_of({r}, 45), 64, Isa::automatic, out);
      for (size_t i = 0; i < 64; ++i) {
        if (out.rays.tmax[i] < 0) continue;
        ++active;
        const DVec3 o(out.rays.origin(i)), d(out.rays.direction(i));
        const double margin = 0.5 * double(lights.lights[0].error_base);
        ASSERT_GT(glm::dot(o - DVec3(placed[3]), normal), margin);
        ASSERT_GT(glm::dot(o + double(out.rays.tmax[i]) * d - DVec3(placed[3]), normal), margin)
            << "size " << c.size << " distance " << c.distance;
      }
    }
  }
  EXPECT_GT(active, size_t(200 * 2 * 64 / 4));
}

}  // namespace
}  // namespace fieldtrace
