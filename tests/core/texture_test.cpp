// Texture look-ups against values of an independent renderer (Mitsuba 3.9), and their symmetries.

#include "core/material/texture.h"

#include <gtest/gtest.h>

namespace fieldtrace {
namespace {

// Three columns (red, green, blue), with the lower row half as bright.
Scene bitmap_scene(WrapMode wrap, TextureFilter filter) {
  Scene scene;
  Bitmap b;
  b.width = 3;
  b.height = 2;
  b.pixels = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {.5f, 0, 0}, {0, .5f, 0}, {0, 0, .5f}};
  scene.bitmaps.push_back(b);
  Texture t;
  t.kind = TextureKind::bitmap;
  t.bitmap = 0;
  t.wrap = wrap;
  t.filter = filter;
  scene.textures.push_back(t);
  return scene;
}

void expect_rgb(const Rgb& a, const Rgb& b) {
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(a[c], b[c], 2e-6f);
}

TEST(Texture, NearestBitmapAgreesWithReference) {
  struct Case {
    WrapMode wrap;
    Vec2 uv;
    Rgb value;
  };
  const Case cases[] = {
      {WrapMode::repeat, {.1f, .1f}, {1, 0, 0}},   {WrapMode::repeat, {.1f, .9f}, {.5f, 0, 0}},
      {WrapMode::repeat, {1.2f, .3f}, {1, 0, 0}},  {WrapMode::repeat, {-.2f, -.1f}, {0, 0, .5f}},
      {WrapMode::mirror, {1.2f, .3f}, {0, 0, 1}},  {WrapMode::mirror, {-.2f, -.1f}, {1, 0, 0}},
      {WrapMode::mirror, {.3f, 1.6f}, {1, 0, 0}},  {WrapMode::clamp, {1.2f, .3f}, {0, 0, 1}},
      {WrapMode::clamp, {.3f, 1.6f}, {.5f, 0, 0}},
  };
  for (const Case& c : cases)
    expect_rgb(evaluate_texture(bitmap_scene(c.wrap, TextureFilter::nearest), 0, c.uv), c.value);
}

TEST(Texture, BilinearBitmapAgreesWithReference) {
  const Scene repeat = bitmap_scene(WrapMode::repeat, TextureFilter::bilinear);
  expect_rgb(evaluate_texture(repeat, 0, {.1f, .1f}), {.68f, 0, .17f});
  expect_rgb(evaluate_texture(repeat, 0, {.5f, .5f}), {0, .75f, 0});
  expect_rgb(evaluate_texture(repeat, 0, {-.2f, -.1f}), {0, .065f, .585f});
  const Scene mirror = bitmap_scene(WrapMode::mirror, TextureFilter::bilinear);
  expect_rgb(evaluate_texture(mirror, 0, {1.2f, .3f}), {0, .095f, .855f});
  expect_rgb(evaluate_texture(mirror, 0, {.3f, 1.6f}), {.51f, .34f, 0});
  const Scene clamp = bitmap_scene(WrapMode::clamp, TextureFilter::bilinear);
  expect_rgb(evaluate_texture(clamp, 0, {1.2f, .3f}), {0, 0, .95f});
  expect_rgb(evaluate_texture(clamp, 0, {.3f, 1.6f}), {.3f, .2f, 0});
}

TEST(Texture, CheckerboardAgreesWithReference) {
  Scene scene;
  Texture t;
  t.kind = TextureKind::checkerboard;
  t.color0 = Rgb(0.4f);
  t.color1 = Rgb(0.2f);
  t.uv_transform = glm::mat3x2(2, 0, 0, 3, 0, 0);
  scene.textures.push_back(t);
  EXPECT_EQ(evaluate_texture(scene, 0, {.1f, .1f}).x, .4f);
  EXPECT_EQ(evaluate_texture(scene, 0, {.3f, .1f}).x, .2f);
  EXPECT_EQ(evaluate_texture(scene, 0, {.3f, .3f}).x, .4f);
  EXPECT_EQ(evaluate_texture(scene, 0, {.1f, .4f}).x, .4f);
  EXPECT_EQ(evaluate_texture(scene, 0, {-.1f, .1f}).x, .2f);
}

// Mitsuba 3.9.1's values for the opacity of a mask.
TEST(Texture, OneNumberIsTheMeanOrTheLuminance) {
  Scene scene;
  Texture t;
  t.color0 = Rgb(0.2f, 0.5f, 0.7f);
  scene.textures.push_back(t);
  EXPECT_FLOAT_EQ(evaluate_scalar_texture(scene, 0, {}), 1.4f / 3.0f);
  t.kind = TextureKind::checkerboard;
  t.color1 = Rgb(0.1f);
  scene.textures.push_back(t);
  EXPECT_FLOAT_EQ(evaluate_scalar_texture(scene, 1, {0.2f, 0.2f}), 0.1f);
  EXPECT_FLOAT_EQ(evaluate_scalar_texture(scene, 1, {0.2f, 0.7f}), 1.4f / 3.0f);
  t.kind = TextureKind::bitmap;
  t.bitmap = 0;
  scene.bitmaps.push_back({1, 1, {Rgb(0.2f, 0.5f, 0.7f)}});
  scene.textures.push_back(t);
  EXPECT_NEAR(evaluate_scalar_texture(scene, 2, {0.3f, 0.4f}), 1.0f - 0.549367f, 1e-6f);
}

TEST(Texture, AnyCoordinateIsAccepted) {
  for (const WrapMode wrap : {WrapMode::repeat, WrapMode::mirror, WrapMode::clamp}) {
    for (const TextureFilter filter : {TextureFilter::nearest, TextureFilter::bilinear}) {
      const Scene scene = bitmap_scene(wrap, filter);
      for (const float x : {0.0f, -0.0f, 1.0f, -1.0f, 1e30f, -1e30f, k_infinity, std::nanf("")}) {
        for (const float y : {0.5f, -1e9f, k_infinity}) {
          const Rgb c = evaluate_texture(scene, 0, {x, y});
          EXPECT_TRUE(c.x + c.y + c.z >= 0.49f && c.x + c.y + c.z <= 1.01f) << x << " " << y;
        }
      }
    }
  }
}

}  // namespace
}  // namespace fieldtrace
