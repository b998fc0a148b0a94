// Closed-form irradiance of whole lights against their samples, and vector irradiance against contour integrals.
#include "core/light/light_irradiance.h"

#include <gtest/gtest.h>

#include <numbers>
#include <tuple>

#include "tests/support/light_test_scenes.h"

namespace fieldtrace {
namespace {

using namespace light_test;

// The irradiance at one shading point, if it has a closed form.
std::optional<float> irradiance_at(const Light& light, const ShadingPoint& r) {
  AlignedVector<float> irradiance;
  whole_irradiance(light, batch_of({r}, 5), resolve_isa(Isa::automatic), irradiance);
  return irradiance[0] < 0.0f ? std::nullopt : std::optional(irradiance[0]);
}

// A shading point at a distance of a few sizes or many, in any orientation, with a shading normal that differs from the
// geometric one.
ShadingPoint random_shading_point(std::mt19937& random, double size, const DVec3& centre) {
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  ShadingPoint r;
  const double distance = size * std::pow(10.0, 2.0 * uniform(random) + 0.1);
  r.point = Vec3(centre + distance * random_rotation(random)[0]);
  const DVec3 to_light = glm::normalize(centre - DVec3(r.point));
  r.normal = Vec3(glm::normalize(to_light + 1.2 * random_rotation(random)[0]));
  r.shading = Vec3(glm::normalize(DVec3(r.normal) + 0.2 * random_rotation(random)[0]));
  return r;
}

void compare_with_samples(ShapeKind kind, bool flip) {
  std::mt19937 random(31);
  int compared = 0, refused = 0;
  for (int i = 0; i < 300; ++i) {
    std::uniform_real_distribution<double> uniform(0.0, 1.0);
    const double size = std::pow(10.0, 6.0 * uniform(random) - 3.0);
    const DMat3 turn = random_rotation(random) * size;
    const DVec3 centre = 10.0 * size * random_rotation(random)[1];
    const double wide = kind == ShapeKind::rectangle ? 0.2 : 1.0;
    const LightTable lights = make_lights(area_scene(kind, affine(turn[0], turn[1] * wide, turn[2], centre), flip));
    ASSERT_TRUE(sampled_in_closed_form(lights.lights[0]));
    const ShadingPoint r = random_shading_point(random, size, centre);
    const std::optional<float> whole = irradiance_at(lights.lights[0], r);
    ShadowBatch batch;
    sample_light(lights, 0, batch_of({r}, 5), 256, Isa::automatic, batch);
    if (!whole) {
      ++refused;
      continue;
    }
    ++compared;
    ASSERT_EQ(batch.active, 256u) << i;  // no part of the light lies below a horizon
    const double sampled = irradiance(lights, r, 1 << 14, 77);
    // The samples' solid angle is accurate to 2^-11 (RectangleLight::k_min_solid_angle).
    ASSERT_NEAR(*whole / sampled, 1.0, kind == ShapeKind::rectangle ? 0x1p-11 + 1e-4 : 2e-4) << i;
  }
  EXPECT_GT(compared, 80);
  EXPECT_GT(refused, 5);
}

TEST(WholeIrradiance, OfSpheresIsTheMeanOfTheirSamples) { compare_with_samples(ShapeKind::sphere, false); }
TEST(WholeIrradiance, OfRectanglesIsTheMeanOfTheirSamples) {
  compare_with_samples(ShapeKind::rectangle, false);
  compare_with_samples(ShapeKind::rectangle, true);
}

// The sum over the rectangle's edges in long double.
double irradiance_of_edges(const Light& light, const ShadingPoint& r) {
  using Long3 = glm::vec<3, long double>;
  const auto vec = [](const float(&v)[3]) { return Long3(v[0], v[1], v[2]); };
  const Long3 centre = vec(light.centre) - Long3(r.point), x = vec(light.axis[0]), y = vec(light.axis[1]);
  const Long3 corner[] = {centre - x - y, centre + x - y, centre + x + y, centre - x + y};
  long double sum = 0;
  for (int i = 0; i < 4; ++i) {
    const Long3 &a = corner[i], &b = corner[(i + 1) % 4], normal = glm::cross(a, b);
    const long double angle = std::atan2(glm::length(normal), glm::dot(a, b));
    sum += angle * glm::dot(glm::normalize(normal), Long3(r.shading));
  }
  return double(std::fabs(sum) / 2);
}

// Seen from .03 to 3,000 sizes away; every instruction set gives the same bits.
TEST(WholeIrradiance, OfRectanglesIsExactToFloats) {
  std::mt19937 random(32);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  const LightTable lights = make_lights(
      area_scene(ShapeKind::rectangle, affine(DVec3(1, 0, 0), DVec3(0, 0.3, 0), DVec3(0, 0, 1), DVec3(0.0)), false));
  const Light& light = lights.lights[0];
  std::vector<ShadingPoint> points;
  for (int i = 0; i < 20011; ++i) {
    ShadingPoint r;
    r.point = Vec3(std::pow(10.0, 5.0 * uniform(random) - 1.5) * random_rotation(random)[0]);
    r.normal = Vec3(glm::normalize(0.9 * random_rotation(random)[0] - glm::normalize(DVec3(r.point))));
    r.shading = Vec3(glm::normalize(DVec3(r.normal) + 0.2 * random_rotation(random)[0]));
    points.push_back(r);
  }
  const ShadingPointBatch batch = batch_of(points, 5);
  AlignedVector<float> irradiance;
  whole_irradiance(light, batch, Isa::scalar, irradiance);
  int compared = 0;
  double worst = 0;
  for (size_t i = 0; i < points.size(); ++i) {
    if (irradiance[i] < 0.0f) continue;
    ++compared;
    worst = std::max(worst, std::abs(double(irradiance[i]) / irradiance_of_edges(light, points[i]) - 1.0));
  }
  EXPECT_GT(compared, 4000);
  EXPECT_LT(worst, 1e-7);
  for (const Isa isa : supported_isas()) {
    AlignedVector<float> other;
    whole_irradiance(light, batch, isa, other);
    for (size_t i = 0; i < points.size(); ++i) ASSERT_EQ(other[i], irradiance[i]) << isa_name(isa) << " " << i;
  }
}

TEST(WholeIrradiance, IsNotGivenWhereTheHorizonCutsTheLight) {
  const LightTable lights = make_lights(area_scene(ShapeKind::sphere, scaled(1.0, DVec3(0, 0, 3))));
  const auto at = [&](const Vec3& p, const Vec3& g, const Vec3& s) {
    return irradiance_at(lights.lights[0], {p, glm::normalize(g), glm::normalize(s)}).has_value();
  };
  const Vec3 up(0, 0, 1), level(1, 0, 0.3f);
  EXPECT_TRUE(at(Vec3(0), up, up));
  EXPECT_FALSE(at(Vec3(0), level, up));
  EXPECT_FALSE(at(Vec3(0), up, level));
  EXPECT_FALSE(at(Vec3(0, 0, 3.5f), up, up));  // inside
  const LightTable disk = make_lights(area_scene(ShapeKind::disk, scaled(1.0, DVec3(0, 0, 3)), true));
  EXPECT_FALSE(irradiance_at(disk.lights[0], {Vec3(0), up, up}).has_value());
}

using Long3 = glm::vec<3, long double>;
Long3 long3(const float (&v)[3]) { return Long3(v[0], v[1], v[2]); }

// A light with its vector irradiance in long double, seen from a random point in front.
struct Sight {
  Light light;
  Vec3 point;
  long double height_over_distance;  // of the plane and the farthest corner; spheres: 1
  Long3 vector;
};

Long3 contour_of_edges(const Long3& c, const Long3& x, const Long3& y) {
  const Long3 corner[] = {c - x - y, c + x - y, c + x + y, c - x + y};
  Long3 sum(0);
  for (int i = 0; i < 4; ++i) {
    const Long3 normal = glm::cross(corner[i], corner[(i + 1) % 4]);
    const long double sine = glm::length(normal);
    sum += normal * (std::atan2(sine, glm::dot(corner[i], corner[(i + 1) % 4])) / (2 * sine));
  }
  return sum;
}

// Half the contour integral of (r x dr) / r^2 (Stokes) by the trapezoidal rule, which converges exponentially.
Long3 contour_of_circle(const Long3& c, const Long3& x, const Long3& y, int nodes) {
  Long3 sum(0);
  for (int i = 0; i < nodes; ++i) {
    const long double angle = 2 * std::numbers::pi_v<long double> * i / nodes;
    const Long3 r = c + x * std::cos(angle) + y * std::sin(angle);
    sum += glm::cross(r, y * std::cos(angle) - x * std::sin(angle)) / glm::dot(r, r);
  }
  return sum * (std::numbers::pi_v<long double> / nodes);
}

// Of any size and orientation, mirrored or not, .01 to 170 degrees wide, seen from the zenith to 89.9 degrees off it.
Sight random_sight(std::mt19937& random, LightKind kind) {
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  const double size = std::pow(10.0, 6.0 * uniform(random) - 3.0), degree = 3.14159265358979 / 180.0;
  const double half_angle = 0.5 * degree * 0.01 * std::pow(17000.0, uniform(random));
  const bool even = kind == LightKind::sphere || kind == LightKind::disk;
  DMat3 turn = random_rotation(random);
  if (uniform(random) < 0.5) turn[2] = -turn[2];
  const DVec3 centre = 10.0 * size * random_rotation(random)[0];
  const DVec3 shear = kind == LightKind::parallelogram ? 0.7 * turn[0] : DVec3(0.0);
  const double narrow = even ? 1.0 : std::pow(0.01, uniform(random));
  const DAffine to_world = affine(size * turn[0], size * narrow * (turn[1] + shear), size * turn[2], centre);
  const ShapeKind shape = kind == LightKind::sphere ? ShapeKind::sphere
                          : kind == LightKind::disk ? ShapeKind::disk
                                                    : ShapeKind::rectangle;
  const bool flip = kind != LightKind::sphere && uniform(random) < 0.5;
  Sight s = {make_lights(area_scene(shape, to_world, flip)).lights[0], Vec3(0), 1, Long3(0)};
  EXPECT_EQ(s.light.kind, kind);
  const double cosine = std::pow(0.001, uniform(random)), sine = std::sqrt(1.0 - cosine * cosine);
  const double azimuth = 360.0 * degree * uniform(random);
  const DVec3 along = sine * (std::cos(azimuth) * turn[0] + std::sin(azimuth) * turn[1]);
  const DVec3 normal(s.light.normal[0], s.light.normal[1], s.light.normal[2]);
  const double distance = kind == LightKind::sphere ? size / std::sin(half_angle) : size / std::tan(half_angle);
  s.point = Vec3(centre + distance * (along + cosine * normal));

  const Long3 c = long3(s.light.centre) - Long3(s.point), x = long3(s.light.axis[0]), y = long3(s.light.axis[1]);
  if (kind == LightKind::sphere) {
    const long double squared = glm::dot(c, c), radius = s.light.radius;
    s.vector = c * (std::numbers::pi_v<long double> * radius * radius / (squared * std::sqrt(squared)));
    return s;
  }
  const long double height = -glm::dot(c, long3(s.light.normal));
  const long double farthest = std::max(std::max(glm::length(c + x + y), glm::length(c + x - y)),
                                        std::max(glm::length(c - x + y), glm::length(c - x - y)));
  s.height_over_distance = height / farthest;
  if (s.height_over_distance < 1e-3L) return s;
  if (kind == LightKind::disk) {  // the circle of the same area
    const Long3 n = glm::cross(x, y), u = glm::normalize(x) * std::sqrt(glm::length(n));
    s.vector = contour_of_circle(c, u, glm::cross(glm::normalize(n), u), 64 + int(64 * glm::length(x) / height));
  } else {
    s.vector = contour_of_edges(c, x, y);
  }
  if (glm::dot(s.vector, c) < 0) s.vector = -s.vector;
  return s;
}

void compare_with_contours(LightKind kind, uint32_t seed) {
  std::mt19937 random(seed);
  int compared = 0;
  double worst = 0;
  for (int i = 0; i < 4000; ++i) {
    const Sight s = random_sight(random, kind);
    if (s.height_over_distance < 1e-3L) continue;
    ++compared;
    const ShadingPointBatch batch = batch_of({{.point = s.point}}, 5);
    IrradianceVectors out;
    irradiance_vectors(s.light, batch, resolve_isa(Isa::automatic), out);
    ASSERT_EQ(out.known[0], 1) << i;
    const Long3 vector(out.x[0], out.y[0], out.z[0]);
    worst = std::max(worst, double(glm::length(vector - s.vector) / glm::length(s.vector)));
  }
  EXPECT_GT(compared, 3000);
  EXPECT_LT(worst, 1e-7);
}

TEST(IrradianceVectors, OfSpheresAreTheirConesIntegral) { compare_with_contours(LightKind::sphere, 41); }
TEST(IrradianceVectors, OfRectanglesAreTheirContoursIntegral) { compare_with_contours(LightKind::rectangle, 42); }
TEST(IrradianceVectors, OfParallelogramsAreTheirContoursIntegral) {
  compare_with_contours(LightKind::parallelogram, 43);
}
TEST(IrradianceVectors, OfDisksAreTheirContoursIntegral) { compare_with_contours(LightKind::disk, 44); }

// Where an edge fills nearly half a circle.
TEST(IrradianceVectors, KeepTheirDigitsOverAnEdge) {
  const Light light =
      make_lights(area_scene(ShapeKind::rectangle, affine(DVec3(1, 0, 0), DVec3(0, 1, 0), DVec3(0, 0, 1), DVec3(0))))
          .lights[0];
  for (float height = 1e-2f; height > 1e-12f; height *= 0.7f) {
    const Vec3 point(1.0f, 0.1f, height);
    IrradianceVectors out;
    irradiance_vectors(light, batch_of({{.point = point}}, 5), resolve_isa(Isa::automatic), out);
    const Long3 expected = -contour_of_edges(-Long3(point), long3(light.axis[0]), long3(light.axis[1]));
    ASSERT_LT(double(glm::length(Long3(out.x[0], out.y[0], out.z[0]) - expected) / glm::length(expected)), 1e-7)
        << height;
  }
}

// From points all around, on the light, within it and on its plane, 1e-6 to 100 sizes away.
TEST(IrradianceVectors, EveryInstructionSetGivesTheSameBits) {
  std::mt19937 random(45);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  for (const LightKind kind : {LightKind::sphere, LightKind::rectangle, LightKind::parallelogram, LightKind::disk}) {
    for (int i = 0; i < 20; ++i) {
      const Light light = random_sight(random, kind).light;
      const DVec3 centre(light.centre[0], light.centre[1], light.centre[2]), axis(Vec3(long3(light.axis[0])));
      std::vector<ShadingPoint> points = {{.point = Vec3(centre)}, {.point = Vec3(centre + axis)}};
      for (int k = 0; k < 101; ++k) {
        const double distance = glm::length(axis) * std::pow(10.0, 8.0 * uniform(random) - 6.0);
        points.push_back(
            {.point = Vec3(centre + axis * std::floor(2.0 * uniform(random)) + distance * random_rotation(random)[0])});
      }
      const ShadingPointBatch batch = batch_of(points, 5);
      IrradianceVectors a, b;
      irradiance_vectors(light, batch, Isa::scalar, a);
      for (const Isa isa : supported_isas()) {
        irradiance_vectors(light, batch, isa, b);
        for (size_t k = 0; k < points.size(); ++k) {
          ASSERT_TRUE(std::isfinite(a.x[k]) && std::isfinite(a.y[k]) && std::isfinite(a.z[k])) << k;
          ASSERT_TRUE(a.known[k] == b.known[k] && a.x[k] == b.x[k] && a.y[k] == b.y[k] && a.z[k] == b.z[k])
              << isa_name(isa) << " " << k;
        }
      }
    }
  }
}

TEST(IrradianceVectors, AreKnownOffThePlaneAndOutsideSpheres) {
  const auto at = [](const LightTable& lights, const Vec3& p) {
    IrradianceVectors out;
    irradiance_vectors(lights.lights[0], batch_of({{.point = p}}, 5), resolve_isa(Isa::automatic), out);
    return std::tuple(int(out.known[0]), out.x[0] == 0.0f && out.y[0] == 0.0f && out.z[0] == 0.0f);
  };
  const std::tuple lit(1, false), dark(1, true), unknown(0, true);
  for (const ShapeKind kind : {ShapeKind::rectangle, ShapeKind::disk}) {
    for (const double mirror : {1.0, -1.0}) {
      for (const bool flip : {false, true}) {
        const double side = flip ? -mirror : mirror;
        const DAffine place = affine(DVec3(2, 0, 0), DVec3(0, 2, 0), DVec3(0, 0, mirror), DVec3(0, 0, 3));
        const LightTable lights = make_lights(area_scene(kind, place, flip));
        const float next = std::nextafter(3.0f, float(3.0 + side));
        EXPECT_EQ(at(lights, Vec3(0.1f, 0.2f, float(3.0 + side))), lit);
        EXPECT_EQ(at(lights, Vec3(0.1f, 0.2f, float(3.0 - side))), dark);
        EXPECT_EQ(at(lights, Vec3(0.1f, 0.2f, next)), lit);
        EXPECT_EQ(at(lights, Vec3(0.1f, 0.2f, 6.0f - next)), dark);
        EXPECT_EQ(at(lights, Vec3(0.1f, 0.2f, 3.0f)), unknown);
        EXPECT_EQ(at(lights, Vec3(5.0f, 0.2f, 3.0f)), unknown);
      }
    }
  }
  std::mt19937 random(46);
  for (int i = 0; i < 100; ++i) {  // corners and edges whose distance from the plane is rounding alone
    const DMat3 turn = random_rotation(random);
    const LightTable lights =
        make_lights(area_scene(ShapeKind::rectangle, affine(turn[0], turn[1], turn[2], DVec3(0))));
    const Vec3 edge(long3(lights.lights[0].axis[0]));
    EXPECT_EQ(at(lights, edge), unknown);
    EXPECT_EQ(at(lights, -2.0f * edge), unknown);
  }
  EXPECT_EQ(at(make_lights(area_scene(ShapeKind::sphere, scaled(2.0, DVec3(0)))), Vec3(0, 0, 3)), lit);
  EXPECT_EQ(at(make_lights(area_scene(ShapeKind::sphere, scaled(2.0, DVec3(0)))), Vec3(0, 0, 1)), unknown);
  EXPECT_EQ(at(make_lights(area_scene(ShapeKind::sphere, scaled(2.0, DVec3(0)), true)), Vec3(0)), unknown);
  const DAffine flat = affine(DVec3(2, 0, 0), DVec3(0, 1, 0), DVec3(0, 0, 1), DVec3(0, 0, -3));
  for (const ShapeKind kind : {ShapeKind::disk, ShapeKind::sphere, ShapeKind::cylinder}) {
    EXPECT_EQ(at(make_lights(area_scene(kind, flat)), Vec3(0)), unknown);
  }
  EXPECT_EQ(at(make_lights(emitter_scene(EmitterKind::constant)), Vec3(0)), unknown);
}

}  // namespace
}  // namespace fieldtrace
