// Light that diffuse objects send on to others, in whole pictures: against Monte Carlo, and the same whatever the
// machine does.

#include <gtest/gtest.h>

#include <cmath>

#include "core/mesh/mesh_procedural.h"
#include "hybrid/render/render.h"
#include "tests/support/image_statistics.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace {
namespace {

using test::look_at;
using test::SceneMaker;

// As far as a film's size tells the number of its rays, maps are worth their making; tests render a window of it.
constexpr int k_film = 2048;

// The film's angle, of which a window in the middle sees this tangent to its sides.
float film_degrees(double tangent, int window) {
  return float(2.0 * std::atan(tangent * k_film / window) * 180.0 / M_PI);
}

// Looks with z up at a film whose window in the middle sees `degrees`.
void set_view(Scene& scene, const Vec3& from, const Vec3& at, double degrees, int window, int depth) {
  scene.camera.to_world = look_at(from, at, {0, 0, 1});
  scene.camera.fov_x_degrees = film_degrees(std::tan(0.5 * degrees * M_PI / 180.0), window);
  scene.integrator.max_depth = depth;
}

Affine placed(const Vec3& x, const Vec3& y, const Vec3& z, const Vec3& at) { return Affine(x, y, z, at); }

// A corner of a floor and two walls, of which one is mirrored, with a turned and mirrored knot and a sphere.
struct Corner : SceneMaker {
  uint32_t grey, red;

