// Glossy rays answered by certified hits: whole renders against Monte Carlo, and surfaces near a triangle.

#include "hybrid/hit_answerer.h"

#include <gtest/gtest.h>

#include "core/mesh_procedural.h"
#include "hybrid/compare.h"
#include "hybrid/glossy_stage.h"
#include "hybrid/render.h"
#include "tests/field_checks.h"
#include "tests/random_lines.h"
#include "tests/small_scenes.h"

namespace fieldtrace {
namespace {

using test::SceneMaker;

// A rough metal floor and a rough metal ball under a checkered knot, partly before each other, lit by a lamp and the sky.
SceneMaker reflecting_scene(float alpha, int resolution = 48) {
  SceneMaker m;
  m.film(resolution, resolution);
  m.scene.camera.to_world = test::look_at({3, 3, 5}, {0, 0.5f, 0}, {0, 1, 0});
  m.scene.integrator.max_depth = 3;
  const uint32_t tiles = m.bsdf(BsdfKind::diffuse, Rgb(0.6f));
  Texture& checks = m.scene.textures[m.scene.bsdfs[tiles].reflectance];
  checks.kind = TextureKind::checkerboard;
  checks.color0 = Rgb(0.7f, 0.5f, 0.4f);
  checks.color1 = Rgb(0.3f, 0.4f, 0.5f);
  m.scene.bsdfs[tiles].two_sided = true;
  const uint32_t metal = m.bsdf(BsdfKind::rough_conductor, Rgb(0.9f));
  m.scene.bsdfs[metal].microfacet = MicrofacetKind::ggx;
  m.scene.bsdfs[metal].alpha_u = m.scene.bsdfs[metal].alpha_v = alpha;
  const uint32_t knot = m.mesh(make_knot({.along = 256, .around = 24}));
  m.instance(knot, tiles, test::translation({0, 1.2f, 0}));
  const uint32_t ball = m.mesh(make_sphere({.around = 96, .along = 48}));
  Affine at = test::scaling(Vec3(0.5f));
  at[3] = Vec3(0.9f, 0.6f, 1.2f);
  m.instance(ball, metal, at);
  const Affine floor(Vec3(6, 0, 0), Vec3(0, 0, -6), Vec3(0, 6, 0), Vec3(0));
  m.instance(m.shape(ShapeKind::rectangle), metal, floor);
  const Affine lamp(Vec3(0.4f, 0, 0), Vec3(0, 0.4f, 0), Vec3(0, 0, 0.4f), Vec3(2, 4, 2));
  m.area_light(m.instance(m.shape(ShapeKind::sphere), tiles, lamp), Rgb(60.0f));
  m.light(EmitterKind::constant, Rgb(0.3f));
  return m;
}

RenderOptions options_with(FieldHits hits, int lobe_samples) {
  RenderOptions o;
  o.spp = 1;
  o.light_samples = 4;
  o.lobe_samples = lobe_samples;
  o.seed = 3;
  o.threads = 2;
  o.field_hits = hits;
  return o;
}

TEST(CertifiedHits, AreThoseOfExactRays) {
  for (const float alpha : {0.1f, 0.3f}) {
    const Scene scene = reflecting_scene(alpha).scene;
    RenderOptions o = options_with(FieldHits::always, 16);
    o.check = true;
    const RenderResult fields = render(scene, o), exact = render(scene, options_with(FieldHits::never, 16));
    EXPECT_GT(fields.stats.rays_glossy_hits, fields.stats.rays_glossy / 10) << alpha;
    EXPECT_EQ(exact.stats.rays_glossy_hits, 0u);
    for (const CheckedVerdict verdict : {CheckedVerdict::miss, CheckedVerdict::hit}) {
      for (const int own : {0, 1}) {
        const Stats::CheckCount& c = fields.stats.check_by[int(verdict)][own];
        EXPECT_LE(double(c.wrong), 2 + 0.003 * double(c.answers)) << alpha << " " << int(verdict) << own;
      }
      EXPECT_GT(fields.stats.check_by[int(verdict)][0].answers, 300u) << alpha;
    }
    EXPECT_GT(fields.stats.check_by[int(CheckedVerdict::miss)][1].answers, 300u) << alpha;
    // The same rays, so that there is no noise between the two.
    const ImageDifference d = compare_images(fields.image, exact.image);
    EXPECT_GT(d.rmse, 0.0);
    EXPECT_LE(d.rmse, 0.006) << alpha;
    EXPECT_LE(std::abs(d.bias), 0.001) << alpha;
  }
}

TEST(CertifiedHits, ConvergeToMonteCarlo) {
  const Scene scene = reflecting_scene(0.3f, 32).scene;
  RenderOptions o = options_with(FieldHits::always, 512);
  const Image fields = render(scene, o).image;
  o.method = Method::monte_carlo;
  const ImageDifference d = compare_images(fields, render(scene, o).image);
  EXPECT_LE(d.rmse, 0.006);
  EXPECT_LE(std::abs(d.bias), 0.001);
  EXPECT_LE(d.worst_block_rmse, 0.02);
}

TEST(CertifiedHits, AreTheSameForThreadsInstructionSetsAndCaches) {
  const Scene scene = reflecting_scene(0.3f, 32).scene;
  const test::TemporaryFolder folder;
  RenderOptions o = options_with(FieldHits::always, 4);
  const RenderResult first = render(scene, o);
  EXPECT_GT(first.stats.rays_glossy_hits, 0u);
  const auto expect_same = [&](const RenderOptions& other, const char* what) {
    const RenderResult r = render(scene, other);
    EXPECT_EQ(r.image.data, first.image.data) << what;
    EXPECT_EQ(r.stats.rays_glossy_hits, first.stats.rays_glossy_hits) << what;
    return r.stats;
  };
  o.threads = 1;
  expect_same(o, "one thread");
  for (const Isa isa : supported_isas()) {
    o.isa = isa;
    expect_same(o, isa_name(isa));
  }
  o.isa = Isa::automatic;
  o.field_cache = folder.path();
  expect_same(o, "an empty cache");
  EXPECT_EQ(expect_same(o, "a full cache").bake_rays, 0u);
}

// Near-mirrors: no error is small against such a lobe.
TEST(CertifiedHits, NarrowLobesAreTraced) {
  const Scene scene = reflecting_scene(0.002f, 32).scene;
  RenderOptions o = options_with(FieldHits::always, 4);
  o.check = true;
  const Stats s = render(scene, o).stats;
  EXPECT_EQ(s.check_by[int(CheckedVerdict::hit)][0].answers, 0u);
  EXPECT_GT(s.rays_glossy_exact, 0u);
}

TEST(CertifiedHits, AreNotAskedForBySmallPictures) {
  const Scene scene = reflecting_scene(0.3f, 32).scene;
  const RenderResult automatic = render(scene, options_with(FieldHits::automatic, 4));
  const RenderResult never = render(scene, options_with(FieldHits::never, 4));
  EXPECT_EQ(automatic.stats.rays_glossy_hits, 0u);
  EXPECT_EQ(automatic.stats.bake_rays, never.stats.bake_rays);
  EXPECT_EQ(automatic.image.data, never.image.data);
}

// What the renderer would ask: few samples of a small film, or many of a large one, of meshes of some size.
TEST(CertifiedHits, AreWantedWhereLargeMeshesAreSentManyRays) {
  TransportSettings settings;
  RenderOptions o;
  o.lobe_samples = 64;
  const FieldParameters parameters = {32, 64, 16};
  const auto wanted = [&](int along, uint64_t camera_samples) {
    SceneMaker m = reflecting_scene(0.3f);
    m.scene.shapes[0].mesh = make_knot({.along = along, .around = 32});
    const std::vector<ShapeTraits> traits = {{false, true}, {false, false}, {true, false}, {false, false}};
    return wants_hits(m.scene, traits, settings, o, parameters, camera_samples);
  };
  EXPECT_TRUE(wanted(16384, 2048 * 2048));
  EXPECT_FALSE(wanted(16384, 256 * 256));
  EXPECT_FALSE(wanted(256, 2048 * 2048));
  o.field_hits = FieldHits::never;
  EXPECT_FALSE(wanted(16384, 2048 * 2048));
  o.field_hits = FieldHits::always;
  EXPECT_TRUE(wanted(256, 16));
  settings.max_depth = 2;  // what reflections meet is not lit
  EXPECT_FALSE(wanted(16384, 2048 * 2048));
}

// ---- surface_near

class SurfaceNear : public testing::Test {
 protected:
  static constexpr int k_points = 2000;

