// The layers that guide a denoiser: what is seen in mirrors, through glass and through masks.

#include <gtest/gtest.h>

#include <cmath>

#include "core/material/bsdf.h"
#include "core/material/fresnel.h"
#include "hybrid/render/render.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace {
namespace {

using test::look_at;
using test::scaling;
using test::SceneMaker;
using test::translation;

RenderOptions layered(int spp) {
  RenderOptions o;
  o.method = Method::monte_carlo;
  o.spp = spp;
  o.threads = 2;
  o.aovs = {"denoise_albedo", "denoise_normal", "albedo", "normal"};
  return o;
}

Vec3 value(const Image& image, int x, int y, const std::string& first_channel) {
  const int c = image.channel_index(first_channel);
  EXPECT_GE(c, 0) << first_channel;
  const float* const p = image.pixel(x, y) + c;
  return {p[0], p[1], p[2]};
}

Vec3 mean(const Image& image, const std::string& first_channel) {
  Vec3 sum(0.0f);
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) sum += value(image, x, y, first_channel);
  }
  return sum / float(image.width * image.height);
}

void expect_near(const Vec3& a, const Vec3& b, float bound) {
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(a[c], b[c], bound) << c;
}

// A camera that sees one point of a slanted pane at the origin, straight along x; the pane's normal lies between -x and
// z, `degrees` from -x. A wall stands in the way of what it reflects, and one behind it.
struct Pane {
  SceneMaker maker;
  float angle;
  Vec3 reflected;  // direction
  uint32_t bsdf = 0;
  static constexpr float k_reflected = 0.8f, k_behind = 0.3f;

  Pane(BsdfKind kind, float degrees, const Rgb& tint = Rgb(1.0f)) : angle(degrees * k_pi / 180.0f) {
    const Vec3 n(-std::cos(angle), 0.0f, std::sin(angle)), up(0, 1, 0);
    bsdf = maker.bsdf(kind, tint);
    maker.instance(maker.shape(ShapeKind::rectangle), bsdf, Affine(glm::cross(up, n), up, n, Vec3(0.0f)));
    reflected = Vec3(1, 0, 0) - 2.0f * n.x * n;
    add_wall(reflected, k_reflected);
    add_wall(Vec3(1, 0, 0), k_behind);
    maker.light(EmitterKind::constant, Rgb(1.0f));
    maker.scene.integrator.max_depth = 3;
    maker.scene.camera.fov_x_degrees = 1e-3f;
    maker.scene.camera.to_world = look_at({-5, 0, 0}, Vec3(0), up);
  }

  // 4 away from the pane, across `direction`.
  void add_wall(const Vec3& direction, float albedo) {
    const Vec3 y(0, 1, 0), n = -direction;
    maker.instance(maker.shape(ShapeKind::rectangle), maker.bsdf(BsdfKind::diffuse, Rgb(albedo)),
                   Affine(2.0f * glm::cross(y, n), 2.0f * y, n, 4.0f * direction));
  }
};

// Surveys have no layers.
TEST(DenoiseLayers, ArePassedOnInSurveyedPictures) {
  const Pane pane(BsdfKind::conductor, 45.0f, Rgb(0.9f, 0.5f, 0.1f));
  RenderOptions o = layered(16);
  o.light_estimator = LightEstimator::adaptive;
  const Vec3 adaptive = mean(render(pane.maker.scene, o).image, "denoise_albedo.R");
  expect_near(adaptive, mean(render(pane.maker.scene, layered(16)).image, "denoise_albedo.R"), 1e-3f);
  o.light_estimator = LightEstimator::automatic;
  o.method = Method::hybrid;
  expect_near(mean(render(pane.maker.scene, o).image, "denoise_albedo.R"), adaptive, 1e-3f);
  o.method = Method::monte_carlo;
  o.target_error = 0.5f;
  o.spp = 0;
  EXPECT_TRUE(render(pane.maker.scene, o).has_samples);
}

