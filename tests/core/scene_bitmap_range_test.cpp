// Bitmaps as reflectance: values outside [0, 1], values that are not finite, and values of 8 and 16 bits.

#include <OpenImageIO/imageio.h>

#include <cmath>

#include "core/image/image.h"
#include "tests/support/scene_test_files.h"

namespace fieldtrace {
namespace {

class SceneBitmapRange : public SceneFiles {
 protected:
  void write_map(const std::string& name, const Rgb& odd) const {
    Image image{4, 3, {"R", "G", "B"}, std::vector<float>(36, 0.25f)};
    for (int c = 0; c < 3; ++c) image.pixel(2, 1)[c] = odd[c];
    ImageWriteOptions options;
    options.half = false;
    write_image(path(name), image, options);
  }
};

const std::string k_textured =
    "<shape type='cube'><bsdf type='diffuse'><texture type='bitmap' name='reflectance'>\n"
    "<string name='filename' value='map.exr'/></texture></bsdf></shape>";
const std::string k_sky = "<emitter type='envmap'><string name='filename' value='map.exr'/></emitter>";

// Grey with alpha: alpha is not the picture, in whatever order the file has them.
TEST_F(SceneBitmapRange, AlphaIsNoColour) {
  for (const std::vector<std::string>& channels :
       {std::vector<std::string>{"Y", "A"}, {"A", "Y"}, {"Y"}, {"A", "R", "G", "B"}, {"R", "G", "B", "A"}}) {
    Image image{4, 3, channels, std::vector<float>(12 * channels.size())};
    for (size_t i = 0; i < image.data.size(); ++i) image.data[i] = channels[i % channels.size()] == "A" ? 1.0f : 0.25f;
    write_image(path("map.exr"), image, {});
    const Scene scene = load(k_textured);
    ASSERT_EQ(scene.bitmaps.size(), 1u);
    for (const Rgb& pixel : scene.bitmaps[0].pixels) EXPECT_EQ(pixel, Rgb(0.25f)) << channels[0];
  }
}

// Three channels of other names are no colours, whatever they hold.
TEST_F(SceneBitmapRange, OtherChannelsAreErrors) {
  Image image{2, 1, {"X", "Y", "Z"}, {0.1f, 0.2f, 0.3f, 0.1f, 0.2f, 0.3f}};
  ImageWriteOptions options;
  options.half = false;
  write_image(path("map.exr"), image, options);
  const std::string message = error_of(k_textured);
  EXPECT_EQ(message.find(path("scene.xml:3: ")), 0u) << message;
  EXPECT_NE(message.find("X, Y, Z"), std::string::npos) << message;
}

TEST_F(SceneBitmapRange, PixelsOutsideAreCutOffWithAWarning) {
  write_map("map.exr", {-0.5f, 0.75f, 3.0f});
  for (const char* raw : {"false", "true"}) {
    std::string body = k_textured;
    body.insert(body.find("</texture>"), std::string("<boolean name='raw' value='") + raw + "'/>");
    const Scene scene = load(body);
    ASSERT_EQ(scene.bitmaps.size(), 1u);
    EXPECT_EQ(scene.bitmaps[0].pixels[6], Rgb(0.0f, 0.75f, 1.0f));
    EXPECT_EQ(scene.bitmaps[0].pixels[5], Rgb(0.25f));
    EXPECT_TRUE(warned(path("scene.xml:3: ") + "the bitmap '" + path("map.exr") + "' has 1 pixels outside [0, 1]"));
  }
}

TEST_F(SceneBitmapRange, PixelsOutsideAreAnErrorInStrictMode) {
  strict = true;
  for (const Rgb& odd : {Rgb(-1e-6f, 0.0f, 0.0f), Rgb(0.0f, 1.0f, 1.0001f)}) {
    write_map("map.exr", odd);
    const std::string message = error_of(k_textured + k_sensor);
    EXPECT_EQ(message.find(path("scene.xml:3: ")), 0u) << message;
    EXPECT_NE(message.find("outside [0, 1]"), std::string::npos) << message;
  }
  write_map("map.exr", {0.0f, 1.0f, 0.5f});
  EXPECT_EQ(error_of(k_textured + k_sensor), "");
}

TEST_F(SceneBitmapRange, PixelsThatAreNotFiniteAreAnError) {
  for (const float odd : {NAN, INFINITY, -INFINITY}) {
    write_map("map.exr", {0.0f, odd, 0.5f});
    const std::string message = error_of(k_textured);
    EXPECT_EQ(message.find(path("scene.xml:3: ")), 0u) << message;
    EXPECT_NE(message.find("not finite"), std::string::npos) << message;
  }
}

TEST_F(SceneBitmapRange, ASkyFromTheSameFileKeepsItsRadiance) {
  write_map("map.exr", {2.0f, 0.75f, 3.0f});
  for (const std::string& body : {k_textured + k_sky, k_sky + k_textured}) {
    const Scene scene = load(body);
    const uint32_t texture = scene.textures[scene.bsdfs[scene.instances[0].bsdf].reflectance].bitmap;
    EXPECT_EQ(scene.bitmaps[texture].pixels[6], Rgb(1.0f, 0.75f, 1.0f));
    EXPECT_EQ(scene.bitmaps[scene.emitters[0].bitmap].pixels[6], Rgb(2.0f, 0.75f, 3.0f));
  }
}

// Integers of any width are sRGB, and stored values with `raw`.
TEST_F(SceneBitmapRange, SixteenBitsMeanWhatEightBitsMean) {
  const uint8_t bytes[] = {0, 10, 128, 200, 254, 255};
  for (const char* name : {"map8.png", "map16.png", "map8.tif", "map16.tif"}) {
    const bool wide = std::string(name).find("16") != std::string::npos;
    const OIIO::ImageSpec spec(2, 1, 3, wide ? OIIO::TypeDesc::UINT16 : OIIO::TypeDesc::UINT8);
    const auto output = OIIO::ImageOutput::create(path(name));
    ASSERT_TRUE(output && output->open(path(name), spec));
    ASSERT_TRUE(output->write_image(OIIO::TypeDesc::UINT8, bytes));
    ASSERT_TRUE(output->close());
    for (const bool raw : {false, true}) {
      std::string body = k_textured + k_sensor;
      body.replace(body.find("map.exr"), 7, name);
      body.insert(body.find("</texture>"),
                  std::string("<boolean name='raw' value='") + (raw ? "true" : "false") + "'/>");
      const Scene scene = load(body);
      ASSERT_EQ(scene.bitmaps.size(), 1u);
      for (int i = 0; i < 6; ++i) {
        const float stored = float(bytes[i]) / 255.0f;
        EXPECT_NEAR(scene.bitmaps[0].pixels[size_t(i / 3)][i % 3], raw ? stored : srgb_decode(stored), 1e-6f)
            << name << " raw " << raw;
      }
    }
  }
}

}  // namespace
}  // namespace fieldtrace
