// Closed-form irradiance of whole lights against their samples.
#include "core/light/light_irradiance.h"

#include <gtest/gtest.h>

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

}  // namespace
}  // namespace fieldtrace
