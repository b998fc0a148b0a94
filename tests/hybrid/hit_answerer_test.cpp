// Glossy rays answered by certified hits: whole renders against Monte Carlo, and surface_near().

#include "hybrid/glossy/hit_answerer.h"

#include <gtest/gtest.h>

#include "core/mesh/mesh_procedural.h"
#include "hybrid/compare/compare.h"
#include "hybrid/render/glossy_stage.h"
#include "hybrid/render/render.h"
#include "tests/support/field_checks.h"
#include "tests/support/random_lines.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace {
namespace {

using test::SceneMaker;

// A rough metal floor under a checkered knot and a rough metal ball that cuts it, lit by a lamp and the sky.
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
  const uint32_t metal = m.metal(alpha);
  const uint32_t knot = m.mesh(make_knot({.along = 256, .around = 24}));
  m.instance(knot, tiles, test::translation({0, 1.2f, 0}));
  const uint32_t ball = m.mesh(make_sphere({.around = 96, .along = 48}));
  Affine at = test::scaling(Vec3(0.5f));
  at[3] = Vec3(0.5f, 0.8f, 0.6f);
  m.instance(ball, metal, at);
  m.lit_floor(metal, tiles);
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
    const Scene scene = reflecting_scene(alpha, 64).scene;
    RenderOptions o = options_with(FieldHits::always, 16);
    o.check = true;
    const RenderResult fields = render(scene, o), exact = render(scene, options_with(FieldHits::never, 16));
    EXPECT_GT(fields.stats.rays_glossy_hits, fields.stats.rays_glossy / 10) << alpha;
    EXPECT_EQ(exact.stats.rays_glossy_hits, 0u);
    for (const CheckedVerdict verdict : {CheckedVerdict::miss, CheckedVerdict::hit}) {
      for (const int self : {0, 1}) {
        const Stats::CheckCount& c = fields.stats.check_by[int(verdict)][self];
        EXPECT_LE(double(c.wrong), 2 + 0.003 * double(c.answers)) << alpha << " " << int(verdict) << self;
      }
      EXPECT_GT(fields.stats.check_by[int(verdict)][0].answers, 300u) << alpha;
    }
    EXPECT_GT(fields.stats.check_by[int(CheckedVerdict::miss)][1].answers, 300u) << alpha;
    // The same rays: the difference is small beside their noise.
    RenderOptions other = options_with(FieldHits::never, 16);
    other.seed = 4;
    const double noise = compare_images(render(scene, other).image, exact.image).rmse;
    const ImageDifference d = compare_images(fields.image, exact.image);
    EXPECT_GT(d.rmse, 0.0);
    EXPECT_LE(d.rmse, 0.1 * noise) << alpha;
    EXPECT_LE(std::abs(d.bias), 0.001) << alpha;
  }
}

// A ball whose facets meet at about the angle over which the lobe reflects. Cells are finer than facets, and plane fits
// round off the facets' edges, within bounds that look small beside the lobe: 1.2 % of hits were wrong before hits off
// their cell's triangle were traced.
TEST(CertifiedHits, DoNotRoundOffTheEdgesOfFacets) {
  SceneMaker m;
  m.film(64, 64);
  m.scene.camera.to_world = test::look_at({2, 2, 4}, {0, 0.3f, 0}, {0, 1, 0});
  m.scene.integrator.max_depth = 3;
  const uint32_t grey = m.bsdf(BsdfKind::diffuse, Rgb(0.6f));
  m.instance(m.mesh(make_sphere({.around = 50, .along = 31})), grey, test::translation({0, 1.1f, 0}));
  m.lit_floor(m.metal(0.035f), grey);
  m.light(EmitterKind::constant, Rgb(0.3f));
  RenderOptions o = options_with(FieldHits::always, 64);
  o.check = true;
  const RenderResult fields = render(m.scene, o);
  const Stats::CheckCount& hits = fields.stats.check_by[int(CheckedVerdict::hit)][0];
  EXPECT_GT(hits.answers, 2500u);
  EXPECT_LE(double(hits.wrong), 0.001 * double(hits.answers));
  // Hits on their cell's triangle are exact.
  const Image exact = render(m.scene, options_with(FieldHits::never, 64)).image;
  EXPECT_LE(compare_images(fields.image, exact).rmse, 0.0005);
}

