// Surface points: on the surface, safely offset, with the reference renderer's normals and coordinates.

#include "core/surface/surface.h"

#include <gtest/gtest.h>

#include <random>

#include "core/material/material_table.h"
#include "core/mesh/mesh_procedural.h"
#include "core/surface/surfaces.h"
#include "core/trace/accel.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace {
namespace {

using test::scaling;
using test::SceneMaker;

struct Random {
  std::mt19937 engine;
  explicit Random(uint32_t seed) : engine(seed) {}
  float unit() { return float(engine() >> 8) * 0x1p-24f; }
  float between(float a, float b) { return a + (b - a) * unit(); }
  float log_uniform(float a, float b) { return std::exp(between(std::log(a), std::log(b))); }
  float sign() { return unit() < 0.5f ? -1.0f : 1.0f; }
  Vec3 direction() {
    const float z = between(-1.0f, 1.0f), phi = between(0.0f, 2.0f * k_pi), r = std::sqrt(1.0f - z * z);
    return {r * std::cos(phi), r * std::sin(phi), z};
  }
  Vec3 log_vector(float a, float b) {
    const float x = sign() * log_uniform(a, b), y = sign() * log_uniform(a, b);
    return {x, y, sign() * log_uniform(a, b)};
  }
  // Rotation, scales and shear within a factor of 20, translation up to `reach` times the scale.
  Affine transform(float reach) {
    const Vec3 x = direction(), z = glm::normalize(glm::cross(x, direction()));
    const float scale = log_uniform(1e-4f, 1e4f);
    Affine a(x * scale * between(0.2f, 2.0f), glm::cross(z, x) * scale * sign() * between(0.2f, 2.0f), z * scale,
             log_vector(1e-3f, reach) * scale);
    a[2] += a[0] * between(-1.0f, 1.0f);
    return a;
  }
};

struct Scenery {
  SceneMaker maker;
  explicit Scenery(uint32_t (*shape)(SceneMaker&, Random&), Random& random, float reach) {
    const uint32_t bsdf = maker.bsdf(BsdfKind::diffuse, Rgb(0.5f));
    maker.instance(shape(maker, random), bsdf, random.transform(reach));
  }
};

uint32_t random_triangle(SceneMaker& maker, Random& random) {
  TriangleMesh m;
  const Vec3 base = random.unit() < 0.5f ? Vec3(0.0f) : random.log_vector(1e-2f, 1e2f);
  const float thin = random.unit() < 0.3f ? 1e-3f : 1.0f;
  m.positions = {base + random.log_vector(0.05f, 1.0f), base + random.log_vector(0.05f, 1.0f), Vec3(0.0f)};
  m.positions[2] = m.positions[0] + thin * random.log_vector(0.05f, 1.0f);
  m.triangles = {{0, 1, 2}};
  return maker.mesh(m);
}

// A point on the shape in object space to aim rays at.
Vec3 target(const Shape& shape, Random& random) {
  if (shape.kind == ShapeKind::mesh) {
    float u = random.unit(), v = random.unit();
    if (u + v > 1.0f) u = 1.0f - u, v = 1.0f - v;
    const auto& p = shape.mesh.positions;
    return p[0] * (1.0f - u - v) + p[1] * u + p[2] * v;
  }
  return random.direction() * 0.7f;
}

// Shoots `count` rays at the shape and returns the surfaces hit.
std::vector<SurfacePoint> shoot(const Scene& scene, const Accel& accel, Random& random, int count) {
  RayBatch rays;
  rays.resize(size_t(count));
  for (int i = 0; i < count; ++i) {
    const Instance& instance = scene.instances[0];
    const Vec3 aim = target(scene.shapes[instance.shape], random);
    const Vec3 from = aim + random.direction() * random.log_uniform(2.0f, 100.0f);
    const Vec3 o = transform_point(instance.to_world, from);
    rays.set(size_t(i), o, transform_point(instance.to_world, aim) - o, k_infinity);
  }
  HitBatch hits;
  hits.resize(size_t(count));
  accel.intersect(rays, hits, Coherence::incoherent);
  std::vector<SurfacePoint> points;
  for (size_t i = 0; i < rays.size; ++i) {
    if (hits.instance[i] != k_none) points.push_back(surface_at(scene, rays, hits, i));
  }
  return points;
}

// Counts self-intersections of rays that leave the offset origin on its side of the (flat or outward curved) surface.
int count_self_hits(const Accel& accel, const std::vector<SurfacePoint>& points, Random& random, bool both_sides) {
  RayBatch rays;
  rays.resize(points.size());
  std::vector<uint32_t> indices;
  for (uint32_t i = 0; i < points.size(); ++i) {
    const SurfacePoint& s = points[i];
    Vec3 d = random.direction();
    // A third of the rays are grazing.
    if (i % 3 == 0) d = glm::normalize(d - s.geometric_normal * glm::dot(d, s.geometric_normal) * 0.999f);
    if (!both_sides && glm::dot(d, s.geometric_normal) < 0.0f) d = -d;
    rays.set(i, offset_origin(s.position, s.geometric_normal, s.error, d), d, k_infinity);
    indices.push_back(i);
  }
  std::vector<uint8_t> blocked(padded(points.size()), 0);
  accel.occluded(rays, indices, blocked.data());
  int hits = 0;
  for (size_t i = 0; i < points.size(); ++i) hits += blocked[i];
  return hits;
}

TEST(Surface, OffsetRaysLeaveTrianglesOnEitherSide) {
  Random random(1);
  size_t tested = 0;
  for (const float reach : {1e-2f, 1.0f, 1e2f, 1e4f}) {
    for (int i = 0; i < 60; ++i) {
      const Scenery s(random_triangle, random, reach);
      const Accel accel(s.maker.scene);
      const auto points = shoot(s.maker.scene, accel, random, 64);
      tested += points.size();
      EXPECT_EQ(count_self_hits(accel, points, random, true), 0) << "reach " << reach << " scene " << i;
    }
  }
  EXPECT_GT(tested, 5000u);
}

TEST(Surface, OffsetRaysLeaveAnalyticShapes) {
  Random random(2);
  size_t tested = 0;
  const auto sphere = [](SceneMaker& m, Random&) { return m.shape(ShapeKind::sphere); };
  const auto disk = [](SceneMaker& m, Random&) { return m.shape(ShapeKind::disk); };
  const auto cylinder = [](SceneMaker& m, Random&) { return m.shape(ShapeKind::cylinder); };
  for (const float reach : {1e-2f, 1.0f, 1e2f, 1e4f}) {
    for (int i = 0; i < 30; ++i) {
      for (uint32_t (*make)(SceneMaker&, Random&) : {+sphere, +disk, +cylinder}) {
        const Scenery s(make, random, reach);
        const Accel accel(s.maker.scene);
        const auto points = shoot(s.maker.scene, accel, random, 64);
        tested += points.size();
        // Inside round shapes, rays do hit the opposite wall.
        const bool flat = s.maker.scene.shapes[0].kind == ShapeKind::disk;
        EXPECT_EQ(count_self_hits(accel, points, random, flat), 0) << "reach " << reach << " scene " << i;
      }
    }
  }
  EXPECT_GT(tested, 5000u);
}

// In a coordinate plane every relative error bound is zero.
TEST(Surface, OffsetRaysLeaveCoordinatePlanes) {
  Random random(4);
  for (const ShapeKind kind : {ShapeKind::rectangle, ShapeKind::disk}) {
    for (const float size : {1e-6f, 1e-3f, 1.0f, 50.0f, 1e6f}) {
      SceneMaker maker;
      maker.instance(maker.shape(kind), maker.bsdf(BsdfKind::diffuse, Rgb(0.5f)), scaling(Vec3(size)));
      const Accel accel(maker.scene);
      RayBatch rays;
      rays.resize(128);
      for (size_t i = 0; i < rays.size; ++i) {
        const Vec3 aim = i % 2 ? Vec3(0.0f) : Vec3(random.between(-.5f, .5f), random.between(-.5f, .5f), 0) * size;
        rays.set(i, aim + Vec3(0, 0, 10) * size, {0, 0, -1}, k_infinity);
      }
      HitBatch hits;
      hits.resize(rays.size);
      accel.intersect(rays, hits, Coherence::incoherent);
      std::vector<SurfacePoint> points;
      for (size_t i = 0; i < rays.size; ++i) {
        ASSERT_EQ(hits.instance[i], 0u) << size;
        points.push_back(surface_at(maker.scene, rays, hits, i));
      }
      EXPECT_EQ(count_self_hits(accel, points, random, true), 0) << size;
      EXPECT_LT(points[0].error, size * 0x1p-20f);
    }
  }
}

// The bound is useful only if it is small: a few ulps of the coordinates and of the object's size.
// Of points near a mesh, as of rays that meet it: vertex normals tell the outside, whatever the triangles' winding.
TEST(Surface, VertexNormalsTellTheOutsideNearAMesh) {
  Random random(11);
  for (const bool winds_inwards : {false, true}) {
    for (const bool flips : {false, true}) {
      SceneMaker maker;
      TriangleMesh ball = make_sphere({.around = 32, .along = 16});
      ball.normals.clear();
      for (const Vec3& p : ball.positions) ball.normals.push_back(glm::normalize(p));
      if (winds_inwards) {
        for (UVec3& t : ball.triangles) std::swap(t.y, t.z);
      }
      maker.instance(maker.mesh(ball), maker.bsdf(BsdfKind::diffuse, Rgb(0.5f)), random.transform(3.0f));
      maker.scene.instances[0].flip_normals = flips;
      const Scene& scene = maker.scene;
      const Accel accel(scene);
      for (const SurfacePoint& met : shoot(scene, accel, random, 64)) {
        for (const float side : {-1.0f, 1.0f}) {
          const SurfacePoint near =
              surface_near(scene, 0, met.primitive, met.position, side * met.geometric_normal, met.error);
          EXPECT_GT(glm::dot(near.shading_normal, met.shading_normal), 0.999f);
          EXPECT_GT(glm::dot(near.geometric_normal, met.geometric_normal), 0.999f);
        }
      }
    }
  }
}

TEST(Surface, ErrorIsAFewUlps) {
  Random random(3);
  size_t hit = 0;
  for (int i = 0; i < 100; ++i) {
    const Scenery s([](SceneMaker& m, Random&) { return m.shape(ShapeKind::rectangle); }, random, 10.0f);
    const Accel accel(s.maker.scene);
    const Bounds3 bounds = s.maker.scene.world_bounds();
    const float size = glm::length(bounds.diagonal()) + glm::length(bounds.centre());
    for (const SurfacePoint& p : shoot(s.maker.scene, accel, random, 16)) {
      EXPECT_LT(p.error, size * 0x1p-14f);
      ++hit;
    }
  }
  EXPECT_GT(hit, 500u);
}

::testing::AssertionResult same(const SurfacePoint& a, const SurfacePoint& b, bool with_uv) {
  if (a.position != b.position) return ::testing::AssertionFailure() << "position";
  if (a.error != b.error) return ::testing::AssertionFailure() << "error " << a.error << " " << b.error;
  if (a.geometric_normal != b.geometric_normal) return ::testing::AssertionFailure() << "geometric normal";
  if (a.shading_normal != b.shading_normal) return ::testing::AssertionFailure() << "shading normal";
  if (a.instance != b.instance || a.primitive != b.primitive) return ::testing::AssertionFailure() << "identity";
  if (with_uv && a.uv != b.uv) return ::testing::AssertionFailure() << "uv";
  return ::testing::AssertionSuccess();
}

// A triangle of zero area, one whose corners' normals cancel out at its middle, and one with ordinary normals.
TriangleMesh odd_triangles() {
  TriangleMesh m;
  m.positions = {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {0, 1, 0}, {1, 1, 0}, {0, 2, 0.5f}};
  m.normals = {{0, 0, 1}, {0, 0, -1}, {0, 0, 1}, {0, 0, 1}, {0, 0, -1}, {0, 0.6f, 0.8f}};
  m.triangles = {{0, 1, 2}, {0, 4, 3}, {2, 3, 5}};
  return m;
}

// Meshes with and without normals, degenerate triangles, rectangles and analytic shapes, sheared, mirrored and of all
// sizes, some with flipped normals and textures.
struct ManySurfaces {
  SceneMaker maker;
  uint32_t checked;