  explicit Corner(int window, int depth) {
    film(k_film, k_film);
    set_view(scene, {4.5f, 3.6f, 3.2f}, {-0.4f, -0.4f, 0.7f}, 36.0, window, depth);
    grey = bsdf(BsdfKind::diffuse, Rgb(0.7f));
    red = bsdf(BsdfKind::diffuse, Rgb(0.8f, 0.3f, 0.2f));
    for (const uint32_t b : {grey, red}) scene.bsdfs[b].two_sided = true;
    const uint32_t square = shape(ShapeKind::rectangle);
    instance(square, grey, placed({6, 0, 0}, {0, 6, 0}, {0, 0, 1}, {0, 0, 0}));
    instance(square, grey, placed({2.5f, 0, 0}, {0, 0, 1.5f}, {0, 1, 0}, {0.5f, -2, 1.5f}));
    instance(square, red, placed({0, 2.5f, 0}, {0, 0, 1.5f}, {1, 0, 0}, {-2, 0.5f, 1.5f}));
  }
  void objects() {
    const float c = std::cos(0.6f), s = std::sin(0.6f);
    const uint32_t knot = mesh(make_knot({.along = 192, .around = 16}));
    instance(knot, grey, placed(Vec3(c, s, 0) * 0.8f, Vec3(-s, c, 0) * 0.8f, {0, 0, -0.8f}, {-0.6f, 0.5f, 0.7f}));
    instance(shape(ShapeKind::sphere), red, placed({0.6f, 0, 0}, {0, 0.6f, 0}, {0, 0, 0.6f}, {0.6f, -0.8f, 0.6f}));
  }
};

RenderOptions options_for(const Scene& scene, Method method, int window, int spp) {
  RenderOptions o;
  o.method = method;
  o.spp = spp;
  o.seed = 2;
  o.threads = 2;
  const int margin = (scene.film.width - window) / 2;
  o.crop = Rect{margin, margin, window, window};
  return o;
}

struct Difference {
  double rmse = 0.0, bias = 0.0, worst_block = 0.0, mean = 0.0;
};

// Relative to the mean of `b`; blocks are 8 x 8.
Difference difference(const Image& a, const Image& b) {
  constexpr int k_block = 8;
  Difference d;
  std::vector<double> blocks(size_t(a.width / k_block) * size_t(a.height / k_block));
  for (int y = 0; y < a.height; ++y) {
    for (int x = 0; x < a.width; ++x) {
      for (int c = 0; c < 3; ++c) {
        const double error = double(a.pixel(x, y)[c]) - double(b.pixel(x, y)[c]);
        d.rmse += error * error, d.bias += error, d.mean += double(b.pixel(x, y)[c]);
        blocks[size_t(y / k_block) * size_t(a.width / k_block) + size_t(x / k_block)] += error;
      }
    }
  }
  const double count = 3.0 * a.width * a.height;
  d.mean /= count;
  d.rmse = std::sqrt(d.rmse / count) / d.mean, d.bias /= count * d.mean;
  for (const double sum : blocks) d.worst_block = std::max(d.worst_block, std::abs(sum) / (3 * k_block * k_block));
  d.worst_block /= d.mean;
  return d;
}

// The picture's error is that of the estimate and of Monte Carlo's noise, which is stated.
void expect_near_monte_carlo(const Scene& scene, int window, double rmse, double bias, double block) {
  RenderOptions o = options_for(scene, Method::hybrid, window, 16);
  const RenderResult estimate = render(scene, o);
  o.method = Method::monte_carlo;
  o.spp = 1024;
  o.seed = 7;
  const Difference d = difference(estimate.image, render(scene, o).image);
  EXPECT_LT(d.rmse, rmse);
  EXPECT_LT(std::abs(d.bias), bias);
  EXPECT_LT(d.worst_block, block);
  // All light is in the first surfaces' reads: no path has gone on.
  EXPECT_EQ(estimate.stats.rays_primary, uint64_t(16 * window * window));
}

TEST(IndirectLight, OfOneBounceIsNearMonteCarlo) {
  Corner s(48, 3);
  s.objects();
  s.light(EmitterKind::constant, Rgb(1.0f));
  expect_near_monte_carlo(s.scene, 48, 0.035, 0.008, 0.04);
}

TEST(IndirectLight, OfManyBouncesIsNearMonteCarlo) {
  Corner s(48, -1);
  s.objects();
  s.light(EmitterKind::constant, Rgb(1.0f));
  expect_near_monte_carlo(s.scene, 48, 0.035, 0.01, 0.04);
}

TriangleMesh turned_inside_out(TriangleMesh mesh) {
  for (UVec3& t : mesh.triangles) std::swap(t.y, t.z);
  for (Vec3& n : mesh.normals) n = -n;
  return mesh;
}

// What a closed surface sends to itself does not depend on its winding, and what an open one does not on its sides.
TEST(IndirectLight, OfAnyWindingIsNearMonteCarlo) {
  const TriangleMesh knot = make_knot({.along = 192, .around = 16}),
                     vase = make_hyperboloid({.around = 48, .along = 24});
  for (const TriangleMesh& mesh : {turned_inside_out(knot), vase, turned_inside_out(vase)}) {
    Corner s(48, -1);
    const uint32_t shape = s.mesh(mesh);
    s.instance(shape, s.grey, placed({1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {-0.3f, 0.3f, 0.9f}));
    s.light(EmitterKind::constant, Rgb(1.0f));
    RenderOptions o = options_for(s.scene, Method::hybrid, 48, 64);
    const RenderResult estimate = render(s.scene, o);
    // Maps know a closed surface of any winding; of open ones paths go on.
    const bool is_closed = mesh.triangles.size() == knot.triangles.size();
    EXPECT_EQ(estimate.stats.rays_primary > uint64_t(64 * 48 * 48), !is_closed);
    o.method = Method::monte_carlo;
    o.spp = 1024;
    o.seed = 7;
    const Difference d = difference(estimate.image, render(s.scene, o).image);
    EXPECT_LT(d.rmse, 0.035);
    EXPECT_LT(std::abs(d.bias), 0.01);
    EXPECT_LT(d.worst_block, 0.04);
  }
}

// A floor far wider than what casts the only shadow on it knows its light finely enough there.
TEST(IndirectLight, TablesShadeWideFloors) {
  SceneMaker s;
  s.film(k_film, k_film);
  set_view(s.scene, {2.5f, 2.0f, 1.2f}, {0, 0, 0.4f}, 50.0, 48, 3);
  const uint32_t grey = s.bsdf(BsdfKind::diffuse, Rgb(0.7f)), square = s.shape(ShapeKind::rectangle);
  s.scene.bsdfs[grey].two_sided = true;
  s.instance(square, grey, placed({100, 0, 0}, {0, 100, 0}, {0, 0, 1}, {0, 0, 0}));
  s.instance(square, grey, placed({1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0, 0, 0.6f}));
  s.light(EmitterKind::constant, Rgb(1.0f));
  expect_near_monte_carlo(s.scene, 48, 0.03, 0.004, 0.02);
}

// Parts of a large ground lie before an object and parts behind it: paths answer.
TEST(IndirectLight, OnALargeGroundIsNearMonteCarlo) {
  SceneMaker s;
  s.film(k_film, k_film);
  set_view(s.scene, {13.0f, 4.0f, 3.0f}, {8, 0, 0.8f}, 40.0, 48, 3);
  const uint32_t white = s.bsdf(BsdfKind::diffuse, Rgb(0.8f)), dark = s.bsdf(BsdfKind::diffuse, Rgb(0.05f));
  for (const uint32_t b : {white, dark}) s.scene.bsdfs[b].two_sided = true;
  const uint32_t ball = s.shape(ShapeKind::sphere);
  s.instance(s.shape(ShapeKind::disk), white, placed({20, 0, 0}, {0, 20, 0}, {0, 0, 1}, {0, 0, 0}));
  s.instance(ball, white, placed({0.5f, 0, 0}, {0, 0.5f, 0}, {0, 0, 0.5f}, {8, 0, 1.5f}));
  s.instance(ball, dark, placed({1, 0, 0}, {0, 1, 0}, {0, 0, 0.1f}, {8, 0, 0.7f}));
  s.light(EmitterKind::constant, Rgb(1.0f));
  RenderOptions o = options_for(s.scene, Method::hybrid, 48, 64);
  const RenderResult estimate = render(s.scene, o);
  EXPECT_GT(estimate.stats.bake_rays, 0u);
  EXPECT_GT(estimate.stats.rays_primary, uint64_t(64 * 48 * 48));
  o.method = Method::monte_carlo;
  o.spp = 1024;
  o.seed = 7;
  EXPECT_LT(difference(estimate.image, render(s.scene, o).image).worst_block, 0.06);
}

// Each bounce leaves nearly all: without an end, and with one beyond the bounces that are shaded.
class WhiteRoom : public testing::TestWithParam<int> {};
TEST_P(WhiteRoom, IsNearMonteCarlo) {
  SceneMaker s;
  s.scene.camera.to_world = look_at({0, -1.9f, 1}, {0, 2, 0.8f}, {0, 0, 1});
  s.film(k_film, k_film);
  constexpr int k_window = 32;
  s.scene.camera.fov_x_degrees = film_degrees(0.7, k_window);
  s.scene.integrator.max_depth = GetParam();
  s.scene.integrator.rr_depth = 50;
  const uint32_t white = s.bsdf(BsdfKind::diffuse, Rgb(0.97f));
  s.scene.bsdfs[white].two_sided = true;
  const uint32_t square = s.shape(ShapeKind::rectangle);
  s.instance(square, white, placed({2, 0, 0}, {0, 2, 0}, {0, 0, 1}, {0, 0, 0}));
  for (const float side : {-1.0f, 1.0f}) {
    s.instance(square, white, placed({2, 0, 0}, {0, 0, 1}, {0, 1, 0}, {0, 2 * side, 1}));
    s.instance(square, white, placed({0, 2, 0}, {0, 0, 1}, {1, 0, 0}, {2 * side, 0, 1}));
    s.instance(square, white, placed({0.5f, 0, 0}, {0, 2, 0}, {0, 0, 1}, {1.5f * side, 0, 2}));
  }
  s.light(EmitterKind::constant, Rgb(1.0f));
  RenderOptions o = options_for(s.scene, Method::hybrid, k_window, 16);
  const RenderResult estimate = render(s.scene, o);
  EXPECT_EQ(estimate.stats.rays_primary, uint64_t(16 * k_window * k_window));
  o.method = Method::monte_carlo;
  o.spp = 256;
  const Difference d = difference(estimate.image, render(s.scene, o).image);
  EXPECT_LT(std::abs(d.bias), 0.01);
}

INSTANTIATE_TEST_SUITE_P(Depths, WhiteRoom, testing::Values(-1, 24),
                         [](const auto& depth) { return depth.param < 0 ? "endless" : "deep"; });

// A lamp, a sun and a blue sky together.
TEST(IndirectLight, OfAllLightsIsNearMonteCarlo) {
  Corner s(48, 3);
  s.objects();
  const uint32_t lamp =
      s.instance(s.shape(ShapeKind::sphere), s.grey, placed({0.3f, 0, 0}, {0, 0.3f, 0}, {0, 0, 0.3f}, {1, 1, 3}));
  s.area_light(lamp, Rgb(8.0f, 6.0f, 4.0f));
  s.environment(
      256, 129,
      [](int x, int y) {
        if (std::abs(x - 40) < 2 && std::abs(y - 30) < 2) return Rgb(300.0f);
        return y < 64 ? Rgb(0.3f, 0.4f, 0.6f) : Rgb(0.1f);
      },
      Mat3(Vec3(1, 0, 0), Vec3(0, 0, 1), Vec3(0, -1, 0)));
  expect_near_monte_carlo(s.scene, 48, 0.05, 0.01, 0.05);
}

// Without a sky: lamps alone.
TEST(IndirectLight, OfLampsIsNearMonteCarlo) {
  Corner s(48, -1);
  s.objects();
  const uint32_t lamp = s.instance(s.shape(ShapeKind::rectangle), s.grey,
                                   placed({0.5f, 0, 0}, {0, -0.5f, 0}, {0, 0, -1}, {0.8f, 0.8f, 2.8f}));
  s.area_light(lamp, Rgb(16.0f, 12.0f, 9.0f));
  expect_near_monte_carlo(s.scene, 48, 0.06, 0.01, 0.05);
}

// A floor whose texture changes faster than surfels lie.
TEST(IndirectLight, OfTexturesIsTheirMean) {
  Corner s(48, 3);
  Texture checks;
  checks.kind = TextureKind::checkerboard;
  checks.color0 = Rgb(0.05f), checks.color1 = Rgb(0.95f);
  checks.uv_transform = glm::mat3x2(301.0f, 0.0f, 0.0f, 301.0f, 0.0f, 0.0f);
  s.scene.textures.push_back(checks);
  const uint32_t floor = s.bsdf(BsdfKind::diffuse, Rgb(0.5f));
  s.scene.bsdfs[floor].reflectance = uint32_t(s.scene.textures.size() - 1);
  s.scene.instances[0].bsdf = floor;
  s.objects();
  s.light(EmitterKind::constant, Rgb(1.0f));
  RenderOptions o = options_for(s.scene, Method::hybrid, 48, 16);
  const Image estimate = render(s.scene, o).image;
  o.method = Method::monte_carlo;
  o.spp = 1024;
  const Difference d = difference(estimate, render(s.scene, o).image);
  EXPECT_LT(std::abs(d.bias), 0.01);  // the texture itself aliases from pixel to pixel
}

// Walls that meet at edges leave no gaps to a bright sky.
TEST(IndirectLight, ClosedRoomsAreDark) {
  for (const int depth : {2, -1}) {
    SceneMaker s;
    s.scene.camera.to_world = look_at({1.4f, 1.7f, 0.6f}, {-0.6f, -0.8f, -0.3f}, {0, 0, 1});
    s.scene.camera.fov_x_degrees = 85.0f;
    s.film(64, 64);
    s.scene.integrator.max_depth = depth;
    const uint32_t white = s.bsdf(BsdfKind::diffuse, Rgb(0.8f));
    s.scene.bsdfs[white].two_sided = true;
    const uint32_t square = s.shape(ShapeKind::rectangle);
    for (const float side : {-1.0f, 1.0f}) {
      s.instance(square, white, placed({2, 0, 0}, {0, 3, 0}, {0, 0, 1}, {0, 0, side}));
      s.instance(square, white, placed({2, 0, 0}, {0, 0, 1}, {0, 1, 0}, {0, 3 * side, 0}));
      s.instance(square, white, placed({0, 3, 0}, {0, 0, 1}, {1, 0, 0}, {2 * side, 0, 0}));
    }
    s.light(EmitterKind::constant, Rgb(1.0f));
    RenderOptions o;
    o.method = Method::hybrid;
    o.spp = 16;
    o.directions = 32;
    const RenderResult r = render(s.scene, o);
    ASSERT_GT(r.stats.sky_directions, 0);
    EXPECT_LT(test::mean(r.image), depth == 2 ? 3e-4 : 2e-3);
  }
}

// With cells as fine as usual. `spp`: enough that maps pay.
Difference fine_difference(const Scene& scene, int window, int spp = 64) {
  RenderOptions o = options_for(scene, Method::hybrid, window, spp);
  o.directions = 32;
  const RenderResult estimate = render(scene, o);
  EXPECT_EQ(estimate.stats.rays_primary, uint64_t(spp * window * window));
  o.method = Method::monte_carlo;
  o.spp = 4096;
  o.seed = 7;
  return difference(estimate.image, render(scene, o).image);
}

// Behind the walls of a niche, whose edges meet in most cells, the ground is bright.
TEST(IndirectLight, InANicheIsNearMonteCarlo) {
  SceneMaker s;
  s.film(k_film, k_film);
  const uint32_t white = s.bsdf(BsdfKind::diffuse, Rgb(0.9f)), grey = s.bsdf(BsdfKind::diffuse, Rgb(0.4f));
  for (const uint32_t b : {white, grey}) s.scene.bsdfs[b].two_sided = true;
  const uint32_t square = s.shape(ShapeKind::rectangle);
  s.instance(square, white, placed({4, 0, 0}, {0, 4, 0}, {0, 0, 1}, {0, 0, 0}));
  for (const float side : {-1.0f, 1.0f}) {
    s.instance(square, grey, placed({1.2f, 0, 0}, {0, 0, 1.5f}, {0, 1, 0}, {1.8f * side, 0, 1.5f}));
    s.instance(square, grey, placed({0, 1.0f, 0}, {0, 0, 0.6f}, {1, 0, 0}, {0.6f * side, 1.0f, 1.2f}));
    s.instance(square, grey, placed({0.6f, 0, 0}, {0, 1.0f, 0}, {0, 0, 1}, {0, 1.0f, 1.2f + 0.6f * side}));
  }
  s.instance(square, grey, placed({0.6f, 0, 0}, {0, 0, 0.3f}, {0, 1, 0}, {0, 0, 0.3f}));
  s.instance(square, grey, placed({0.6f, 0, 0}, {0, 0, 0.6f}, {0, 1, 0}, {0, 0, 2.4f}));
  s.instance(square, grey, placed({0.6f, 0, 0}, {0, 0, 0.6f}, {0, 1, 0}, {0, 2.0f, 1.2f}));
  s.light(EmitterKind::constant, Rgb(1.0f));
  for (const int depth : {3, 8}) {
    set_view(s.scene, {0, -2.5f, 1.3f}, {0, 0.5f, 1.2f}, 24.0, 32, depth);
    EXPECT_LT(std::abs(fine_difference(s.scene, 32).bias), depth == 3 ? 0.01 : 0.025);
  }
}

// A panel hides the brightest place of a wall, and the lamp that shines on it.
TEST(IndirectLight, BehindAPanelIsHidden) {
  SceneMaker s;
  s.film(k_film, k_film);
  set_view(s.scene, {0, -5.5f, 1.1f}, {0, 0, 0.9f}, 30.0, 48, 3);
  const uint32_t white = s.bsdf(BsdfKind::diffuse, Rgb(0.7f)), square = s.shape(ShapeKind::rectangle);
  s.scene.bsdfs[white].two_sided = true;
  for (const float side : {-1.0f, 1.0f}) {
    s.instance(square, white, placed({1.5f, 0, 0}, {0, 2, 0}, {0, 0, 1}, {0, 0, 1 + side}));
    s.instance(square, white, placed({0, 2, 0}, {0, 0, 1}, {1, 0, 0}, {1.5f * side, 0, 1}));
  }
  s.instance(square, white, placed({1.5f, 0, 0}, {0, 0, 1}, {0, 1, 0}, {0, 2, 1}));
  s.instance(square, white, placed({0.6f, 0, 0}, {0, 0, 0.6f}, {0, -1, 0}, {0, 1.7f, 1}));
  const uint32_t lamp =
      s.instance(s.shape(ShapeKind::rectangle), white, placed({-0.3f, 0, 0}, {0, 0, 0.3f}, {0, 1, 0}, {0, 1.75f, 1}));
  s.area_light(lamp, Rgb(8.0f));
  const Difference d = fine_difference(s.scene, 48, 256);
  EXPECT_LT(std::abs(d.bias), 0.008);
  EXPECT_LT(d.worst_block, 0.03);
}

// Maps know objects from without: a room that is one mesh, and what stands in another object, is left to paths.
TEST(IndirectLight, WithinOtherObjectsIsMonteCarlos) {
  constexpr int k_window = 24;
  for (const bool is_room : {true, false}) {
    SceneMaker s;
    s.film(k_film, k_film);
    s.scene.camera.fov_x_degrees = film_degrees(0.7, k_window);
    s.scene.integrator.max_depth = -1;
    const uint32_t grey = s.bsdf(BsdfKind::diffuse, Rgb(0.7f)), red = s.bsdf(BsdfKind::diffuse, Rgb(0.8f, 0.2f, 0.2f));
    s.scene.bsdfs[grey].two_sided = true;
    const uint32_t square = s.shape(ShapeKind::rectangle), ball = s.shape(ShapeKind::sphere);
    if (is_room) {
      s.scene.camera.to_world = look_at({0, -1.9f, 0.3f}, {0, 0, -1.2f}, {0, 0, 1});
      s.instance(s.mesh(make_cube({.half_size = 2.0f})), grey, Affine(1.0f));
      s.area_light(s.instance(square, grey, placed({0.5f, 0, 0}, {0, -0.5f, 0}, {0, 0, -1}, {0, 0, 1.95f})),
                   Rgb(10.0f));
      s.instance(ball, red, placed({0.6f, 0, 0}, {0, 0.6f, 0}, {0, 0, 0.6f}, {0, 0, -1.4f}));
    } else {
      s.scene.camera.to_world = look_at({0, -6, 3}, {0, 0, 0.6f}, {0, 0, 1});
      s.instance(square, grey, test::scaling(Vec3(4.0f)));
      s.instance(ball, red, placed({0.5f, 0, 0}, {0, 0.5f, 0}, {0, 0, 0.5f}, {0, 0, 0.85f}));
      const uint32_t glass = s.bsdf(BsdfKind::dielectric, Rgb(1.0f));
      s.instance(ball, glass, placed({0.8f, 0, 0}, {0, 0.8f, 0}, {0, 0, 0.8f}, {0, 0, 0.85f}));
      for (const float x : {-1.8f, 1.8f})
        s.instance(ball, grey, placed({0.6f, 0, 0}, {0, 0.6f, 0}, {0, 0, 0.6f}, {x, 0, 0.6f}));
      s.light(EmitterKind::constant, Rgb(1.0f));
    }
    RenderOptions o = options_for(s.scene, Method::hybrid, k_window, 64);
    const Image estimate = render(s.scene, o).image;
    o.method = Method::monte_carlo;
    o.spp = 256;
    const Difference d = difference(estimate, render(s.scene, o).image);
    EXPECT_LT(std::abs(d.bias), 0.01) << is_room;
  }
}

// How far the wall of a tube is its centre does not tell: a floor beyond it, and balls beside it, would be seen from a
// small ball within. All is left to paths.
TEST(IndirectLight, WithinATubeIsLeftToPaths) {
  constexpr int k_window = 24, k_spp = 16;
  SceneMaker s;
  s.film(k_film, k_film);
  set_view(s.scene, {-10.6f, 0, 0.3f}, {-8, 0.1f, -0.1f}, 24.0, k_window, 4);
  const uint32_t grey = s.bsdf(BsdfKind::diffuse, Rgb(0.7f));
  s.scene.bsdfs[grey].two_sided = true;
  const uint32_t ball = s.shape(ShapeKind::sphere);
  s.instance(s.shape(ShapeKind::cylinder), grey, placed({0, 0, 1}, {0, 1, 0}, {20, 0, 0}, {-10, 0, 0}));
  s.instance(ball, grey, placed({0.4f, 0, 0}, {0, 0.4f, 0}, {0, 0, 0.4f}, {-8.3f, 0.2f, -0.2f}));
  for (const float y : {-2.3f, 2.3f})
    s.instance(ball, grey, placed({1.2f, 0, 0}, {0, 1.2f, 0}, {0, 0, 1.2f}, {-6.2f, y, 0.3f}));
  s.instance(s.shape(ShapeKind::rectangle), grey, placed({30, 0, 0}, {0, 30, 0}, {0, 0, 1}, {0, 0, -3}));
  s.light(EmitterKind::constant, Rgb(1.0f));
  RenderOptions o = options_for(s.scene, Method::hybrid, k_window, k_spp);
  o.directions = 32;
  const Stats by_maps = render(s.scene, o).stats;
  EXPECT_GT(by_maps.sky_objects, 0u);
  o.method = Method::monte_carlo;
  EXPECT_EQ(by_maps.rays_primary, render(s.scene, o).stats.rays_primary);
}

// Of a heap of two that overlap beside a third, the third and the floor send by maps, and the picture is Monte Carlo's.
TEST(IndirectLight, BesideAHeapIsKnown) {
  constexpr int k_window = 32, k_spp = 64;
  uint64_t rays[2];
  for (const bool overlaps : {false, true}) {
    SceneMaker s;
    s.film(k_film, k_film);
    set_view(s.scene, {0, -7, 3}, {0, 0, 0.6f}, 30.0, k_window, 4);
    const uint32_t grey = s.bsdf(BsdfKind::diffuse, Rgb(0.7f)), red = s.bsdf(BsdfKind::diffuse, Rgb(0.8f, 0.2f, 0.2f));
    const uint32_t square = s.shape(ShapeKind::rectangle), ball = s.shape(ShapeKind::sphere);
    s.instance(square, grey, test::scaling(Vec3(6.0f)));
    s.instance(ball, grey, placed({0.6f, 0, 0}, {0, 0.6f, 0}, {0, 0, 0.6f}, {1.4f, 0, 0.6f}));
    s.instance(ball, red, placed({0.6f, 0, 0}, {0, 0.6f, 0}, {0, 0, 0.6f}, {-0.6f, 0, 0.6f}));
    s.instance(ball, red, placed({0.5f, 0, 0}, {0, 0.5f, 0}, {0, 0, 0.5f}, {overlaps ? -0.3f : -2.0f, 0, 0.9f}));
    s.light(EmitterKind::constant, Rgb(1.0f));
    RenderOptions o = options_for(s.scene, Method::hybrid, k_window, k_spp);
    o.directions = 32;
    const RenderResult estimate = render(s.scene, o);
    rays[overlaps] = estimate.stats.rays_primary;
    o.method = Method::monte_carlo;
    o.spp = 1024;
    const Difference d = difference(estimate.image, render(s.scene, o).image);
    EXPECT_LT(std::abs(d.bias), 0.005 * d.mean) << overlaps;
    EXPECT_LT(d.worst_block, 0.03 * d.mean) << overlaps;
  }
  const auto camera_rays = uint64_t(k_spp * k_window * k_window);
  EXPECT_EQ(rays[false], camera_rays);
  EXPECT_GT(rays[true], camera_rays);      // paths to the heap go on
  EXPECT_LT(rays[true], 2 * camera_rays);  // and no others
}

TEST(IndirectLight, DoesNotDependOnTheMachineOrTheWindow) {
  Corner s(32, 4);
  s.objects();
  s.light(EmitterKind::constant, Rgb(1.0f));
  RenderOptions o = options_for(s.scene, Method::hybrid, 32, 4);
  const Image expected = render(s.scene, o).image;
  o.threads = 1;
  EXPECT_EQ(render(s.scene, o).image.data, expected.data);
  for (const Isa isa : supported_isas()) {
    o.isa = isa;
    EXPECT_EQ(render(s.scene, o).image.data, expected.data) << isa_name(isa);
  }
  o.crop = Rect{o.crop->x + 9, o.crop->y + 13, 11, 7};
  const Image part = render(s.scene, o).image;
  for (int y = 0; y < part.height; ++y) {
    for (int x = 0; x < part.width; ++x) {
      for (int c = 0; c < 3; ++c) EXPECT_EQ(part.pixel(x, y)[c], expected.pixel(x + 9, y + 13)[c]);
    }
  }
}

// Paths find what is not diffuse, and nothing else twice or never.
class IndirectLightBeside : public testing::TestWithParam<BsdfKind> {};

TEST_P(IndirectLightBeside, OthersIsNearMonteCarlo) {
  for (const int depth : {3, 5, -1}) {
    Corner s(32, depth);
    s.objects();
    const bool is_metal = GetParam() == BsdfKind::rough_conductor;
    s.scene.instances.back().bsdf = is_metal ? s.metal(0.3f) : s.bsdf(GetParam(), Rgb(0.6f));
    s.light(EmitterKind::constant, Rgb(1.0f));
    RenderOptions o = options_for(s.scene, Method::hybrid, 32, 256);
    const RenderResult estimate = render(s.scene, o);
    o.method = Method::monte_carlo;
    o.spp = 1024;
    o.seed = 7;
    const RenderResult exact = render(s.scene, o);
    const Difference d = difference(estimate.image, exact.image);
    EXPECT_LT(std::abs(d.bias), 0.006);
    EXPECT_LT(d.rmse, 0.03);
    EXPECT_LT(d.worst_block, 0.03);
    // Few paths go on.
    EXPECT_LT(double(estimate.stats.rays_primary) / 256.0, 0.7 * double(exact.stats.rays_primary) / 1024.0);
  }
}

INSTANTIATE_TEST_SUITE_P(Kinds, IndirectLightBeside,
                         testing::Values(BsdfKind::rough_conductor, BsdfKind::plastic, BsdfKind::rough_plastic),
                         [](const auto& kind) {
                           return kind.param == BsdfKind::plastic         ? "plastics"
                                  : kind.param == BsdfKind::rough_plastic ? "rough_plastics"
                                                                          : "metals";
                         });

// Of so many samples of a scene whose light maps send on, from Monte Carlo.
Difference difference_by_maps(const Scene& scene, int window, int samples, int samples_of_monte_carlo) {
  RenderOptions o = options_for(scene, Method::hybrid, window, samples);
  o.directions = 32;  // whatever they gain
  o.check = true;
  const RenderResult estimate = render(scene, o);
  EXPECT_GT(estimate.stats.checked(CheckedEstimate::surfels).compared, 0u);
  o.check = false;
  o.method = Method::monte_carlo;
  o.spp = samples_of_monte_carlo;
  return difference(estimate.image, render(scene, o).image);
}

// A room behind a pane: what comes by way of glass takes an edge more of a path than a bounce.
TEST(IndirectLight, OfLimitedPathsThroughGlassHasMonteCarlosMean) {
  constexpr int k_window = 24;
  for (const int depth : {4, 5, -1}) {
    SCOPED_TRACE(depth);
    SceneMaker s;
    s.scene.camera.to_world = look_at({-1.9f, 0.3f, 1.6f}, {2, 0, 1.2f}, {0, 0, 1});
    s.film(k_film, k_film);
    s.scene.camera.fov_x_degrees = film_degrees(0.7, k_window);
    s.scene.integrator.max_depth = depth;
    s.scene.integrator.rr_depth = 50;
    const uint32_t white = s.bsdf(BsdfKind::diffuse, Rgb(0.8f));
    s.scene.bsdfs[white].two_sided = true;
    const uint32_t square = s.shape(ShapeKind::rectangle);
    const auto wall = [&](uint32_t bsdf, const Vec3& x, const Vec3& y, const Vec3& at) {
      s.instance(square, bsdf, placed(x, y, glm::normalize(glm::cross(x, y)), at));
    };
    for (const float z : {0.0f, 3.0f}) wall(white, {2, 0, 0}, {0, 2, 0}, {0, 0, z});
    // One side is open: rooms that see less of the sky are left to rays.
    wall(white, {2, 0, 0}, {0, 0, 1.5f}, {0, 2, 1.5f});
    wall(white, {0, 2, 0}, {0, 0, 1.5f}, {-2, 0, 1.5f});
    // The last wall has a window of 1.5 x 1.5.
    for (const float z : {0.375f, 2.625f}) wall(white, {0, 2, 0}, {0, 0, 0.375f}, {2, 0, z});
    for (const float y : {-1.375f, 1.375f}) wall(white, {0, 0.625f, 0}, {0, 0, 0.75f}, {2, y, 1.5f});
    wall(s.bsdf(BsdfKind::thin_dielectric, Rgb(1.0f)), {0, 0.75f, 0}, {0, 0, 0.75f}, {2, 0, 1.5f});
    s.light(EmitterKind::constant, Rgb(1.0f));
    EXPECT_LT(std::abs(difference_by_maps(s.scene, k_window, 64, 512).bias), 0.02);
  }
}

// The back of a one-sided wall, between which and the camera a pane stands, which surfels send paths through.
TEST(IndirectLight, BackSidesOfOneSidedSurfacesSendNothing) {
  constexpr int k_window = 24;
  SceneMaker s;
  s.scene.camera.to_world = look_at({0.75f, -8, 2}, {0.75f, 0, 0}, {0, 0, 1});
  s.film(k_film, k_film);
  s.scene.camera.fov_x_degrees = film_degrees(0.04, k_window);
  s.scene.integrator.max_depth = -1;
  const uint32_t grey = s.bsdf(BsdfKind::diffuse, Rgb(0.8f));
  s.scene.bsdfs[grey].two_sided = true;
  const uint32_t square = s.shape(ShapeKind::rectangle);
  s.instance(square, grey, placed({4, 0, 0}, {0, 4, 0}, {0, 0, 1}, {0, 0, 0}));
  s.instance(square, s.bsdf(BsdfKind::diffuse, Rgb(0.8f)),
             placed({0, 0, 1.5f}, {0, 1.5f, 0}, {-1, 0, 0}, {0, 0, 1.5f}));
  s.instance(square, s.bsdf(BsdfKind::thin_dielectric, Rgb(1.0f)),
             placed({0, 0, 3}, {0, 3, 0}, {-1, 0, 0}, {1.5f, 0, 3}));
  const uint32_t cube = s.mesh(make_cube({}));
  for (const float x : {-4.0f, 5.0f}) {
    for (const float y : {-5.0f, 5.0f})
      s.instance(cube, grey, placed({0.3f, 0, 0}, {0, 0.3f, 0}, {0, 0, 0.3f}, {x, y, 0.3f}));
  }
  s.light(EmitterKind::constant, Rgb(1.0f));
  const Difference d = difference_by_maps(s.scene, k_window, 256, 2048);
  EXPECT_LT(std::abs(d.bias), 0.02);
  EXPECT_LT(d.worst_block, 0.05);
}

// It can be hit, but there is nothing to be found.
TEST(IndirectLight, ABlackLampChangesNothing) {
  Corner s(32, 5);
  s.objects();
  s.light(EmitterKind::constant, Rgb(1.0f));
  const uint32_t lamp =
      s.instance(s.shape(ShapeKind::cylinder), s.grey, placed({0.1f, 0, 0}, {0, 0.1f, 0}, {0, 0, 0.1f}, {1, 1, 3}));
  s.area_light(lamp, Rgb(0.0f));
  RenderOptions o = options_for(s.scene, Method::hybrid, 32, 16);
  o.check = true;
  EXPECT_GT(render(s.scene, o).stats.checked(CheckedEstimate::surfels).compared, 0u);
  s.scene.emitters.back().value = Rgb(1.0f);
  EXPECT_EQ(render(s.scene, o).stats.checked(CheckedEstimate::surfels).compared, 0u);
}

TEST(IndirectLight, IsPathsAtToleranceZero) {
  Corner s(16, 3);
  s.objects();
  s.light(EmitterKind::constant, Rgb(1.0f));
  RenderOptions o = options_for(s.scene, Method::hybrid, 16, 4);
  o.tolerance = 0.0f;
  const Image estimate = render(s.scene, o).image;
  o.method = Method::monte_carlo;
  EXPECT_EQ(render(s.scene, o).image.data, estimate.data);
}

// What --check says of estimates.
TEST(IndirectLight, IsComparedWithRaysWithoutASky) {
  Corner s(32, 3);
  s.objects();
  const uint32_t lamp = s.instance(s.shape(ShapeKind::sphere), s.grey,
                                   placed({0.3f, 0, 0}, {0, 0.3f, 0}, {0, 0, 0.3f}, {2.0f, 2.0f, 3.0f}));
  s.area_light(lamp, Rgb(20.0f));
  RenderOptions o = options_for(s.scene, Method::hybrid, 32, 16);
  o.check = true;
  const Stats stats = render(s.scene, o).stats;
  EXPECT_GT(stats.checked(CheckedEstimate::indirect).compared, 0u);
  EXPECT_EQ(stats.checked(CheckedEstimate::arriving).compared, 0u);
}

// As without bounces: one sample's noise hides what the least maps err by.
TEST(IndirectLight, OfOneSampleHasTheLeastMaps) {
  Corner s(512, 3);
  s.objects();
  s.light(EmitterKind::constant, Rgb(1.0f));
  const auto directions = [&](int spp) {
    RenderOptions o = options_for(s.scene, Method::hybrid, 512, spp);
    o.crop = Rect{200, 200, 8, 8};
    const Stats stats = render(s.scene, o).stats;
    EXPECT_GT(stats.bake_rays, 0u);
    return stats.sky_directions;
  };
  EXPECT_EQ(directions(1), 8);
  EXPECT_EQ(directions(4), 16);
  EXPECT_EQ(directions(64), 32);
}

TEST(IndirectLight, IsComparedWithRays) {
  Corner s(96, 4);
  s.objects();
  s.light(EmitterKind::constant, Rgb(1.0f));
  RenderOptions o = options_for(s.scene, Method::hybrid, 96, 16);
  o.check = true;
  const Stats stats = render(s.scene, o).stats;
  ASSERT_GT(stats.checked(CheckedEstimate::indirect).compared, 5u);
  EXPECT_GT(stats.checked(CheckedEstimate::indirect).mean_difference(), 0.0);
  EXPECT_LT(stats.checked(CheckedEstimate::indirect).mean_difference(), 0.02);
  ASSERT_GT(stats.checked(CheckedEstimate::arriving).compared, 5u);
  EXPECT_GT(stats.checked(CheckedEstimate::arriving).mean_difference(), 0.0);
  EXPECT_LT(stats.checked(CheckedEstimate::arriving).mean_difference(), 0.03);
  EXPECT_LT(std::abs(stats.checked(CheckedEstimate::arriving).bias()), 0.01);
  ASSERT_GT(stats.checked(CheckedEstimate::fitted).compared, 10u);
  EXPECT_LT(stats.checked(CheckedEstimate::fitted).mean_difference(), 0.005);
  EXPECT_LT(std::abs(stats.checked(CheckedEstimate::fitted).bias()), 0.002);
  ASSERT_GT(stats.checked(CheckedEstimate::surfels).compared, 10u);
  EXPECT_GT(stats.checked(CheckedEstimate::surfels).mean_difference(), 0.0);
  EXPECT_LT(std::abs(stats.checked(CheckedEstimate::surfels).bias()), 0.02);
}

}  // namespace
}  // namespace fieldtrace
