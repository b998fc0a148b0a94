// Environment maps in scene files: what is read, and the messages for unusable maps.

#include <cmath>

#include "core/image/image.h"
#include "core/light/light_sampling.h"
#include "tests/support/scene_test_files.h"

namespace fieldtrace {
namespace {

class SceneEnvironment : public SceneFiles {
 protected:
  // Writes a map with texels `values` (three channels, or as many as `channels` names) in sequence.
  void write_map(const std::string& name, int width, int height, const std::vector<float>& values,
                 std::vector<std::string> channels = {"R", "G", "B"}) {
    Image image;
    image.width = width;
    image.height = height;
    image.channels = std::move(channels);
    for (size_t i = 0; i < size_t(width) * size_t(height) * image.channel_count(); ++i)
      image.data.push_back(values[i % values.size()]);
    ImageWriteOptions options;
    options.half = false;
    write_image(path(name), image, options);
  }

  static std::string envmap(const std::string& inside = "") {
    return "<emitter type='envmap'><string name='filename' value='map.exr'/>" + inside + "</emitter>";
  }
};

TEST_F(SceneEnvironment, IsReadWithItsScaleAndPlace) {
  write_map("map.exr", 4, 3, {0.5f, 1.0f, 2.0f});
  const Scene s = load(k_sensor + envmap("<float name='scale' value='3'/><boolean name='mis_compensation' "
                                         "value='true'/><transform name='to_world'><rotate x='1' angle='90'/>"
                                         "<translate value='7'/></transform>"));
  ASSERT_EQ(s.emitters.size(), 1u);
  const Emitter& e = s.emitters[0];
  EXPECT_EQ(e.kind, EmitterKind::environment);
  EXPECT_EQ(e.value, Rgb(3.0f));
  ASSERT_LT(e.bitmap, s.bitmaps.size());
  EXPECT_EQ(s.bitmaps[e.bitmap].width, 4);
  // Up, +y, becomes +z.
  EXPECT_NEAR(glm::length(e.rotation * Vec3(0, 1, 0) - Vec3(0, 0, 1)), 0.0f, 1e-6f);
  const LightTable lights = make_lights(s);
  const Rgb radiance = emitted_radiance(lights, 0, Vec3(1, 2, 3));
  EXPECT_NEAR(radiance.x, 1.5f, 1e-6f);
  EXPECT_NEAR(radiance.y, 3.0f, 1e-6f);
  EXPECT_NEAR(radiance.z, 6.0f, 1e-6f);
  EXPECT_EQ(warnings.size(), 1u) << "only that there are no shapes";
}

TEST_F(SceneEnvironment, RoundedRotationsBecomeOrthonormalAndMirrorsStay) {
  write_map("map.exr", 4, 3, {1.0f});
  const Scene s = load(k_sensor + envmap("<transform name='to_world'><matrix value='0.7071 0.7071 0 -0.7071 0.7071 0 0 "
                                         "0 -1'/></transform>"));
  const Mat3& r = s.emitters[0].rotation;
  EXPECT_NEAR(glm::determinant(r), -1.0f, 1e-6f);
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) EXPECT_NEAR(glm::dot(r[i], r[j]), i == j ? 1.0f : 0.0f, 1e-6f);
  }
}

TEST_F(SceneEnvironment, UniformScaleOfThePlaceIsLeftOutWithAWarning) {
  write_map("map.exr", 4, 3, {1.0f});
  const Scene s = load(k_sensor + envmap("\n<transform name='to_world'><scale value='2'/></transform>"));
  EXPECT_NEAR(glm::length(s.emitters[0].rotation[0]), 1.0f, 1e-6f);
  EXPECT_TRUE(warned("scene.xml:3: the scale of the environment map's to_world"));
  EXPECT_NE(error_of(envmap("\n<transform name='to_world'><scale x='2'/></transform>"))
                .find("scene.xml:3: the environment map's to_world scales its axes unequally"),
            std::string::npos);
}

TEST_F(SceneEnvironment, GreyMapsServeForAllColours) {
  write_map("map.exr", 4, 3, {0.25f}, {"Y"});
  const LightTable lights = make_lights(load(k_sensor + envmap()));
  const Rgb radiance = emitted_radiance(lights, 0, Vec3(1, 2, 3));
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(radiance[c], 0.25f, 1e-6f);
}

