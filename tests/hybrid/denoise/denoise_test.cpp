// Denoised pictures: nearer to a reference, constant where the picture is, and nothing else of the image touched.

#include "hybrid/denoise/denoise.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include <algorithm>

#include "core/platform/error.h"
#include "hybrid/compare/compare.h"
#include "hybrid/render/render.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace {
namespace {

using test::look_at;
using test::SceneMaker;
using test::translation;

bool has_denoiser() {
  try {
    require_denoiser();
    return true;
  } catch (const UsageError&) {
    return false;
  }
}

#define SKIP_WITHOUT_DENOISER() \
  if (!has_denoiser()) GTEST_SKIP() << "built without Open Image Denoise (tools/install_packages.sh --with-oidn)"

Image constant_image(int width, int height, const std::vector<float>& pixel) {
  Image image;
  image.width = width;
  image.height = height;
  image.channels = {"R",
                    "G",
                    "B",
                    "depth.Z",
                    "denoise_albedo.R",
                    "denoise_albedo.G",
                    "denoise_albedo.B",
                    "denoise_normal.X",
                    "denoise_normal.Y",
                    "denoise_normal.Z"};
  EXPECT_EQ(pixel.size(), image.channel_count());
  for (int i = 0; i < width * height; ++i) image.data.insert(image.data.end(), pixel.begin(), pixel.end());
  return image;
}

// Balls of several materials on a floor under a wide lamp, before a mirror; or the same behind glass, out of focus. The
// lamp is not in view: at such edges, bright and without noise, denoising adds to the error.
Scene some_balls(bool behind_glass) {
  SceneMaker maker;
  maker.film(96, 64);
  const uint32_t grey = maker.bsdf(BsdfKind::diffuse, Rgb(0.6f, 0.5f, 0.4f));
  const uint32_t ball = maker.shape(ShapeKind::sphere);
  maker.instance(maker.shape(ShapeKind::rectangle), grey, test::scaling(Vec3(10.0f)));
  maker.instance(ball, maker.metal(0.3f), translation({-2.2f, 0, 1}));
  const Affine wall(Vec3(4, 0, 0), Vec3(0, 0, 1), Vec3(0, -1, 0), Vec3(0, 2, 1));
  maker.instance(maker.shape(ShapeKind::rectangle), maker.bsdf(BsdfKind::conductor, Rgb(0.9f)), wall);
  maker.instance(ball, maker.bsdf(BsdfKind::diffuse, Rgb(0.1f, 0.5f, 0.2f)), translation({0, 0, 1}));
  maker.instance(ball, maker.bsdf(BsdfKind::rough_plastic, Rgb(0.6f, 0.1f, 0.1f)), translation({2.2f, 0, 1}));
  const Affine down(Vec3(2, 0, 0), Vec3(0, -2, 0), Vec3(0, 0, -1), Vec3(0, 0, 6));
  maker.area_light(maker.instance(maker.shape(ShapeKind::disk), grey, down), Rgb(8.0f));
  maker.scene.camera.to_world = look_at({0, -8, 4}, {0, 0, 1}, {0, 0, 1});
  maker.scene.integrator.max_depth = 5;
  if (behind_glass) {
    const Affine pane(Vec3(0, 0, 9), Vec3(9, 0, 0), Vec3(0, 9, 0), Vec3(0, -4, 2));
    maker.instance(maker.shape(ShapeKind::rectangle), maker.bsdf(BsdfKind::thin_dielectric, Rgb(1.0f)), pane);
    maker.scene.camera.aperture_radius = 0.1f;
    maker.scene.camera.focus_distance = 9.0f;
  }
  return maker.scene;
}

RenderOptions options_for(int spp) {
  RenderOptions o;
  o.method = Method::monte_carlo;
  o.spp = spp;
  o.threads = 2;
  o.aovs = denoise_layers();
  o.seed = 1;
  return o;
}

TEST(Denoise, LowersTheErrorOfNoisyRenders) {
  SKIP_WITHOUT_DENOISER();
  for (const bool behind_glass : {false, true}) {
    SCOPED_TRACE(behind_glass);
    const Scene scene = some_balls(behind_glass);
    Image noisy = render(scene, options_for(4)).image;
    RenderOptions many = options_for(512);
    many.seed = 2;
    Image reference = render(scene, many).image;
    Image denoised = noisy;
    EXPECT_NE(denoise(denoised, {.threads = 2}).find("Open Image Denoise"), std::string::npos);
    for (Image* image : {&noisy, &reference, &denoised}) {
      drop_denoise_layers(*image, {});
      ASSERT_EQ(image->channels, (std::vector<std::string>{"R", "G", "B"}));
    }
    EXPECT_LT(compare_images(denoised, reference).rmse, compare_images(noisy, reference).rmse);
  }
}

TEST(Denoise, NoisyLayersAreFilteredFirst) {
  SKIP_WITHOUT_DENOISER();
  constexpr float k_value = 0.5f;
  const auto error_of = [&](bool noisy_layers) {
    Image image = constant_image(64, 64, {k_value, k_value, k_value, 0, k_value, k_value, k_value, 0, 0, 1});
    std::mt19937 random(3);
    std::normal_distribution<float> noise(0.0f, 0.1f);
    for (int i = 0; i < 64 * 64; ++i) {
      float* const p = image.pixel(i % 64, i / 64);
      for (const int c : {0, 1, 2, 4, 5, 6}) p[c] += noise(random);
    }
    denoise(image, {.threads = 2, .noisy_layers = noisy_layers});
    double sum = 0.0;
    for (int i = 0; i < 64 * 64; ++i) sum += std::pow(double(image.pixel(i % 64, i / 64)[0] - k_value), 2);
    return std::sqrt(sum / (64 * 64));
  };
  EXPECT_LT(error_of(true), 0.5 * error_of(false));
}

// Up to the network's own error, which is measured: about 1 % of the value, and a third of it in a corner.
TEST(Denoise, ConstantsStayConstants) {
  SKIP_WITHOUT_DENOISER();
  constexpr int k_border = 8;
  for (const float value : {0.0f, 0.01f, 0.5f, 3.0f, 1000.0f}) {
    SCOPED_TRACE(value);
    Image image = constant_image(50, 37, {value, 0.5f * value, 0, 7, 0.5f, 0.25f, 0.1f, 0, 0, 1});
    const Image before = image;
    denoise(image, {.threads = 1});
    for (int y = 0; y < image.height; ++y) {
      for (int x = 0; x < image.width; ++x) {
        const float *const p = image.pixel(x, y), *const q = before.pixel(x, y);
        for (int c = 3; c < 10; ++c) ASSERT_EQ(p[c], q[c]);
        if (x < k_border || y < k_border || x >= image.width - k_border || y >= image.height - k_border) continue;
        for (int c = 0; c < 3; ++c) ASSERT_NEAR(p[c], q[c], 0.03f * value + 1e-4f) << c << " at " << x << " " << y;
      }
    }
  }
}

TEST(Denoise, WithoutItsLayersThePictureStays) {
  Image image = constant_image(5, 4, {1, 2, 3, 4, 5, 6, 7, 8, 9, 10});
  drop_denoise_layers(image, {"denoise_normal", "depth"});
  EXPECT_EQ(image.channels, (std::vector<std::string>{"R", "G", "B", "depth.Z", "denoise_normal.X", "denoise_normal.Y",
                                                      "denoise_normal.Z"}));
  for (int i = 0; i < 20; ++i) {
    const std::vector<float> pixel(image.pixel(i % 5, i / 5), image.pixel(i % 5, i / 5) + 7);
    ASSERT_EQ(pixel, (std::vector<float>{1, 2, 3, 4, 8, 9, 10}));
  }
  const Image before = image;
  EXPECT_THROW(denoise(image, {.threads = 1}), Error);
  EXPECT_EQ(image.data, before.data);
}

}  // namespace
}  // namespace fieldtrace
