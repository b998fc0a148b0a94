// The renderer against scenes with known answers, and its invariances.

#include <gtest/gtest.h>

#include <atomic>

#include "core/trace/accel.h"
#include "hybrid/render/render.h"
#include "hybrid/transport/trace_pixels.h"
#include "tests/support/image_statistics.h"
#include "tests/support/random_lines.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace {
namespace {

using test::look_at;
using test::mean;
using test::scaling;
using test::SceneMaker;
using test::translation;

RenderOptions options_for(int spp, int light_samples = 1) {
  RenderOptions o;
  o.method = Method::monte_carlo;
  o.spp = spp;
  o.light_samples = light_samples;
  o.threads = 2;
  return o;
}

// Mean of channel `c` over the picture.
size_t channel(const Image& image, const std::string& name) {
  const auto found = std::find(image.channels.begin(), image.channels.end(), name);
  EXPECT_NE(found, image.channels.end()) << name;
  return size_t(found - image.channels.begin());
}

// Looks straight down at the origin of the plane z = 0 through so narrow a field of view that every pixel sees the
// origin: the picture covers 2e-4 there.
constexpr float k_albedo = 0.6f;
SceneMaker plane_seen_from_above(float height = 10.0f) {
  SceneMaker maker;
  const uint32_t grey = maker.bsdf(BsdfKind::diffuse, Rgb(k_albedo));
  maker.instance(maker.shape(ShapeKind::rectangle), grey, scaling(Vec3(50.0f)));
  maker.scene.camera.fov_x_degrees = 1e-3f;
  maker.scene.camera.to_world = look_at({0, 0, height}, Vec3(0), {0, 1, 0});
  return maker;
}

TEST(Transport, PointLightFollowsTheInverseSquare) {
  SceneMaker maker = plane_seen_from_above();
  maker.light(EmitterKind::point, Rgb(5.0f, 6.0f, 7.0f), {3, 0, 4});
  const RenderResult r = render(maker.scene, options_for(1));
  // I cos / r^2 with r = 5 and cos = 4 / 5.
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(mean(r.image, c), k_albedo / k_pi * (5.0 + c) * 0.8 / 25.0, 1e-5);
}

TEST(Transport, DirectionalLightFollowsTheCosine) {
  SceneMaker maker = plane_seen_from_above();
  maker.light(EmitterKind::directional, Rgb(3.0f), glm::normalize(Vec3(1, 1, -2)));
  EXPECT_NEAR(mean(render(maker.scene, options_for(1)).image), k_albedo / k_pi * 3.0 * 2.0 / std::sqrt(6.0), 1e-5);
}

TEST(Transport, SphereLightHasItsFormFactor) {
  SceneMaker maker = plane_seen_from_above();
  const float radius = 0.7f, distance = 3.0f;
  Affine place = scaling(Vec3(radius));
  place[3] = Vec3(0, distance * 0.6f, distance * 0.8f);
  maker.area_light(maker.instance(maker.shape(ShapeKind::sphere), 0, place), Rgb(2.0f));
  // pi L (r / d)^2 cos irradiates the plane: the light is wholly above its horizon.
  const double expected = k_albedo * 2.0 * (radius * radius) / (distance * distance) * 0.8;
  EXPECT_NEAR(mean(render(maker.scene, options_for(16, 16)).image), expected, 1e-4 * expected);
}

// A longer path finds the light again by chance; light samples have already counted that emission.
TEST(Transport, LongerPathsCountLightsOnce) {
  for (const ShapeKind kind : {ShapeKind::sphere, ShapeKind::disk}) {
    SceneMaker maker = plane_seen_from_above(0.5f);
    const uint32_t black = maker.bsdf(BsdfKind::diffuse, Rgb(0.0f));
    const Affine down(Vec3(1, 0, 0), Vec3(0, -1, 0), Vec3(0, 0, -1), Vec3(0, 0, 2));
    maker.area_light(maker.instance(maker.shape(kind), black, down), Rgb(3.0f));
    maker.scene.integrator.max_depth = 4;
    // sin^2 of the light's half angle: 1 / 4 for the sphere, 1 / 5 for the disk.
    const double expected = k_albedo * 3.0 * (kind == ShapeKind::sphere ? 0.25 : 0.2);
    EXPECT_NEAR(mean(render(maker.scene, options_for(64, 4)).image), expected, 3e-3 * expected) << int(kind);
  }
}

TEST(Transport, RectangleAndDiskLightsHaveTheirFormFactors) {
  // Facing downwards at height 1 (the rectangle [-1, 1]^2, the disk of radius 1).
  const Affine down(Vec3(1, 0, 0), Vec3(0, -1, 0), Vec3(0, 0, -1), Vec3(0, 0, 1));
  const double corner = 2.0 * std::sqrt(0.5) * std::atan(std::sqrt(0.5)) / (2.0 * k_pi);
  const double expected[] = {4.0 * corner, 0.5};
  int i = 0;
  for (const ShapeKind kind : {ShapeKind::rectangle, ShapeKind::disk}) {
    SceneMaker maker = plane_seen_from_above(0.5f);
    maker.area_light(maker.instance(maker.shape(kind), 0, down), Rgb(3.0f));
    const RenderResult r = render(maker.scene, options_for(64, 16));
    EXPECT_NEAR(mean(r.image), k_albedo * 3.0 * expected[i], 2e-3 * k_albedo * 3.0 * expected[i]) << int(kind);
    // Closed form: no ray follows the camera's. Otherwise one more each.
    EXPECT_EQ(r.stats.rays_primary, (kind == ShapeKind::rectangle ? 1u : 2u) * 256 * 64);
    ++i;
  }
}

TEST(Transport, ConvexBodyInUniformLightShowsItsAlbedo) {
  for (const BsdfKind kind : {BsdfKind::diffuse, BsdfKind::conductor, BsdfKind::dielectric}) {
    SceneMaker maker;
    const uint32_t bsdf = maker.bsdf(kind, Rgb(kind == BsdfKind::diffuse ? 0.7f : 1.0f));
    maker.instance(maker.shape(ShapeKind::sphere), bsdf, translation(Vec3(0.1f, 0.2f, 0.0f)));
    maker.light(EmitterKind::constant, Rgb(1.0f));
    maker.scene.camera.to_world = look_at({0, 0, 5}, Vec3(0), {0, 1, 0});
    maker.scene.camera.fov_x_degrees = 10.0f;
    maker.scene.integrator.max_depth = kind == BsdfKind::dielectric ? -1 : 2;
    const double expected = kind == BsdfKind::diffuse ? 0.7 : 1.0;
    EXPECT_NEAR(mean(render(maker.scene, options_for(64, 4)).image), expected, 3e-3) << int(kind);
  }
}

constexpr BsdfKind k_all_bsdfs[] = {BsdfKind::diffuse,    BsdfKind::conductor,        BsdfKind::rough_conductor,
                                    BsdfKind::dielectric, BsdfKind::rough_dielectric, BsdfKind::thin_dielectric,
                                    BsdfKind::plastic,    BsdfKind::rough_plastic,    BsdfKind::principled};

// The same under a white environment map, which both light samples and material samples find.
TEST(Transport, ConvexBodyUnderAWhiteMapShowsItsAlbedo) {
  for (const BsdfKind kind : k_all_bsdfs) {
    SceneMaker maker;
    const uint32_t bsdf = maker.bsdf(kind, Rgb(kind == BsdfKind::diffuse ? 0.7f : 1.0f));
    maker.instance(maker.shape(ShapeKind::sphere), bsdf, translation(Vec3(0.1f, 0.2f, 0.0f)));
    SceneMaker constant = maker;
    maker.environment(8, 5, [](int, int) { return Rgb(1.0f, 0.5f, 0.25f); });
    constant.light(EmitterKind::constant, Rgb(1.0f, 0.5f, 0.25f));
    for (SceneMaker* m : {&maker, &constant}) {
      m->scene.camera.to_world = look_at({0, 0, 5}, Vec3(0), {0, 1, 0});
      m->scene.camera.fov_x_degrees = 10.0f;
      m->scene.integrator.max_depth = transmits(kind) ? -1 : 2;
    }
    const Image a = render(maker.scene, options_for(64, 4)).image, b = render(constant.scene, options_for(64, 4)).image;
    for (size_t c = 0; c < 3; ++c) EXPECT_NEAR(mean(a, c), mean(b, c), 4e-3 * mean(b, c)) << int(kind) << " " << c;
    if (kind == BsdfKind::diffuse) {
      EXPECT_NEAR(mean(a), 0.7, 3e-3);
    }
  }
}

TEST(Transport, CameraSeesTheMapUnlessEmittersAreHidden) {
  SceneMaker maker;
  // Each texel has its own colour; the view along -z falls on the seam between the last column and the first.
  maker.environment(8, 5, [](int x, int y) { return Rgb(float(x), float(y), 1.0f); });
  maker.scene.camera.to_world = look_at({3, 4, 5}, {3, 4, 4}, {0, 1, 0});
  maker.scene.camera.fov_x_degrees = 1e-3f;
  maker.scene.integrator.max_depth = 1;
  const Image image = render(maker.scene, options_for(1)).image;
  EXPECT_NEAR(mean(image, 0), 3.5, 1e-3);
  EXPECT_NEAR(mean(image, 1), 2.0, 1e-3);
  EXPECT_EQ(mean(image, 2), 1.0);
  maker.scene.integrator.hide_emitters = true;
  EXPECT_EQ(mean(render(maker.scene, options_for(1)).image, 2), 0.0);
  // Hidden from the camera, the map still lights surfaces.
  SceneMaker plane = plane_seen_from_above();
  plane.environment(8, 5, [](int, int) { return Rgb(1.0f); });
  plane.scene.integrator.hide_emitters = true;
  EXPECT_NEAR(mean(render(plane.scene, options_for(64, 4)).image), k_albedo, 3e-3);
}

// Light and material samples share the work in any proportion; together they find the irradiance.
TEST(Transport, PlaneUnderAMapReceivesItsIrradiance) {
  const Mat3 up(Vec3(1, 0, 0), Vec3(0, 0, 1), Vec3(0, -1, 0));  // the map's +y is the plane's +z
  const auto texel = [](int x, int y) { return y < 4 ? Rgb(x == 3 && y == 2 ? 20.0f : 0.5f) : Rgb(9.0f); };
  // Midpoint rule over theta and phi: texel rows every 18 degrees, columns every 45.
  double expected = 0.0;
  constexpr int k_n = 720;
  for (int i = 0; i < k_n; ++i) {
    for (int j = 0; j < k_n; ++j) {
      const double theta = 0.5 * M_PI * (i + 0.5) / k_n, v = 5.0 * (i + 0.5) / k_n, u = 8.0 * (j + 0.5) / k_n - 0.5;
      const int y = int(v), x = int(std::floor(u));
      const auto value = [&](int column, int row) { return double(texel((column + 8) % 8, row).x); };
      const double s = u - x, t = v - y;
      const double radiance = (1 - t) * ((1 - s) * value(x, y) + s * value(x + 1, y)) +
                              t * ((1 - s) * value(x, y + 1) + s * value(x + 1, y + 1));
      expected += radiance * std::cos(theta) * std::sin(theta) * 0.5 * M_PI / k_n * 2 * M_PI / k_n;
    }
  }
  for (const int light_samples : {1, 4, 16}) {
    SceneMaker maker = plane_seen_from_above(10.0f);
    maker.environment(8, 11, texel, up);
    const double got = mean(render(maker.scene, options_for(128, light_samples)).image);
    EXPECT_NEAR(got, k_albedo / M_PI * expected, 3e-3 * got) << light_samples;
  }
}

// Inside a closed shell that emits and reflects, radiance is Le / (1 - albedo): every bounce, multiple importance
// sampling and Russian roulette must balance.
TEST(Transport, ClosedShellReachesEquilibrium) {
  for (const BsdfKind kind : {BsdfKind::diffuse, BsdfKind::conductor}) {
    SceneMaker maker;
    const uint32_t bsdf = maker.bsdf(kind, Rgb(0.5f));
    if (kind == BsdfKind::conductor) maker.scene.bsdfs[bsdf].eta = Rgb(0.0f);
    const uint32_t shell = maker.instance(maker.shape(ShapeKind::sphere), bsdf, scaling(Vec3(3.0f)));
    maker.scene.instances[shell].flip_normals = true;
    maker.area_light(shell, Rgb(1.0f));
    maker.scene.integrator.max_depth = -1;
    maker.scene.integrator.rr_depth = 3;
    maker.scene.camera.to_world = look_at({0.5f, 0, 0}, {0, 0.3f, 1}, {0, 1, 0});
    EXPECT_NEAR(mean(render(maker.scene, options_for(256)).image), 2.0, 0.02) << int(kind);
  }
}

// A box of perfect mirrors with one emitting wall: every path ends there, whatever the number of bounces.
TEST(Transport, MirrorBoxLosesNothing) {
  SceneMaker maker;
  const uint32_t mirror = maker.bsdf(BsdfKind::conductor, Rgb(1.0f));
  const uint32_t black = maker.bsdf(BsdfKind::diffuse, Rgb(0.0f));
  const uint32_t rectangle = maker.shape(ShapeKind::rectangle);
  const Vec3 axes[3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  for (int wall = 0; wall < 6; ++wall) {
    const Vec3 n = axes[wall % 3] * (wall < 3 ? 1.0f : -1.0f), s = axes[(wall + 1) % 3];
    const uint32_t i = maker.instance(rectangle, wall == 0 ? black : mirror, Affine(s, glm::cross(n, s), n, -n));
    if (wall == 0) maker.area_light(i, Rgb(1.0f));
  }
  maker.scene.integrator.max_depth = 64;
  maker.scene.integrator.rr_depth = 1000;
  maker.scene.camera.to_world = look_at({0.1f, 0.2f, -0.3f}, {1, 0.4f, 0.7f}, {0, 0, 1});
  const RenderResult r = render(maker.scene, options_for(4));
  for (size_t i = 0; i < r.image.data.size(); ++i) ASSERT_NEAR(r.image.data[i], 1.0f, 1e-4f);
}

// The expectation is the same for any split between light samples and lobe samples, including light from below.
void expect_estimates_agree(BsdfKind kind, float opacity) {
  SceneMaker maker;
  uint32_t glossy = maker.bsdf(kind, Rgb(0.9f));
  for (Bsdf& b : maker.scene.bsdfs) {
    b.microfacet = MicrofacetKind::ggx, b.alpha_u = 0.15f, b.alpha_v = 0.4f;
    if (kind == BsdfKind::rough_plastic) b.alpha_u = b.alpha_v = 0.2f;
  }
  if (opacity < 1.0f) glossy = maker.masked(glossy, opacity);
  const uint32_t metal = maker.bsdf(BsdfKind::rough_conductor, Rgb(0.9f));
  maker.instance(maker.shape(ShapeKind::rectangle), glossy, scaling(Vec3(50.0f)));
  const Affine up(Vec3(2, 0, 0), Vec3(0, 2, 0), Vec3(0, 0, 2), Vec3(0, 1, -2));
  maker.area_light(maker.instance(maker.shape(ShapeKind::disk), metal, up), Rgb(3.0f));
  maker.area_light(maker.instance(maker.shape(ShapeKind::sphere), metal, translation({0, 4, 3})), Rgb(5.0f));
  Affine down(Vec3(1, 0, 0), Vec3(0, -1, 0), Vec3(0, 0, -1), Vec3(1, 3, 5));
  maker.area_light(maker.instance(maker.shape(ShapeKind::disk), metal, down), Rgb(8.0f));
  maker.scene.camera.to_world = look_at({0, -5, 4}, Vec3(0), {0, 0, 1});
  maker.scene.camera.fov_x_degrees = 20.0f;
  maker.scene.integrator.max_depth = 3;
  RenderOptions reference = options_for(1024);
  const double expected = mean(render(maker.scene, reference).image);
  EXPECT_GT(expected, 0.05);
  for (const auto& [light, lobe] : {std::pair(8, 1), std::pair(1, 8), std::pair(4, 16)}) {
    RenderOptions o = options_for(128, light);
    o.lobe_samples = lobe;
    o.seed = 5;
    EXPECT_NEAR(mean(render(maker.scene, o).image), expected, 0.01 * expected)
        << int(kind) << " " << opacity << ": " << light << " " << lobe;
  }
}

TEST(Transport, GlossyEstimatesAgree) {
  for (const BsdfKind kind : {BsdfKind::rough_conductor, BsdfKind::rough_dielectric, BsdfKind::plastic,
                              BsdfKind::rough_plastic, BsdfKind::principled})
    expect_estimates_agree(kind, 1.0f);
}

TEST(Transport, MaskedEstimatesAgree) {
  for (const BsdfKind kind : {BsdfKind::diffuse, BsdfKind::conductor, BsdfKind::rough_dielectric, BsdfKind::plastic})
    expect_estimates_agree(kind, 0.4f);
}

// Black masks that let 3 / 4 through, one behind the other: each dims what is seen through it.
TEST(Transport, MasksDimWhatLiesBehind) {
  for (const int veils : {1, 3}) {
    SceneMaker maker;
    const uint32_t veil = maker.masked(maker.bsdf(BsdfKind::diffuse, Rgb(0.0f)), 0.25f);
    const uint32_t rectangle = maker.shape(ShapeKind::rectangle);
    for (int i = 0; i < veils; ++i) {
      // Some show their back sides.
      Affine place = scaling(Vec3(5.0f, i % 2 ? -5.0f : 5.0f, 1.0f));
      if (i % 2) place[2] = -place[2];
      place[3] = Vec3(0, 0, float(i));
      maker.instance(rectangle, veil, place);
    }
    maker.light(EmitterKind::constant, Rgb(2.0f));
    maker.scene.integrator.max_depth = veils + 1;
    maker.scene.camera.to_world = look_at({0.3f, 0, 8}, Vec3(0), {0, 1, 0});
    maker.scene.camera.fov_x_degrees = 10.0f;
    const double expected = 2.0 * std::pow(0.75, veils), deviation = 2.0 / std::sqrt(256.0 * 64.0);
    EXPECT_NEAR(mean(render(maker.scene, options_for(64)).image), expected, 3.0 * deviation) << veils;
    // With one surface less, passing the last veil is cut off.
    maker.scene.integrator.max_depth = veils;
    EXPECT_LT(mean(render(maker.scene, options_for(64)).image), 1e-6) << veils;
  }
}

// Masks block shadow rays completely; paths that pass through find the light instead, on average its whole share.
TEST(Transport, LightThroughAMaskIsFoundByPaths) {
  for (const Method method : {Method::monte_carlo, Method::hybrid}) {
    for (const ShapeKind kind : {ShapeKind::sphere, ShapeKind::disk}) {
      SceneMaker maker = plane_seen_from_above(0.5f);
      const uint32_t black = maker.bsdf(BsdfKind::diffuse, Rgb(0.0f));
      const uint32_t veil = maker.masked(black, 0.3f);
      maker.instance(maker.shape(ShapeKind::rectangle), veil,
                     Affine(Vec3(9, 0, 0), Vec3(0, 9, 0), Vec3(0, 0, 1), Vec3(0, 0, 1)));
      const Affine down(Vec3(1, 0, 0), Vec3(0, -1, 0), Vec3(0, 0, -1), Vec3(0, 0, 2.5f));
      maker.area_light(maker.instance(maker.shape(kind), black, down), Rgb(3.0f));
      maker.scene.integrator.max_depth = 3;  // the floor, the veil, the light
      RenderOptions o = options_for(1024, 2);
      o.method = method;
      const double sin2 = kind == ShapeKind::sphere ? 1.0 / 6.25 : 1.0 / 7.25;
      const double expected = 0.7 * k_albedo * 3.0 * sin2;
      // A path finds the light with chance 0.7 sin2: 512 x 512 of them.
      EXPECT_NEAR(mean(render(maker.scene, o).image), expected, 5.0 * expected / std::sqrt(0.7 * sin2 * 256 * 1024));
    }
  }
}

// A masked surface scatters in proportion to its opacity, by light samples and by paths that find lights, large ones
// too.
TEST(Transport, MaskedSurfacesScatterTheirShare) {
  for (const ShapeKind kind : {ShapeKind::sphere, ShapeKind::disk}) {
    SceneMaker maker = plane_seen_from_above(0.5f);
    const uint32_t black = maker.bsdf(BsdfKind::diffuse, Rgb(0.0f));
    maker.scene.instances[0].bsdf = maker.masked(0, 0.4f);
    const Affine down(Vec3(1, 0, 0), Vec3(0, -1, 0), Vec3(0, 0, -1),
                      Vec3(0, 0, kind == ShapeKind::sphere ? 1.6f : 1.0f));
    maker.area_light(maker.instance(maker.shape(kind), black, down), Rgb(3.0f));
    maker.scene.integrator.max_depth = 3;
    const double sin2 = kind == ShapeKind::sphere ? 1.0 / 2.56 : 0.5, expected = 0.4 * k_albedo * 3.0 * sin2;
    EXPECT_NEAR(mean(render(maker.scene, options_for(256, 1)).image), expected, 0.01 * expected) << int(kind);
  }
}

// All light arrives through a pane of thin glass: what it reflects comes from the same uniform sky.
TEST(Transport, ThinGlassInUniformLightIsInvisible) {
  SceneMaker maker;
  maker.instance(maker.shape(ShapeKind::sphere), maker.bsdf(BsdfKind::thin_dielectric, Rgb(1.0f)), Affine(1.0f));
  maker.light(EmitterKind::constant, Rgb(1.0f));
  maker.scene.integrator.max_depth = -1;
  maker.scene.integrator.rr_depth = 1000;
  maker.scene.camera.to_world = look_at({0, 0, 5}, Vec3(0), {0, 1, 0});
  const Image image = render(maker.scene, options_for(16)).image;
  for (const float v : image.data) ASSERT_NEAR(v, 1.0f, 1e-5f);
}

// A scene with everything in it: textures, glass, metal, several lights.
Scene busy_scene() {
  SceneMaker maker;
  maker.film(70, 45);
  maker.scene.film.filter = FilterKind::gaussian;
  maker.scene.film.filter_radius = 2.0f;
  const uint32_t grey = maker.bsdf(BsdfKind::diffuse, Rgb(0.5f));
  const uint32_t glass = maker.bsdf(BsdfKind::dielectric, Rgb(1.0f));
  const uint32_t metal = maker.bsdf(BsdfKind::rough_conductor, Rgb(0.9f));
  const uint32_t rough_glass = maker.bsdf(BsdfKind::rough_dielectric, Rgb(0.9f));
  const uint32_t veil = maker.masked(maker.bsdf(BsdfKind::rough_plastic, Rgb(0.4f)), 0.5f);
  const uint32_t sphere = maker.shape(ShapeKind::sphere);
  maker.instance(maker.shape(ShapeKind::rectangle), grey, scaling(Vec3(10.0f)));
  maker.instance(sphere, glass, translation({-1.2f, 0, 1}));
  maker.instance(sphere, metal, translation({1.2f, 0, 1}));
  maker.instance(sphere, rough_glass, translation({-3.4f, 0.5f, 1}));
  maker.instance(sphere, veil, translation({3.4f, 0.5f, 1}));
  maker.area_light(maker.instance(sphere, grey, translation({0, 3, 5})), Rgb(6.0f));
  const Affine down(Vec3(1, 0, 0), Vec3(0, -1, 0), Vec3(0, 0, -1), Vec3(-3, 0, 5));
  maker.area_light(maker.instance(maker.shape(ShapeKind::disk), grey, down), Rgb(8.0f));
  maker.light(EmitterKind::constant, Rgb(0.1f));
  maker.scene.camera.to_world = look_at({0, -8, 4}, {0, 0, 1}, {0, 0, 1});
  maker.scene.camera.aperture_radius = 0.05f;
  maker.scene.camera.focus_distance = 8.0f;
  maker.scene.integrator.max_depth = 6;
  maker.scene.integrator.rr_depth = 2;
  return maker.scene;
}

RenderOptions busy_options() {
  RenderOptions o = options_for(3, 5);
  o.lobe_samples = 3;
  o.aovs = {"albedo", "normal", "depth", "position", "visibility", "exact", "object"};
  return o;
}

TEST(Transport, PictureDoesNotDependOnThreads) {
  const Scene scene = busy_scene();
  RenderOptions o = busy_options();
  o.threads = 1;
  const Image one = render(scene, o).image;
  o.threads = 5;
  EXPECT_EQ(one.data, render(scene, o).image.data);
}

TEST(Transport, PictureDoesNotDependOnTheInstructionSet) {
  const Scene scene = busy_scene();
  RenderOptions o = busy_options();
  o.isa = Isa::scalar;
  const Image scalar = render(scene, o).image;
  for (const Isa isa : supported_isas()) {
    o.isa = isa;
    EXPECT_EQ(scalar.data, render(scene, o).image.data) << isa_name(isa);
  }
}

// First hits are kept only for AOVs, and keeping them must not change the picture.
TEST(Transport, PictureDoesNotDependOnItsLayers) {
  Scene scene = busy_scene();
  scene.textures[scene.bsdfs[0].reflectance].kind = TextureKind::checkerboard;
  for (const int max_depth : {1, 2, 6}) {
    scene.integrator.max_depth = max_depth;
    RenderOptions o = busy_options();
    const Image layered = render(scene, o).image;
    o.aovs.clear();
    const Image plain = render(scene, o).image;
    ASSERT_EQ(plain.channel_count(), 3u);
    for (int y = 0; y < plain.height; ++y) {
      for (int x = 0; x < plain.width; ++x) {
        for (size_t c = 0; c < 3; ++c) ASSERT_EQ(plain.pixel(x, y)[c], layered.pixel(x, y)[c]) << x << " " << y;
      }
    }
  }
}

// Batches that hold many pixels, and pixels that span many batches.
TEST(Transport, SamplesArriveInOrderWhateverTheBatches) {
  const Scene scene = busy_scene();
  const Accel accel(scene);
  const CameraSampler camera(scene.camera, scene.film);
  TransportSettings settings;
  settings.max_depth = 2;
  settings.first_hits = true;
  settings.isa = resolve_isa(Isa::automatic);
  const Scene nothing;
  const ShadowAnswerer answerer(nothing, accel, {}, {}, {.isa = settings.isa});
  const TransportContext context(scene, accel, camera, answerer, settings);
  const std::vector<PixelPosition> pixels = {{20, 20}, {35, 22}, {50, 30}};
  constexpr int k_spp = 1700;
  const std::vector<SampleRange> ranges(pixels.size(), {0, k_spp});
  const auto samples_of = [&](int lobe_samples) {
    TransportWorker worker(context);
    std::vector<std::vector<Rgb>> radiance(pixels.size());
    std::vector<float> depths;
    trace_pixels(
        pixels, ranges, {}, lobe_samples, worker, [] { return true; },
        [&](const PixelRun& run, std::span<const Rgb> values, std::span<const FirstHit> firsts) {
          EXPECT_EQ(values.size(), firsts.size());
          radiance[run.pixel].insert(radiance[run.pixel].end(), values.begin(), values.end());
          for (const FirstHit& first : firsts) depths.push_back(first.depth);
        });
    return std::pair(radiance, depths);
  };
  const auto in_large_batches = samples_of(1), in_small_batches = samples_of(100);
  for (const auto& values : in_large_batches.first) EXPECT_EQ(values.size(), size_t(k_spp));
  EXPECT_EQ(in_large_batches.first, in_small_batches.first);
  EXPECT_EQ(in_large_batches.second, in_small_batches.second);
  EXPECT_NE(in_large_batches.first[0], in_large_batches.first[1]);
}

TEST(Transport, CropIsThatPartOfTheWholePicture) {
  const Scene scene = busy_scene();
  RenderOptions o = busy_options();
  const Image whole = render(scene, o).image;
  o.crop = Rect{13, 7, 41, 30};
  const Image part = render(scene, o).image;
  ASSERT_EQ(part.width, 41);
  for (int y = 0; y < part.height; ++y) {
    for (int x = 0; x < part.width; ++x) {
      for (size_t c = 0; c < part.channel_count(); ++c) {
        ASSERT_EQ(part.pixel(x, y)[c], whole.pixel(x + 13, y + 7)[c]) << x << " " << y << " " << part.channels[c];
      }
    }
  }
}

TEST(Transport, SeedChangesThePictureButNotItsMean) {
  const Scene scene = busy_scene();
  RenderOptions o = options_for(32, 2);
  o.seed = 1;
  const Image a = render(scene, o).image;
  o.seed = 2;
  const Image b = render(scene, o).image;
  EXPECT_NE(a.data, b.data);
  // Over seeds the mean's standard deviation is 0.55 % (paths through glass to the lights dominate); the bound is
  // five times that of a difference.
  EXPECT_NEAR(mean(a), mean(b), 0.04 * mean(a));
}

TEST(Transport, ValuesAreFinite) {
  const Image image = render(busy_scene(), busy_options()).image;
  for (const float v : image.data) ASSERT_TRUE(std::isfinite(v));
}

TEST(Transport, DepthLimitsCountLikeMitsubas) {
  SceneMaker maker = plane_seen_from_above(10.0f);
  maker.light(EmitterKind::constant, Rgb(2.0f));
  for (const auto& [depth, expected] : {std::pair(0, 0.0), std::pair(1, 0.0), std::pair(2, 2.0 * k_albedo)}) {
    RenderOptions o = options_for(64, 4);
    o.max_depth = depth;
    EXPECT_NEAR(mean(render(maker.scene, o).image), expected, 5e-3) << depth;
  }
  // Looking away from the plane shows the background itself.
  maker.scene.camera.to_world = look_at({0, 0, 10}, {0, 0, 20}, {0, 1, 0});
  RenderOptions o = options_for(1);
  o.max_depth = 1;
  EXPECT_EQ(mean(render(maker.scene, o).image), 2.0);
  maker.scene.integrator.hide_emitters = true;
  EXPECT_EQ(mean(render(maker.scene, o).image), 0.0);
}

TEST(Transport, HiddenEmittersLetTheCameraThrough) {
  SceneMaker maker = plane_seen_from_above(10.0f);
  Affine place = scaling(Vec3(0.5f));
  place[3] = Vec3(0, 0, 5);
  maker.area_light(maker.instance(maker.shape(ShapeKind::sphere), 0, place), Rgb(2.0f));
  EXPECT_NEAR(mean(render(maker.scene, options_for(1)).image), 2.0, 1e-6);
  maker.scene.integrator.hide_emitters = true;
  RenderOptions o = options_for(4, 4);
  o.aovs = {"depth"};
  const RenderResult r = render(maker.scene, o);
  EXPECT_NEAR(mean(r.image), k_albedo * 2.0 * 0.01, 1e-4);
  EXPECT_NEAR(mean(r.image, channel(r.image, "depth.Z")), 10.0, 1e-4);
}

// What stands before a hidden sky and lets all light through, or some, does not bring it back.
TEST(Transport, HiddenEmittersStayHiddenBehindMasksAndPanes) {
  for (const BsdfKind kind : {BsdfKind::diffuse, BsdfKind::thin_dielectric}) {
    SceneMaker maker;
    maker.scene.camera.to_world = look_at({0, 0, 5}, {0, 0, 0}, {0, 1, 0});
    uint32_t material = maker.bsdf(kind, Rgb(kind == BsdfKind::diffuse ? 0.0f : 1.0f));
    if (kind == BsdfKind::diffuse) material = maker.masked(material, 0.3f);
    maker.instance(maker.shape(ShapeKind::rectangle), material, scaling(Vec3(9.0f)));
    maker.light(EmitterKind::constant, Rgb(1.0f));
    EXPECT_GT(mean(render(maker.scene, options_for(4)).image), 0.5);
    maker.scene.integrator.hide_emitters = true;
    // Panes reflect it, too.
    const double most = kind == BsdfKind::diffuse ? 0.0 : 0.15;
    EXPECT_LE(mean(render(maker.scene, options_for(4)).image), most);
  }
}

TEST(Transport, OutputVariablesDescribeTheFirstHit) {
  SceneMaker maker = plane_seen_from_above(10.0f);
  maker.scene.origin = DVec3(1000.0, 0.0, -5.0);
  maker.light(EmitterKind::point, Rgb(1.0f), {0, 3, 4});
  // A second light, hidden by a disk in between.
  maker.light(EmitterKind::point, Rgb(1.0f), {0, -3, 4});
  Affine place = scaling(Vec3(0.5f));
  place[3] = Vec3(0, -1.5f, 2);
  maker.instance(maker.shape(ShapeKind::disk), 0, place);
  RenderOptions o = options_for(2);
  o.aovs = {"object", "exact", "visibility", "position", "depth", "normal", "albedo"};
  const Image image = render(maker.scene, o).image;
  const auto value = [&](const char* name) { return mean(image, channel(image, name)); };
  EXPECT_EQ(value("object.Y"), 1.0);
  EXPECT_EQ(value("exact.Y"), 0.5);  // nothing can block the first light
  EXPECT_EQ(value("visibility.Y"), 0.5);
  EXPECT_NEAR(value("position.X"), 1000.0, 1e-3);
  EXPECT_NEAR(value("position.Z"), -5.0, 1e-5);
  EXPECT_NEAR(value("depth.Z"), 10.0, 1e-5);
  EXPECT_EQ(value("normal.Z"), 1.0);
  EXPECT_NEAR(value("albedo.G"), k_albedo, 1e-6);
}

TEST(Transport, StopFlagEndsEarly) {
  const Scene scene = busy_scene();
  const std::atomic<bool> stop = true;
  RenderCallbacks callbacks;
  callbacks.stop = &stop;
  const RenderResult r = render(scene, busy_options(), callbacks);
  EXPECT_TRUE(r.interrupted);
  EXPECT_FALSE(r.has_samples);
  for (const float v : r.image.data) ASSERT_EQ(v, 0.0f);
  EXPECT_TRUE(render(scene, busy_options()).has_samples);
}

TEST(Transport, ProgressRisesToOne) {
  float last = 0.0f;
  RenderCallbacks callbacks;
  callbacks.progress = [&](float share, const char*) {
    EXPECT_GE(share, last);
    last = share;
  };
  render(busy_scene(), busy_options(), callbacks);
  EXPECT_EQ(last, 1.0f);
}

TEST(Transport, CountersAndTimesAddUp) {
  const Scene scene = busy_scene();
  const RenderResult r = render(scene, busy_options());
  EXPECT_EQ(r.stats.spp, 3);
  EXPECT_GE(r.stats.rays_primary, uint64_t(70 * 45 * 3));
  // Rays that no object can block are not traced.
  EXPECT_GT(r.stats.rays_exact, 0u);
  EXPECT_LE(r.stats.rays_exact, r.stats.rays_shadow);
  EXPECT_GT(r.stats.rays_glossy, 0u);
  EXPECT_GT(r.stats.time_primary, 0.0);
  EXPECT_GT(r.stats.time_secondary, 0.0);
  EXPECT_LE(r.stats.time_primary + r.stats.time_secondary, r.stats.time_total);
}

TEST(Transport, RefusesWrongOptions) {
  const Scene scene = busy_scene();
  const auto refused = [&](auto&& change) {
    RenderOptions o = options_for(1);
    change(o);
    EXPECT_THROW(render(scene, o), UsageError);
  };
  refused([](RenderOptions& o) { o.spp = -1; });
  refused([](RenderOptions& o) { o.light_samples = 0; });
  refused([](RenderOptions& o) { o.lobe_samples = 0; });
  refused([](RenderOptions& o) { o.threads = -2; });
  refused([](RenderOptions& o) { o.tolerance = 1.5f; });
  refused([](RenderOptions& o) { o.crop = Rect{60, 0, 20, 10}; });
  refused([](RenderOptions& o) { o.crop = Rect{1, 1, std::numeric_limits<int>::max(), 4}; });
  refused([](RenderOptions& o) { o.max_depth = -2; });
  refused([](RenderOptions& o) { o.aovs = {"colour"}; });
}

// Points of a flat lamp may be rounded to its bright side.
TEST(Transport, FlatLampsDoNotLightTheirBacks) {
  TestRandom random(51);
  for (int trial = 0; trial < 40; ++trial) {
    test::SceneMaker s;
    const Vec3 z = random.direction(), x = glm::normalize(glm::cross(z, random.direction())), y = glm::cross(z, x);
    const Vec3 at = random.in_ball() * random.log_uniform(0.1f, 100.0f);
    const uint32_t white = s.bsdf(BsdfKind::diffuse, Rgb(0.9f));
    s.scene.bsdfs[white].two_sided = true;
    const ShapeKind kind = trial % 2 ? ShapeKind::disk : ShapeKind::rectangle;
    s.area_light(s.instance(s.shape(kind), white, Affine(x, y, z, at)), Rgb(10.0f));
    s.scene.camera.to_world = test::look_at(at - z * 3.0f + x * 0.5f, at, y);
    RenderOptions o;
    o.method = trial % 3 ? Method::monte_carlo : Method::hybrid;
    o.max_depth = 3;
    o.spp = 4;
    for (const float v : render(s.scene, o).image.data) ASSERT_EQ(v, 0.0f);
  }
}

}  // namespace
}  // namespace fieldtrace