TEST(CertifiedHits, ConvergeToMonteCarlo) {
  const Scene scene = reflecting_scene(0.3f, 32).scene;
  RenderOptions o = options_with(FieldHits::always, 512);
  const RenderResult fields = render(scene, o);
  EXPECT_GT(fields.stats.rays_glossy_hits, fields.stats.rays_glossy / 10);
  o.method = Method::monte_carlo;
  const ImageDifference d = compare_images(fields.image, render(scene, o).image);
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

TEST(CertifiedHits, AreTheSameInEveryCropWindow) {
  const Scene scene = reflecting_scene(0.3f, 96).scene;
  RenderOptions o = options_with(FieldHits::always, 4);
  const Image whole = render(scene, o).image;
  o.crop = Rect{37, 41, 30, 23};
  const RenderResult part = render(scene, o);
  EXPECT_GT(part.stats.rays_glossy_hits, 0u);
  for (int y = 0; y < o.crop->height; ++y) {
    for (int x = 0; x < o.crop->width; ++x) {
      const float* const expected = whole.pixel(o.crop->x + x, o.crop->y + y);
      ASSERT_TRUE(std::equal(expected, expected + 3, part.image.pixel(x, y))) << x << " " << y;
    }
  }
}

// Certified hits answer rays that radiance maps refuse.
TEST(CertifiedHits, AnswerBesideMaps) {
  const Scene scene = reflecting_scene(0.3f, 160).scene;
  RenderOptions o = options_with(FieldHits::always, 64);
  o.leave_to_rays = false;  // so small a picture would pay for no maps
  o.crop = Rect{50, 70, 32, 32};
  o.aovs = {"glossy_exact"};
  const RenderResult both = render(scene, o);
  EXPECT_GT(both.stats.field_bytes_maps, 0u);
  EXPECT_GT(both.stats.rays_glossy_hits, 0u);
  o.field_hits = FieldHits::never;
  const RenderResult pictures = render(scene, o);
  EXPECT_EQ(pictures.stats.rays_glossy_hits, 0u);
  EXPECT_LT(both.stats.rays_glossy_exact, pictures.stats.rays_glossy_exact);
  const auto traced = [](const Image& image) {
    const int channel = image.channel_index("glossy_exact.Y");
    double sum = 0.0;
    for (int y = 0; y < image.height; ++y) {
      for (int x = 0; x < image.width; ++x) sum += image.pixel(x, y)[channel];
    }
    return sum;
  };
  EXPECT_LT(traced(both.image), traced(pictures.image));
  EXPECT_GT(traced(both.image), 0.0);
  const ImageDifference d = compare_images(both.image, pictures.image);
  EXPECT_LE(d.rmse, 0.004);
  EXPECT_LE(std::abs(d.bias), 0.001);
}

// Where memory is too small for both, shadow rays keep their fields and glossy rays lose theirs.
TEST(CertifiedHits, AreGivenUpFirstWhereMemoryEnds) {
  const Scene scene = reflecting_scene(0.3f, 32).scene;
  RenderOptions o = options_with(FieldHits::never, 4);
  o.light_samples = 8;  // maps of fewer take less
  o.leave_to_rays = false;
  o.field_memory = 24 << 20;  // too little for direction maps of the sky, without which fields are asked more
  const RenderResult never = render(scene, o);
  o.field_hits = FieldHits::always;
  const RenderResult all = render(scene, o);
  ASSERT_EQ(all.stats.field_bytes_maps, 0u);
  ASSERT_GT(4 * all.stats.field_bytes_memory, 5 * never.stats.field_bytes_memory);
  o.field_memory = (all.stats.field_bytes_memory + never.stats.field_bytes_memory) / 2;
  RenderCallbacks callbacks;
  std::string warnings;
  callbacks.warning = [&](const std::string& line) { warnings += line; };
  const RenderResult bounded = render(scene, o, callbacks);
  EXPECT_EQ(bounded.stats.field_restarts, 1u);
  EXPECT_NE(warnings.find("what glossy rays meet"), std::string::npos) << warnings;
  o.field_hits = FieldHits::never;
  EXPECT_EQ(bounded.image.data, render(scene, o).image.data);
}

// Near-mirrors: no error bound is small against such a lobe.
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

// Which instances certified hits answer for, by the film's number of samples and the meshes' sizes.
TEST(CertifiedHits, AreWantedWhereLargeMeshesAreSentManyRays) {
  const std::vector<ShapeTraits> traits = {{false, true}, {false, true}, {true, false}, {false, false}};
  const FieldParameters parameters = {32, 64, 16};
  const SceneMaker small = reflecting_scene(0.3f);
  SceneMaker large = small;
  large.scene.shapes[0].mesh = make_knot({.along = 16384, .around = 32});
  TransportSettings settings;
  RenderOptions o;
  o.lobe_samples = 64;
  constexpr uint64_t k_few = 256 * 256, k_many = 2048 * 2048;
  const auto chosen = [&](const Scene& scene, uint64_t camera_samples) {
    return choose_hit_instances(scene, traits, settings, o, parameters, camera_samples);
  };
  const std::vector<uint32_t> none, knot = {0}, both = {0, 1};
  // The mesh is so fine that texture coordinates cannot be extrapolated to a cell's corners.
  EXPECT_EQ(chosen(large.scene, k_many), none);
  large.scene.instances[0].bsdf = large.scene.instances[1].bsdf;
  EXPECT_EQ(chosen(large.scene, k_many), knot);
  EXPECT_EQ(chosen(large.scene, k_few), none);
  EXPECT_EQ(chosen(small.scene, k_many), none);
  o.field_hits = FieldHits::never;
  EXPECT_EQ(chosen(large.scene, k_many), none);
  o.field_hits = FieldHits::always;
  EXPECT_EQ(chosen(small.scene, k_few), both);
  const auto without_knot = [&](auto&& change) {
    SceneMaker m = small;
    change(m);
    return chosen(m.scene, k_few) == std::vector<uint32_t>{1};
  };
  EXPECT_TRUE(without_knot([](SceneMaker& m) { m.scene.instances[0].bsdf = m.masked(0, 0.5f); }));
  EXPECT_TRUE(without_knot([](SceneMaker& m) { m.scene.bsdfs[0].back = m.masked(0, 0.5f); }));
  EXPECT_TRUE(
      without_knot([](SceneMaker& m) { m.scene.instances[0].bsdf = m.bsdf(BsdfKind::rough_dielectric, Rgb(1.0f)); }));
  EXPECT_TRUE(without_knot([](SceneMaker& m) { m.area_light(0, Rgb(1.0f)); }));
  SceneMaker crowd = small;
  for (size_t i = 0; i < k_most_candidates; ++i) crowd.instance(0, 0, Affine(1.0f));
  EXPECT_EQ(chosen(crowd.scene, k_few), none);
  o.tolerance = 1.0f;
  EXPECT_EQ(chosen(small.scene, k_few), none);
  o.tolerance = 0.1f;
  settings.max_depth = 2;  // surfaces seen in reflections are not lit
  EXPECT_EQ(chosen(small.scene, k_few), none);
}

// ---- surface_near

class SurfaceNear : public testing::Test {
 protected:
  static constexpr int k_points = 2000;

  // A mesh with texture coordinates under a sheared, mirrored and rotated transform.
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
    // Whichever side the plane fit was seen from.
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

// Beside the triangle and off its plane, texture coordinates continue as within it.
TEST_F(SurfaceNear, TextureCoordinatesGoOnBesideATriangle) {
  TestRandom random(6);
  for (int k = 0; k < k_points; ++k) {
    const auto primitive = uint32_t(random.uniform(0.0f, float(scene_.shapes[0].mesh.triangles.size()) - 0.5f));
    const float u = random.uniform(-3.0f, 3.0f), v = random.uniform(-3.0f, 3.0f);
    const SurfacePoint on = exact(0, primitive, u, v);
    // Offset along the object-space normal, the only direction that keeps the foot in place.
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