TEST_F(SceneEnvironment, AlphaMakesNoDifference) {
  write_map("map.exr", 4, 3, {0.5f, 0.5f, 0.5f, 0.0f}, {"R", "G", "B", "A"});
  const LightTable lights = make_lights(load(k_sensor + envmap()));
  EXPECT_NEAR(emitted_radiance(lights, 0, Vec3(1, 2, 3)).y, 0.5f, 1e-6f);
}

TEST_F(SceneEnvironment, MapsThatAreTooSmallAreRefused) {
  for (const auto& [width, height] : {std::pair(1, 8), {8, 1}, {8, 2}, {1, 1}}) {
    write_map("map.exr", width, height, {1.0f});
    const std::string message = error_of("\n" + envmap());
    EXPECT_EQ(message.find(path("scene.xml:3: ")), 0u) << message;
    EXPECT_NE(message.find("it needs at least 2 x 3, and at most 536870912 pixels in all"), std::string::npos)
        << message;
  }
  write_map("map.exr", 2, 3, {1.0f});
  EXPECT_EQ(error_of(envmap()), "");
}

TEST_F(SceneEnvironment, PixelsThatAreNotNumbersAreRefused) {
  for (const float bad : {std::nanf(""), INFINITY}) {
    write_map("map.exr", 4, 3, {1.0f, 1.0f, 1.0f, 1.0f, bad});
    const std::string message = error_of("\n" + envmap());
    EXPECT_EQ(message.find(path("scene.xml:3: ")), 0u) << message;
    EXPECT_NE(message.find("a pixel that is not finite"), std::string::npos) << message;
  }
}

TEST_F(SceneEnvironment, FilesThatAreNoImagesAreRefused) {
  write("map.exr", "no picture");
  const std::string message = error_of("\n" + envmap());
  EXPECT_EQ(message.find(path("scene.xml:3: ")), 0u) << message;
}

TEST_F(SceneEnvironment, NegativePixelsCountAsZeroWithAWarning) {
  write_map("map.exr", 4, 3, {1.0f, 1.0f, 1.0f, 1.0f, -2.0f, 1.0f});
  const LightTable lights = make_lights(load(k_sensor + envmap()));
  EXPECT_TRUE(warned("scene.xml:2: "));
  EXPECT_TRUE(warned("has 6 pixels with negative values, which count as 0"));
  for (const float texel : lights.environment.texels) EXPECT_GE(texel, 0.0f);
}

TEST_F(SceneEnvironment, BlackMapsWarnAndGiveNoLight) {
  write_map("map.exr", 4, 3, {0.0f});
  const LightTable lights = make_lights(load(k_sensor + envmap()));
  EXPECT_TRUE(warned("is black"));
  EXPECT_EQ(lights.lights[0].kind, LightKind::none);
}

TEST_F(SceneEnvironment, RadianceBeyondSinglePrecisionIsRefused) {
  write_map("map.exr", 4, 3, {1e20f});
  const std::string message = error_of("\n" + envmap("<float name='scale' value='1e19'/>"));
  EXPECT_EQ(message.find(path("scene.xml:3: ")), 0u) << message;
  EXPECT_NE(message.find("beyond single precision"), std::string::npos) << message;
  const LightTable lights = make_lights(load(envmap("<float name='scale' value='1e18'/>")));
  EXPECT_NEAR(emitted_radiance(lights, 0, Vec3(0, 0, 1)).x, 1e38f, 1e33f);
}

TEST_F(SceneEnvironment, OnlyOneLightMaySurroundTheScene) {
  write_map("map.exr", 4, 3, {1.0f});
  const std::string constant = "<emitter type='constant'/>";
  for (const std::string& body : {envmap() + "\n" + envmap(), envmap() + "\n" + constant, constant + "\n" + envmap()}) {
    const std::string message = error_of(body);
    EXPECT_EQ(message.find(path("scene.xml:3: ")), 0u) << message;
    EXPECT_NE(message.find("two surrounding emitters"), std::string::npos) << message;
  }
}

}  // namespace
}  // namespace fieldtrace