  // Of a mesh with texture coordinates under a sheared, mirrored and turned-round transform.
  SurfaceNear() {
    SceneMaker m;
    const uint32_t grey = m.bsdf(BsdfKind::diffuse, Rgb(0.5f));
    const Affine shear(Vec3(2, 0.3f, 0), Vec3(-0.4f, 1, 0.2f), Vec3(0, 0.1f, -1.5f), Vec3(10, -3, 5));
    const uint32_t mesh = m.mesh(make_knot({.along = 64, .around = 12}));
    for (const bool flipped : {false, true}) {
      m.scene.instances[m.instance(mesh, grey, shear)].flip_normals = flipped;
    }
    scene_ = m.scene;
  }

  SurfacePoint exact(uint32_t instance, uint32_t primitive, float u, float v) const {
    RayBatch rays;
    rays.resize(1);
    rays.set(0, Vec3(0.0f), Vec3(0, 0, 1), k_infinity);
    HitBatch hits;
    hits.resize(1);
    hits.instance[0] = instance, hits.primitive[0] = primitive, hits.u[0] = u, hits.v[0] = v, hits.t[0] = 1.0f;
    return surface_at(scene_, rays, hits, 0);
  }

  Scene scene_;
};

TEST_F(SurfaceNear, OnATriangleIsItsOwnSurface) {
  TestRandom random(5);
  for (int k = 0; k < k_points; ++k) {
    const uint32_t instance = uint32_t(k % 2);
    const auto primitive = uint32_t(random.uniform(0.0f, float(scene_.shapes[0].mesh.triangles.size()) - 0.5f));
    const float u = random.uniform(0.0f, 1.0f), v = random.uniform(0.0f, 1.0f - u);
    const SurfacePoint on = exact(instance, primitive, u, v);
    // Whichever side the sheet was seen from.
    const Vec3 seen = k % 4 < 2 ? on.geometric_normal : -on.geometric_normal;
    const SurfacePoint near = surface_near(scene_, instance, primitive, on.position, seen, 0.25f);
    EXPECT_EQ(near.instance, instance);
    EXPECT_EQ(near.primitive, primitive);
    EXPECT_EQ(near.position, on.position);
    EXPECT_EQ(near.geometric_normal, on.geometric_normal);
    EXPECT_NEAR(near.uv.x, on.uv.x, 1e-4f);
    EXPECT_NEAR(near.uv.y, on.uv.y, 1e-4f);
    EXPECT_GE(near.error, 0.25f + 0.99f * on.error);
    EXPECT_LE(near.error, 0.25f + 4.0f * on.error + 1e-6f);
  }
}

// Beside the triangle and off its plane, texture coordinates go on as they do within it.
TEST_F(SurfaceNear, TextureCoordinatesGoOnBesideATriangle) {
  TestRandom random(6);
  for (int k = 0; k < k_points; ++k) {
    const auto primitive = uint32_t(random.uniform(0.0f, float(scene_.shapes[0].mesh.triangles.size()) - 0.5f));
    const float u = random.uniform(-3.0f, 3.0f), v = random.uniform(-3.0f, 3.0f);
    const SurfacePoint on = exact(0, primitive, u, v);
    // Off along the object-space normal, which alone leaves the foot where it was.
    const Vec3 local = transform_point(scene_.instances[0].to_object, on.position);
    const UVec3 t = scene_.shapes[0].mesh.triangles[primitive];
    const auto& p = scene_.shapes[0].mesh.positions;
    const Vec3 n = glm::normalize(glm::cross(p[t.y] - p[t.x], p[t.z] - p[t.x]));
    const Vec3 off = transform_point(scene_.instances[0].to_world, local + n * random.uniform(-0.01f, 0.01f));
    const SurfacePoint near = surface_near(scene_, 0, primitive, off, on.geometric_normal, 0.01f);
    EXPECT_NEAR(near.uv.x, on.uv.x, 2e-3f);
    EXPECT_NEAR(near.uv.y, on.uv.y, 2e-3f);
  }
}

TEST_F(SurfaceNear, IsFiniteAtTrianglesWithoutArea) {
  Scene scene = scene_;
  TriangleMesh& mesh = scene.shapes[0].mesh;
  mesh.triangles[0] = {3, 3, 3};
  mesh.triangles[1] = {3, 4, 3};
  for (const uint32_t primitive : {0u, 1u}) {
    const SurfacePoint near = surface_near(scene, 0, primitive, Vec3(10, -3, 5), Vec3(0, 1, 0), 0.01f);
    EXPECT_TRUE(std::isfinite(near.uv.x) && std::isfinite(near.uv.y) && std::isfinite(near.error)) << primitive;
  }
}

}  // namespace
}  // namespace fieldtrace