  explicit ManySurfaces(Random& random) {
    const uint32_t plain = maker.bsdf(BsdfKind::diffuse, Rgb(0.5f));
    checked = maker.bsdf(BsdfKind::diffuse, Rgb(0.5f));
    maker.scene.textures[maker.scene.bsdfs[checked].reflectance].kind = TextureKind::checkerboard;
    const TriangleMesh smooth = make_sphere({.around = 24, .along = 12});
    TriangleMesh faceted = smooth;
    faceted.normals.clear();
    faceted.texcoords.clear();
    const uint32_t shapes[] = {maker.mesh(smooth),
                               maker.mesh(faceted),
                               maker.mesh(odd_triangles()),
                               maker.shape(ShapeKind::rectangle),
                               maker.shape(ShapeKind::disk),
                               maker.shape(ShapeKind::sphere),
                               maker.shape(ShapeKind::cylinder)};
    for (int i = 0; i < 35; ++i) {
      const uint32_t bsdf = i % 3 == 0 ? checked : plain;
      const uint32_t placed = maker.instance(shapes[size_t(i) % 7], bsdf, random.transform(10.0f));
      maker.scene.instances[placed].flip_normals = i % 4 == 1;
    }
  }

  // Shoots `count` rays, four in five of which hit something; most of them hit the first instance.
  void shoot(Random& random, size_t count, RayBatch& rays, HitBatch& hits, std::vector<HitRun>& runs) const {
    const Scene& scene = maker.scene;
    rays.resize(count);
    hits.resize(count);
    const auto pick = [&](size_t n) { return uint32_t(random.unit() * float(n)); };
    for (uint32_t i = 0; i < count; ++i) {
      hits.instance[i] = k_none;
      if (random.unit() < 0.2f) continue;
      hits.instance[i] = random.unit() < 0.6f ? 0 : pick(scene.instances.size());
      const Shape& shape = scene.shapes[scene.instances[hits.instance[i]].shape];
      hits.primitive[i] = is_meshed(shape.kind) ? pick(shape.triangle_count()) : 0;
      hits.u[i] = i % 5 == 0 ? 0.5f : random.unit();
      hits.v[i] = i % 5 == 0 ? 0.0f : random.unit() * (1.0f - hits.u[i]);
      hits.t[i] = random.log_uniform(1e-3f, 1e3f);
      rays.set(i, random.log_vector(1e-3f, 1e3f), random.direction(), k_infinity);
    }
    find_runs(hits, count, runs);
  }
};

// One Surfaces object evaluates batches that grow and shrink.
TEST(Surface, BatchesAreSingleSurfacesOnEveryMachine) {
  Random random(5);
  const ManySurfaces many(random);
  const Scene& scene = many.maker.scene;
  const MaterialTable materials(scene);
  for (const Isa isa : supported_isas()) {
    Surfaces surfaces(scene, materials, isa);
    for (const size_t count : {size_t(7), size_t(3001), size_t(1), size_t(700)}) {
      RayBatch rays;
      HitBatch hits;
      std::vector<HitRun> runs;
      many.shoot(random, count, rays, hits, runs);
      surfaces.evaluate(rays, hits, runs);
      for (uint32_t i = 0; i < count; ++i) {
        if (hits.instance[i] == k_none) continue;
        const bool with_uv = scene.instances[hits.instance[i]].bsdf == many.checked;
        ASSERT_TRUE(same(surfaces.batch().at(hits, i), surface_at(scene, rays, hits, i), with_uv))
            << isa_name(isa) << " " << i;
      }
      if (runs.empty()) continue;
      const uint32_t i = runs[0].begin;
      const SurfacePoint other = {
          .position = Vec3(1, 2, 3), .uv = Vec2(4, 5), .instance = hits.instance[i], .primitive = hits.primitive[i]};
      surfaces.put(i, other);
      EXPECT_TRUE(same(surfaces.batch().at(hits, i), other, true));
    }
  }
}

TEST(Surface, MaterialsOfTheTableAreTheResolvedOnes) {
  SceneMaker maker;
  std::vector<uint32_t> constant;
  for (const BsdfKind kind : {BsdfKind::diffuse, BsdfKind::rough_conductor, BsdfKind::rough_plastic,
                              BsdfKind::rough_dielectric, BsdfKind::principled}) {
    constant.push_back(maker.bsdf(kind, Rgb(0.5f, 0.4f, 0.3f)));
    constant.push_back(maker.masked(constant.back(), 0.7f));
  }
  const uint32_t two_sided = maker.bsdf(BsdfKind::diffuse, Rgb(0.2f));
  maker.scene.bsdfs[two_sided].two_sided = true;
  maker.scene.bsdfs[two_sided].back = constant[2];
  constant.push_back(two_sided);
  // Textured on the front, on the back only, and in the opacity only.
  const uint32_t front = maker.bsdf(BsdfKind::diffuse, Rgb(0.5f));
  maker.scene.textures[maker.scene.bsdfs[front].reflectance].kind = TextureKind::checkerboard;
  const uint32_t back = maker.bsdf(BsdfKind::diffuse, Rgb(0.2f)), holes = maker.masked(constant[0], 0.5f);
  maker.scene.bsdfs[back].two_sided = true;
  maker.scene.bsdfs[back].back = front;
  maker.scene.textures[maker.scene.bsdfs[holes].opacity].kind = TextureKind::checkerboard;
  const MaterialTable table(maker.scene);
  for (const uint32_t bsdf : constant) {
    EXPECT_FALSE(table.varies(bsdf));
    for (const float cosine : {0.3f, -0.3f}) {
      const Material* sides = table.sides(bsdf);
      ASSERT_NE(sides, nullptr);
      EXPECT_EQ(sides[cosine < 0.0f], resolve_material(maker.scene, bsdf, Vec2(0.7f), cosine)) << bsdf << " " << cosine;
    }
  }
  for (const uint32_t bsdf : {front, back, holes}) {
    EXPECT_TRUE(table.varies(bsdf));
    EXPECT_EQ(table.sides(bsdf), nullptr);
  }
  // One-sided, two-sided over a conductor, textured; textured on the back only, masked.
  EXPECT_EQ(table.diffuse_sides(constant[0]), table.sides(constant[0]));
  EXPECT_EQ(table.diffuse_sides(constant[1]), nullptr);
  EXPECT_EQ(table.diffuse_sides(constant[2]), nullptr);
  EXPECT_EQ(table.diffuse_sides(two_sided), nullptr);
  EXPECT_EQ(table.diffuse_sides(holes), nullptr);
  for (const uint32_t bsdf : {front, back}) {
    const Material* sides = table.diffuse_sides(bsdf);
    ASSERT_NE(sides, nullptr);
    EXPECT_EQ(sides[1].dark, bsdf == front);
    EXPECT_EQ(sides[1].turned, bsdf == back);
  }
}

SurfacePoint hit_at(SceneMaker& maker, const Vec3& o, const Vec3& d) {
  const Accel accel(maker.scene);
  RayBatch rays;
  rays.resize(1);
  rays.set(0, o, d, k_infinity);
  HitBatch hits;
  hits.resize(1);
  accel.intersect(rays, hits, Coherence::coherent);
  EXPECT_NE(hits.instance[0], k_none);
  return surface_at(maker.scene, rays, hits, 0);
}

void expect_near(const Vec3& a, const Vec3& b, float tolerance = 2e-6f) {
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(a[c], b[c], tolerance);
}

// Values of Mitsuba 3.9 for the same rays; mirrored by scale(-1, 1, 1) where indicated.
TEST(Surface, AnalyticShapesAgreeWithReference) {
  struct Case {
    ShapeKind kind;
    Vec3 scale, origin, direction, position, normal;
    Vec2 uv;
    Vec3 tangent;  // unit
  };
  const Vec3 down(0, 0, -1), aside(-1, -.2f, -.1f);
  const Case cases[] = {
      {ShapeKind::sphere,
       {1, 1, 1},
       {3, 1, .5f},
       aside,
       {.7828138f, .5565627f, .2782814f},
       {.7828138f, .5565627f, .2782814f},
       {.0983665f, .4102352f},
       {-.5794513f, .8150069f, 0}},
      {ShapeKind::disk,
       {1, 1, 1},
       {.3f, -.2f, 1},
       down,
       {.3f, -.2f, 0},
       {0, 0, 1},
       {.3605551f, .9064165f},
       {.8320503f, -.5547002f, 0}},
      {ShapeKind::disk,
       {1, 1, -1},
       {.3f, -.2f, 1},
       down,
       {.3f, -.2f, 0},
       {0, 0, -1},
       {.3605551f, .9064165f},
       {.8320503f, -.5547002f, 0}},
      {ShapeKind::disk,
       {-1, 1, 1},
       {.3f, -.2f, 1},
       down,
       {.3f, -.2f, 0},
       {0, 0, 1},
       {.3605551f, .5935836f},
       {.8320503f, -.5547002f, 0}},
      {ShapeKind::cylinder,
       {1, 1, 1},
       {3, .3f, .5f},
       aside,
       {.9948841f, -.1010231f, .2994884f},
       {.9948841f, -.1010231f, 0},
       {.9838942f, .2994884f},
       {.1010231f, .9948841f, 0}},
      {ShapeKind::cylinder,
       {-1, 1, 1},
       {3, .3f, .5f},
       aside,
       {.9948841f, -.1010231f, .2994884f},
       {.9948841f, -.1010231f, 0},
       {.5161058f, .2994884f},
       {-.1010231f, -.9948841f, 0}},
      {ShapeKind::rectangle, {1, 1, 1}, {.3f, -.2f, 1}, down, {.3f, -.2f, 0}, {0, 0, 1}, {.65f, .4f}, {1, 0, 0}},
      {ShapeKind::rectangle, {-1, 1, 1}, {.3f, -.2f, 1}, down, {.3f, -.2f, 0}, {0, 0, 1}, {.35f, .4f}, {-1, 0, 0}},
      {ShapeKind::rectangle, {1, 1, -1}, {.3f, -.2f, 1}, down, {.3f, -.2f, 0}, {0, 0, -1}, {.65f, .4f}, {1, 0, 0}},
  };
  for (const Case& c : cases) {
    SCOPED_TRACE(int(c.kind));
    SceneMaker maker;
    maker.instance(maker.shape(c.kind), maker.bsdf(BsdfKind::diffuse, Rgb(0.5f)), scaling(c.scale));
    const SurfacePoint s = hit_at(maker, c.origin, c.direction);
    expect_near(s.position, c.position);
    expect_near(s.shading_normal, c.normal);
    EXPECT_NEAR(s.uv.x, c.uv.x, 2e-6f);
    EXPECT_NEAR(s.uv.y, c.uv.y, 2e-6f);
    expect_near(glm::normalize(surface_tangent(maker.scene, s)), c.tangent);
    // flip_normals reverses both normals.
    maker.scene.instances[0].flip_normals = true;
    const SurfacePoint flipped = hit_at(maker, c.origin, c.direction);
    expect_near(flipped.shading_normal, -c.normal);
    expect_near(flipped.geometric_normal, -s.geometric_normal);
  }
}

TEST(Surface, ShadingNormalsFollowTheInverseTranspose) {
  SceneMaker maker;
  TriangleMesh m;
  m.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  m.normals = {glm::normalize(Vec3(0, 0, 1)), glm::normalize(Vec3(1, 0, 1)), glm::normalize(Vec3(0, 1, 1))};
  m.triangles = {{0, 1, 2}};
  maker.instance(maker.mesh(m), maker.bsdf(BsdfKind::diffuse, Rgb(0.5f)), scaling({2, 1, 3}));
  const SurfacePoint s = hit_at(maker, {0.5f, 0.25f, 5}, {0, 0, -1});  // barycentric (.5, .25, .25)
  const float h = std::sqrt(0.5f);
  const Vec3 object = Vec3(.25f * h, .25f * h, .5f + .5f * h);
  expect_near(s.shading_normal, glm::normalize(Vec3(object.x / 2, object.y, object.z / 3)));
  expect_near(s.geometric_normal, {0, 0, 1});
  EXPECT_NEAR(s.uv.x, 0.25f, 1e-6f);  // without texture coordinates: barycentric
  EXPECT_NEAR(s.uv.y, 0.25f, 1e-6f);
  EXPECT_EQ(surface_tangent(maker.scene, s), Vec3(2, 0, 0));
}

TEST(Surface, TangentFollowsTextureCoordinates) {
  Random random(5);
  for (int i = 0; i < 200; ++i) {
    SceneMaker maker;
    TriangleMesh m;
    m.positions = {random.log_vector(.1f, 1), random.log_vector(.1f, 1), random.log_vector(.1f, 1)};
    const Vec2 a(random.unit(), random.unit()), b(random.unit(), random.unit()), c(random.unit(), random.unit());
    m.texcoords = {a, b, c};
    m.triangles = {{0, 1, 2}};
    maker.instance(maker.mesh(m), maker.bsdf(BsdfKind::diffuse, Rgb(0.5f)), Affine(1.0f));
    SurfacePoint s;
    s.instance = 0;
    s.primitive = 0;
    const Vec3 t = surface_tangent(maker.scene, s);
    // Moving along the tangent changes u and keeps v: dp = dp/du du + dp/dv dv on both edges.
    const float det = (b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y);
    const Vec3 e1 = m.positions[1] - m.positions[0], e2 = m.positions[2] - m.positions[0];
    const Vec3 du = t / std::abs(det), dv = (e2 * (b.x - a.x) - e1 * (c.x - a.x)) / det;
    // Rounding is relative to the terms that cancel, all below 2 / |det|.
    expect_near(du * (b.x - a.x) + dv * (b.y - a.y), e1, 16.0f * 0x1p-24f / std::abs(det));
  }
}

}  // namespace
}  // namespace fieldtrace
