// Pictures of the same number of samples by other splits into camera and light samples, and of parts of the film.
#include <gtest/gtest.h>

#include <cmath>

#include "core/mesh/mesh_procedural.h"
#include "hybrid/compare/compare.h"
#include "hybrid/render/render.h"
#include "tests/support/hybrid_scenes.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace {
namespace {

struct Split {
  int spp, light_samples;
};

// A knot over a floor under a ball and a rectangle.
Scene knot_over_floor(int size, bool textured = false) {
  test::SceneMaker s;
  s.film(size, size);
  s.scene.camera.to_world = test::look_at({2.5f, -6, 3}, {0, 0, 0.3f}, {0, 0, 1});
  s.scene.camera.fov_x_degrees = 12.0f;
  const uint32_t grey = s.bsdf(BsdfKind::diffuse, Rgb(0.5f)), floor = s.bsdf(BsdfKind::diffuse, Rgb(0.5f));
  if (textured) {
    Texture t;
    t.kind = TextureKind::checkerboard;
    t.color0 = Rgb(0.9f, 0.1f, 0.1f);
    t.color1 = Rgb(0.05f, 0.8f, 0.3f);
    t.uv_transform[0][0] = t.uv_transform[1][1] = 40.0f;  // several fields in a pixel
    s.scene.textures.push_back(t);
    s.scene.bsdfs[floor].reflectance = uint32_t(s.scene.textures.size() - 1);
  }
  s.instance(s.mesh(make_knot({.along = 256, .around = 24})), grey, test::translation({0, 0, 1}));
  s.instance(s.shape(ShapeKind::rectangle), floor, test::scaling(Vec3(6.0f)));
  Affine at = test::scaling(Vec3(0.5f));
  at[3] = {2, -2, 4};
  s.area_light(s.instance(s.shape(ShapeKind::sphere), grey, at), Rgb(60.0f));
  const Affine turned = test::look_at({-2, -3, 5}, {0, 0, 0.5f}, {0, 0, 1});
  s.area_light(s.instance(s.shape(ShapeKind::rectangle), grey,
                          Affine(0.7f * turned[0], 0.4f * turned[1], 0.4f * turned[2], turned[3])),
               Rgb(60.0f));
  return s.scene;
}

RenderOptions options_for(Method method, const Split& split) {
  RenderOptions o;
  o.method = method;
  o.spp = split.spp;
  o.light_samples = split.light_samples;
  o.threads = 2;
  o.directions = 32;
  o.plane = 64;
  o.leave_to_rays = false;
  return o;
}

Image picture(const Scene& scene, Method method, const Split& split) {
  return render(scene, options_for(method, split)).image;
}

// What fields may add to a picture (RMSE).
constexpr double k_added = 0.002;

TEST(SampleSplits, OfOneNumberOfSamplesAreEquallyGood) {
  const Scene scene = knot_over_floor(64);
  const Image truth = picture(scene, Method::monte_carlo, {256, 16});
  for (const Split& split : {Split{64, 1}, Split{8, 8}, Split{1, 64}}) {
    const RenderResult rays = render(scene, options_for(Method::monte_carlo, split));
    const double noise = compare_images(rays.image, truth).rmse;
    const RenderResult fields = render(scene, options_for(Method::hybrid, split));
    EXPECT_LE(compare_images(fields.image, truth).rmse, noise + k_added) << split.spp;
    EXPECT_LT(fields.stats.rays_exact, rays.stats.rays_exact / 2) << split.spp;
  }
}

// Of each camera sample its own, although light arrives once per pixel.
TEST(SampleSplits, KeepTheAlbedoOfEachSample) {
  const Scene scene = knot_over_floor(64, true);
  for (const Split& split : {Split{64, 1}, Split{8, 8}}) {
    // The same camera samples, and so the same means of the texture.
    const Image truth = picture(scene, Method::monte_carlo, {split.spp, 1024 / split.spp});
    const double noise = compare_images(picture(scene, Method::monte_carlo, split), truth).rmse;
    const double error = compare_images(picture(scene, Method::hybrid, split), truth).rmse;
    EXPECT_LE(error, noise + k_added) << split.spp;
  }
}

void expect_crop_equals_whole(const Scene& scene, RenderOptions o, const std::vector<Rect>& windows) {
  const Image whole = render(scene, o).image;
  for (const Rect& window : windows) {
    o.crop = window;
    o.threads = 1;
    const Image part = render(scene, o).image;
    size_t different = 0;
    for (int y = 0; y < part.height; ++y) {
      for (int x = 0; x < part.width; ++x) {
        for (size_t c = 0; c < part.channel_count(); ++c)
          different += part.pixel(x, y)[c] != whole.pixel(x + window.x, y + window.y)[c];
      }
    }
    EXPECT_EQ(different, 0u) << o.spp << " x " << o.light_samples << " " << int(o.method) << ", " << window.x << " "
                             << window.y << " " << window.width;
  }
}

TEST(SampleSplits, CropIsThatPartOfTheWhole) {
  const Scene scene = knot_over_floor(40);
  std::vector<Rect> windows = {{5, 9, 33, 26}, {13, 2, 7, 38}};
  // Single pixels, on the knot's silhouette, too.
  for (int i = 0; i < 12; ++i) windows.push_back({3 * i, 20, 1, 1});
  for (const Method method : {Method::monte_carlo, Method::hybrid}) {
    for (const Split& split : {Split{64, 1}, Split{4, 16}, Split{1, 64}, Split{3, 1}}) {
      expect_crop_equals_whole(scene, options_for(method, split), windows);
    }
    // Blocks of 8 x 8 pixels do not fit into a batch; those at the film's edges, half as wide, do.
    expect_crop_equals_whole(knot_over_floor(36), options_for(method, {80, 1}), {{25, 0, 11, 36}, {0, 25, 36, 11}});
    expect_crop_equals_whole(knot_over_floor(5), options_for(method, {5000, 1}), {{1, 1, 3, 2}, {2, 2, 1, 1}});
  }
}

// Groups of pixels that see more instances than single rays are tested against.
TEST(SampleSplits, CropOfACrowdIsThatPartOfTheWhole) {
  const Scene scene = test::hybrid_scene("crowd", 40).scene;
  const std::vector<Rect> windows = {{5, 9, 33, 26}, {20, 20, 1, 1}, {11, 25, 2, 3}};
  for (const Method method : {Method::monte_carlo, Method::hybrid}) {
    for (const Split& split : {Split{64, 1}, Split{4, 16}, Split{1, 64}, Split{3, 1}}) {
      expect_crop_equals_whole(scene, options_for(method, split), windows);
    }
  }
}

}  // namespace
}  // namespace fieldtrace