TEST(DenoiseLayers, AMirrorShowsWhatItReflects) {
  const Pane pane(BsdfKind::conductor, 45.0f, Rgb(0.9f, 0.5f, 0.1f));
  const Image image = render(pane.maker.scene, layered(4)).image;
  const Material mirror = resolve_material(pane.maker.scene, pane.bsdf, Vec2(0.0f), 1.0f);
  const Rgb reflectance = mirror.reflectance * fresnel_conductor(std::cos(pane.angle), mirror.eta, mirror.k);
  expect_near(mean(image, "denoise_albedo.R"), reflectance * Pane::k_reflected, 1e-4f);
  expect_near(mean(image, "denoise_normal.X"), -pane.reflected, 1e-4f);
  expect_near(mean(image, "normal.X"), {-std::cos(pane.angle), 0.0f, std::sin(pane.angle)}, 1e-4f);
}

// However the pane splits the path, what is seen beside and behind it are weighed as the light is; no ray leaves the
// dielectric's inside, where radiance is greater.
TEST(DenoiseLayers, GlassShowsBothSidesByFresnel) {
  for (const BsdfKind kind : {BsdfKind::thin_dielectric, BsdfKind::dielectric}) {
    const Pane pane(kind, 60.0f);
    const Material glass = resolve_material(pane.maker.scene, pane.bsdf, Vec2(0.0f), 1.0f);
    float share = fresnel_dielectric(std::cos(pane.angle), glass.relative_ior).reflectance;
    if (kind == BsdfKind::thin_dielectric) share *= 2.0f / (1.0f + share);  // with all reflections inside the pane
    const float expected = share * Pane::k_reflected + (1.0f - share) * Pane::k_behind;
    for (const int lobe_samples : {1, 3, 4, 16}) {
      SCOPED_TRACE(std::to_string(int(kind)) + " " + std::to_string(lobe_samples));
      RenderOptions o = layered(256);
      o.lobe_samples = lobe_samples;
      // The standard deviation over 16 x 16 pixels of 256 samples, as if they were independent; the bound is four.
      const float deviation = (Pane::k_reflected - Pane::k_behind) * std::sqrt(share * (1.0f - share) / 65536.0f);
      expect_near(mean(render(pane.maker.scene, o).image, "denoise_albedo.R"), Rgb(expected), 4.0f * deviation);
    }
  }
}

// A ball of clear glass in a room of one colour disappears.
TEST(DenoiseLayers, GlassAttenuatesNothing) {
  SceneMaker maker;
  const uint32_t sphere = maker.shape(ShapeKind::sphere);
  maker.instance(sphere, maker.bsdf(BsdfKind::dielectric, Rgb(1.0f)), Affine(1.0f));
  const uint32_t wall = maker.bsdf(BsdfKind::diffuse, Rgb(0.4f));
  maker.scene.bsdfs[wall].two_sided = true;
  maker.instance(sphere, wall, scaling(Vec3(20.0f)));
  maker.light(EmitterKind::point, Rgb(1.0f), {0, 5, 0});
  maker.scene.integrator.max_depth = 30;
  maker.scene.camera.to_world = look_at({0, 0, 5}, Vec3(0), {0, 1, 0});
  for (const int lobe_samples : {1, 4}) {
    RenderOptions o = layered(16);
    o.lobe_samples = lobe_samples;
    const Image image = render(maker.scene, o).image;
    for (int y = 0; y < image.height; ++y) {
      for (int x = 0; x < image.width; ++x) expect_near(value(image, x, y, "denoise_albedo.R"), Rgb(0.4f), 1e-5f);
    }
  }
}

TEST(DenoiseLayers, OpenMasksAreNotThere) {
  Pane open(BsdfKind::diffuse, 30.0f);
  const uint32_t mask = open.maker.masked(open.bsdf, 0.0f);
  open.maker.scene.instances[0].bsdf = mask;
  const Image through = render(open.maker.scene, layered(2)).image;
  expect_near(mean(through, "denoise_albedo.R"), Rgb(Pane::k_behind), 1e-6f);
  expect_near(mean(through, "denoise_normal.X"), {-1, 0, 0}, 1e-6f);
  // One that is half open shows itself.
  open.maker.scene.instances[0].bsdf = open.maker.masked(open.bsdf, 0.5f);
  const Image half = render(open.maker.scene, layered(2)).image;
  expect_near(mean(half, "denoise_albedo.R"), mean(half, "albedo.R"), 0.0f);
  expect_near(mean(half, "denoise_normal.X"), mean(half, "normal.X"), 0.0f);
}

