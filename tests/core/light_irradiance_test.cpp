// Closed-form irradiance of whole lights against their samples.
#include "core/light/light_irradiance.h"

#include <gtest/gtest.h>

#include "tests/support/light_test_scenes.h"

namespace fieldtrace {
namespace {

using namespace light_test;

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
    const std::optional<float> whole = whole_irradiance(lights.lights[0], r.point, r.normal, r.shading);
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

TEST(WholeIrradiance, IsNotGivenWhereTheHorizonCutsTheLight) {
  const LightTable lights = make_lights(area_scene(ShapeKind::sphere, scaled(1.0, DVec3(0, 0, 3))));
  const auto at = [&](const Vec3& p, const Vec3& g, const Vec3& s) {
    return whole_irradiance(lights.lights[0], p, glm::normalize(g), glm::normalize(s)).has_value();
  };
  const Vec3 up(0, 0, 1), level(1, 0, 0.3f);
  EXPECT_TRUE(at(Vec3(0), up, up));
  EXPECT_FALSE(at(Vec3(0), level, up));
  EXPECT_FALSE(at(Vec3(0), up, level));
  EXPECT_FALSE(at(Vec3(0, 0, 3.5f), up, up));  // inside
  const LightTable disk = make_lights(area_scene(ShapeKind::disk, scaled(1.0, DVec3(0, 0, 3)), true));
  EXPECT_FALSE(whole_irradiance(disk.lights[0], Vec3(0), up, up).has_value());
}

}  // namespace
}  // namespace fieldtrace
