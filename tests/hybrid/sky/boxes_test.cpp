// Meshes that are boxes hide direction cells exactly, and send light on from their faces.

#include <gtest/gtest.h>

#include <cmath>

#include "core/mesh/mesh_procedural.h"
#include "hybrid/render/render.h"
#include "hybrid/sky/cell_occluders.h"
#include "hybrid/sky/parallelogram.h"
#include "tests/support/random_lines.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace {
namespace {

using namespace test;

bool is_box(const TriangleMesh& mesh) {
  SceneMaker s;
  s.mesh(mesh);
  return box_faces(s.scene.shapes[0], shape_traits(s.scene)[0]).has_value();
}

TEST(Boxes, AreMeshesThatFillTheirBounds) {
  const TriangleMesh cube = make_cube({.half_size = 0.7f});
  EXPECT_TRUE(is_box(cube));
  TriangleMesh stretched = cube;
  for (Vec3& p : stretched.positions) p = p * Vec3(1.0f, 20.0f, 0.01f) + Vec3(3.0f, -100.0f, 0.3f);
  EXPECT_TRUE(is_box(stretched));
  TriangleMesh open = cube;
  open.triangles.pop_back();
  EXPECT_FALSE(is_box(open));
  TriangleMesh twice = cube;  // as large as a box, with a hole
  twice.triangles.back() = twice.triangles[twice.triangles.size() - 2];
  EXPECT_FALSE(is_box(twice));
  TriangleMesh dented = cube;
  dented.positions[0] *= 0.99f;
  EXPECT_FALSE(is_box(dented));
  TriangleMesh smooth = cube;
  smooth.normals.clear();
  for (const Vec3& p : smooth.positions) smooth.normals.push_back(glm::normalize(p));
  EXPECT_FALSE(is_box(smooth));
  TriangleMesh turned = cube;
  for (Vec3& p : turned.positions) p = {0.8f * p.x - 0.6f * p.y, 0.6f * p.x + 0.8f * p.y, p.z};
  EXPECT_FALSE(is_box(turned));
  EXPECT_FALSE(is_box(make_plane({})));
  EXPECT_FALSE(is_box(make_sphere()));
}

// The faces' half axes and normals, where the shape's triangles are.
TEST(Boxes, HaveFacesThatLookOutwards) {
  TriangleMesh mesh = make_cube({.half_size = 0.5f});
  for (Vec3& p : mesh.positions) p = p * Vec3(1.0f, 2.0f, 4.0f) + Vec3(5.0f, 6.0f, 7.0f);
  SceneMaker s;
  s.mesh(mesh);
  const auto faces = box_faces(s.scene.shapes[0], shape_traits(s.scene)[0]);
  ASSERT_TRUE(faces);
  const DVec3 centre(5.0, 6.0, 7.0), half(0.5, 1.0, 2.0);
  for (size_t f = 0; f < 6; ++f) {
    const Parallelogram& face = (*faces)[f];
    const DVec3 out = face.centre - centre;
    EXPECT_NEAR(glm::length(out), half[int(f / 2)], 1e-6);
    EXPECT_NEAR(glm::dot(out, face.axes[2]), glm::length(out), 1e-6);
    for (int a = 0; a < 2; ++a) EXPECT_NEAR(glm::dot(face.axes[a], out), 0.0, 1e-6);
  }
}

TEST(Boxes, AreNoneWithSomethingWithin) {
  const auto boxes = [](const Vec3& camera, const Vec3& other, int copies) {
    SceneMaker s;
    s.scene.camera.to_world = look_at(camera, {0, 0, 0.5f}, {0, 0, 1});
    const uint32_t grey = s.bsdf(BsdfKind::diffuse, Rgb(0.5f)), cube = s.mesh(make_cube({.half_size = 1.0f}));
    s.instance(cube, grey, scaling(Vec3(2.0f)));
    for (int i = 0; i < copies; ++i) s.instance(s.mesh(make_sphere()), grey, translation(other));
    return plane_shapes(s.scene, shape_traits(s.scene)).boxes[cube].has_value();
  };
  EXPECT_TRUE(boxes({5, 0, 0}, {0, 2.1f, 0}, 1));
  EXPECT_FALSE(boxes({1.5f, 0, 0}, {0, 2.1f, 0}, 1));
  EXPECT_FALSE(boxes({5, 0, 0}, {0, 1.9f, 0}, 1));
  EXPECT_FALSE(boxes({5, 0, 0}, {0, 2.1f, 0}, int(k_crowd)));  // a crowd
}

double rms_of_blocks(const Image& a, const Image& b, double& bias, double& worst) {
  constexpr int k_block = 8;
  double sum = 0.0, mean = 0.0, error = 0.0;
  worst = 0.0;
  for (int y = 0; y < a.height; y += k_block) {
    for (int x = 0; x < a.width; x += k_block) {
      double block = 0.0;
      for (int i = 0; i < k_block * k_block; ++i) {
        const auto luminance_at = [&](const Image& image) {
          const float* p = image.pixel(x + i % k_block, y + i / k_block);
          return double(luminance({p[0], p[1], p[2]}));
        };
        block += luminance_at(a) - luminance_at(b), mean += luminance_at(b);
      }
      error += block, block /= k_block * k_block;
      sum += block * block, worst = std::max(worst, std::abs(block));
    }
  }
  const double pixels = double(a.width) * a.height, blocks = pixels / (k_block * k_block);
  mean /= pixels;
  bias = error / pixels / mean, worst /= mean;
  return std::sqrt(sum / blocks) / mean;
}

// Turned, sheared, squashed and mirrored boxes on a floor: thin ones, one on another, and one against another's side.
struct Blocks : SceneMaker {
  static constexpr int k_size = 64;
  explicit Blocks(uint32_t seed) {
    TestRandom random(seed);
    film(k_size, k_size);
    scene.camera.to_world = look_at({4.5f, -5.0f, 4.0f}, {0, 0, 0.6f}, {0, 0, 1});
    scene.camera.fov_x_degrees = 45.0f;
    const uint32_t grey = bsdf(BsdfKind::diffuse, Rgb(0.7f)), red = bsdf(BsdfKind::diffuse, Rgb(0.8f, 0.3f, 0.2f));
    instance(shape(ShapeKind::rectangle), grey, scaling(Vec3(6.0f)));
    const uint32_t cube = mesh(make_cube({.half_size = 1.0f}));
    const float turn = random.uniform(0.0f, 6.0f), c = std::cos(turn), s = std::sin(turn);
    const Vec3 x(c, s, 0), y(-s, c, 0), z(0, 0, 1);
    const float shear = random.uniform(-1.5f, 1.5f);
    instance(cube, grey, Affine(x, 0.08f * y, z + shear * x, {0, 0, 1}));                      // a thin wall, aslant
    instance(cube, red, Affine(0.5f * x, -0.4f * y, 0.4f * z, 0.48f * y + Vec3(0, 0, 0.4f)));  // against it, mirrored
    instance(cube, grey, Affine(0.3f * y, 0.3f * x, 0.2f * z, 0.5f * y + Vec3(0, 0, 1.0f)));   // on that
    instance(cube, red, Affine(0.6f * x, 0.5f * y, 0.3f * z, -1.3f * y + Vec3(0, 0, 0.9f)));   // in the air
    light(EmitterKind::constant, Rgb(1.0f));
  }
};

void expect_near_monte_carlo(const Scene& scene, int depth) {
  RenderOptions o;
  o.threads = 2, o.seed = 2;
  o.max_depth = depth;
  o.method = Method::hybrid;
  o.directions = 32;
  o.spp = 16;
  const RenderResult found = render(scene, o);
  EXPECT_EQ(found.stats.sky_objects, 0u);  // no maps
  EXPECT_EQ(found.stats.sky_directions, 32);
  RenderOptions exact;
  exact.threads = 2, exact.seed = 7;
  exact.max_depth = depth;
  exact.method = Method::monte_carlo;
  exact.spp = 512;
  double bias = 0.0, worst = 0.0;
  const double rms = rms_of_blocks(found.image, render(scene, exact).image, bias, worst);
  // What faces send on is known by texels.
  const bool alone = depth == 2;
  EXPECT_LT(rms, alone ? 0.002 : 0.005);
  EXPECT_LT(std::abs(bias), 0.001);
  EXPECT_LT(worst, alone ? 0.008 : 0.02);
}

// The top of one goes on within the other's, at the same height; a floor goes on beneath both.
TEST(Boxes, WithFlushFacesAreNearMonteCarlo) {
  Blocks s(4);
  s.scene.instances.resize(2);
  const uint32_t cube = s.scene.instances[1].shape, grey = s.scene.instances[1].bsdf;
  s.scene.instances.pop_back();
  s.instance(cube, grey, Affine({1.5f, 0, 0}, {0, 0.5f, 0}, {0, 0, 0.5f}, {0, -0.5f, 0.5f}));
  s.instance(cube, grey, Affine({0.5f, 0, 0}, {0, 1.5f, 0}, {0, 0, 0.5f}, {1.0f, 0.6f, 0.5f}));
  expect_near_monte_carlo(s.scene, 2);
  expect_near_monte_carlo(s.scene, 3);
}

// Nothing is known of what lies within.
TEST(Boxes, AreDarkWithin) {
  SceneMaker s;
  s.film(16, 16);
  s.scene.camera.to_world = look_at({4, -5, 4}, {0, 0, 0}, {0, 0, 1});
  const uint32_t grey = s.bsdf(BsdfKind::diffuse, Rgb(0.5f));
  s.instance(s.mesh(make_cube({.half_size = 1.0f})), grey, Affine(1.0f));
  s.light(EmitterKind::constant, Rgb(1.0f));
  const Accel accel(s.scene);
  const std::vector<ShapeTraits> traits = shape_traits(s.scene);
  const SkyMaps maps(s.scene, traits, mapped_shapes(s.scene, traits), {}, 16, {});
  ASSERT_EQ(maps.occluders()[0].kind, SkyOccluder::Kind::box);
  const Sky sky(maps, SkyRadiance(s.scene));
  for (const float side : {1.0f, -1.0f}) {  // on its top, outside and within
    ShadingPointBatch points;
    points.resize(1);
    points.size = 1;
    points.px[0] = 0.3f, points.py[0] = -0.2f, points.pz[0] = 1.0f;
    points.gz[0] = points.sz[0] = side;
    CellOccluders occluders;
    occluders.find(sky, points, maps.place(0, points.position(0)));
    size_t clear = 0;
    for (size_t k = 0; k < occluders.cells().size(); ++k) clear += occluders.is_clear(k);
    EXPECT_EQ(clear, side > 0.0f ? occluders.cells().size() : 0u);
  }
}

TEST(Boxes, AreNearMonteCarlo) {
  for (const uint32_t seed : {1u, 2u, 3u}) {
    for (const int depth : {2, 3, 6}) {
      SCOPED_TRACE(testing::Message() << "seed " << seed << " depth " << depth);
      expect_near_monte_carlo(Blocks(seed).scene, depth);
    }
  }
}

}  // namespace
}  // namespace fieldtrace