// A path that ends on a mirror shows that, one that leaves the scene from there nothing.
TEST(DenoiseLayers, PathsThatMeetNothingElseShowTheMirrorOrNothing) {
  const Pane pane(BsdfKind::conductor, 45.0f, Rgb(0.5f));
  RenderOptions o = layered(1);
  o.max_depth = 1;
  const Image ended = render(pane.maker.scene, o).image;
  expect_near(mean(ended, "denoise_albedo.R"), Rgb(1.0f), 0.0f);
  expect_near(mean(ended, "denoise_normal.X"), mean(ended, "normal.X"), 0.0f);
  Pane alone = pane;
  alone.maker.scene.instances.resize(1);
  const Image left = render(alone.maker.scene, layered(1)).image;
  expect_near(mean(left, "denoise_albedo.R"), Rgb(0.0f), 0.0f);
  expect_near(mean(left, "denoise_normal.X"), Vec3(0.0f), 0.0f);
}

// Mirrors, glass, open and half-open masks, and a plastic, over a floor.
Scene many_surfaces() {
  SceneMaker maker;
  maker.film(60, 40);
  const uint32_t sphere = maker.shape(ShapeKind::sphere);
  const uint32_t grey = maker.bsdf(BsdfKind::diffuse, Rgb(0.5f));
  maker.instance(maker.shape(ShapeKind::rectangle), grey, scaling(Vec3(10.0f)));
  const uint32_t kinds[] = {maker.bsdf(BsdfKind::conductor, Rgb(0.9f)),
                            maker.bsdf(BsdfKind::dielectric, Rgb(1.0f)),
                            maker.masked(grey, 0.0f),
                            maker.masked(grey, 0.5f),
                            maker.bsdf(BsdfKind::plastic, Rgb(0.7f)),
                            maker.metal(0.2f),
                            maker.bsdf(BsdfKind::rough_plastic, Rgb(0.3f))};
  float x = -4.5f;
  for (const uint32_t bsdf : kinds) {
    Affine place = scaling(Vec3(0.7f));
    place[3] = Vec3(x, 0.0f, 0.7f);
    maker.instance(sphere, bsdf, place);
    x += 1.5f;
  }
  maker.area_light(maker.instance(sphere, grey, translation({0, 3, 6})), Rgb(6.0f));
  maker.light(EmitterKind::constant, Rgb(0.1f));
  maker.scene.camera.to_world = look_at({0, -9, 4}, {0, 0, 1}, {0, 0, 1});
  maker.scene.integrator.rr_depth = 2;
  return maker.scene;
}

TEST(DenoiseLayers, LeaveThePictureAsItIs) {
  Scene scene = many_surfaces();
  for (const int max_depth : {1, 2, 3, 8}) {
    for (const int lobe_samples : {1, 5}) {
      scene.integrator.max_depth = max_depth;
      RenderOptions o = layered(3);
      o.lobe_samples = lobe_samples;
      const Image with = render(scene, o).image;
      o.aovs.clear();
      const Image without = render(scene, o).image;
      for (int y = 0; y < with.height; ++y) {
        for (int x = 0; x < with.width; ++x) {
          for (int c = 0; c < 3; ++c) ASSERT_EQ(with.pixel(x, y)[c], without.pixel(x, y)[c]) << x << " " << y;
        }
      }
    }
  }
}

// Where nothing is smooth they are the first hits' albedo and normal.
TEST(DenoiseLayers, AreThoseOfFirstHitsWhereNothingIsSmooth) {
  Scene scene = many_surfaces();
  scene.integrator.max_depth = 4;
  for (size_t i = 1; i < 4; ++i) scene.instances[i].bsdf = scene.instances[5].bsdf;
  const Image image = render(scene, layered(4)).image;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      ASSERT_EQ(value(image, x, y, "denoise_albedo.R"), value(image, x, y, "albedo.R"));
      ASSERT_EQ(value(image, x, y, "denoise_normal.X"), value(image, x, y, "normal.X"));
    }
  }
}

}  // namespace
}  // namespace fieldtrace
