// Surface points: on the surface, offset safely, with the normals and coordinates of the reference renderer.

#include "core/surface.h"

#include <gtest/gtest.h>

#include <random>

#include "core/accel.h"
#include "core/material_table.h"
#include "core/mesh_procedural.h"
#include "core/surfaces.h"
#include "small_scenes.h"

namespace fieldtrace {
namespace {

using test::scaling;
using test::SceneMaker;
using test::translation;

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

// A point on the shape in object space, about which to aim rays.
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

// Rays that start at the offset origin and go to its side: none may meet the (flat or outward curved) surface.
int count_self_hits(const Accel& accel, const std::vector<SurfacePoint>& points, Random& random, bool both_sides) {
  RayBatch rays;
  rays.resize(points.size());
  std::vector<uint32_t> indices;
  for (uint32_t i = 0; i < points.size(); ++i) {
    const SurfacePoint& s = points[i];
    Vec3 d = random.direction();
    // A third of the rays graze.
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
        // Inside round shapes rays do meet the other wall.
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
      for (size_t i = 0; i < rays.size; ++i) points.push_back(surface_at(maker.scene, rays, hits, i));
      EXPECT_EQ(count_self_hits(accel, points, random, true), 0) << size;
      EXPECT_LT(points[0].error, size * 0x1p-20f);
    }
  }
}

// The bound is worth something only if it is small: a few ulps of the coordinates and of the object's size.
TEST(Surface, ErrorIsAFewUlps) {
  Random random(3);
  for (int i = 0; i < 100; ++i) {
    const Scenery s([](SceneMaker& m, Random&) { return m.shape(ShapeKind::rectangle); }, random, 10.0f);
    const Accel accel(s.maker.scene);
    const Bounds3 bounds = s.maker.scene.world_bounds();
    const float size = glm::length(bounds.diagonal()) + glm::length(bounds.centre());
    for (const SurfacePoint& p : shoot(s.maker.scene, accel, random, 16)) EXPECT_LT(p.error, size * 0x1p-14f);
  }
}

void expect_same(const SurfacePoint& a, const SurfacePoint& b, const char* what) {
  ASSERT_EQ(a.position, b.position) << what;
  ASSERT_EQ(a.error, b.error) << what;
  ASSERT_EQ(a.geometric_normal, b.geometric_normal) << what;
  ASSERT_EQ(a.shading_normal, b.shading_normal) << what;
  ASSERT_EQ(a.instance, b.instance) << what;
  ASSERT_EQ(a.primitive, b.primitive) << what;
}

// Meshes with and without normals, rectangles and analytic shapes, sheared and mirrored, some with flipped normals, in
// one batch with misses: groups of all sizes.
TEST(Surface, BatchesAreSingleSurfacesOnEveryMachine) {
  Random random(5);
  SceneMaker maker;
  const uint32_t plain = maker.bsdf(BsdfKind::diffuse, Rgb(0.5f)), checked = maker.bsdf(BsdfKind::diffuse, Rgb(0.5f));
  maker.scene.textures[maker.scene.bsdfs[checked].reflectance].kind = TextureKind::checkerboard;
  TriangleMesh smooth = make_sphere({.around = 24, .along = 12});
  ASSERT_FALSE(smooth.normals.empty());
  TriangleMesh faceted = smooth;
  faceted.normals.clear();
  faceted.texcoords.clear();
  const uint32_t shapes[] = {maker.mesh(smooth), maker.mesh(faceted), maker.shape(ShapeKind::rectangle),
                             maker.shape(ShapeKind::sphere), maker.shape(ShapeKind::disk)};
  for (int i = 0; i < 40; ++i) {
    Affine at = random.transform(1.0f);
    const float size = std::cbrt(std::abs(glm::determinant(Mat3(at))));
    at = Affine(at[0] / size, at[1] / size, at[2] / size, random.direction() * random.between(0.0f, 12.0f));
    const uint32_t placed = maker.instance(shapes[size_t(i) % 5], i % 3 == 0 ? checked : plain, at);
    maker.scene.instances[placed].flip_normals = i % 4 == 1;
  }
  const Accel accel(maker.scene);
  for (const size_t count : {size_t(1), size_t(7), size_t(3000)}) {
    RayBatch rays;
    rays.resize(count);
    for (size_t i = 0; i < count; ++i) rays.set(i, random.direction() * 30.0f, random.direction(), k_infinity);
    for (size_t i = 0; i < count; i += 2) {
      const Vec3 o = rays.origin(i);
      rays.set(i, o, random.direction() * random.between(0.0f, 12.0f) - o, k_infinity);
    }
    HitBatch hits;
    hits.resize(count);
    accel.intersect(rays, hits, Coherence::incoherent);
    for (const Isa isa : supported_isas()) {
      Surfaces surfaces(maker.scene, isa);
      for (int again = 0; again < 2; ++again) surfaces.evaluate(rays, hits);
      size_t found = 0;
      for (size_t i = 0; i < count; ++i) {
        if (hits.instance[i] == k_none) continue;
        ++found;
        const SurfacePoint expected = surface_at(maker.scene, rays, hits, i);
        expect_same(surfaces.at(i), expected, isa_name(isa));
        if (maker.scene.instances[expected.instance].bsdf == checked) {
          ASSERT_EQ(surfaces.at(i).uv, expected.uv);
        }
      }
      EXPECT_EQ(surfaces.count(), found);
      EXPECT_LE(found, count);
      if (count > 1000) {
        EXPECT_GT(found, count / 5);
        EXPECT_LT(found, count);
      }
    }
  }
}

TEST(Surface, MaterialsOfTheTableAreTheResolvedOnes) {
  SceneMaker maker;
  const uint32_t one = maker.bsdf(BsdfKind::diffuse, Rgb(0.5f)), two = maker.bsdf(BsdfKind::diffuse, Rgb(0.2f));
  maker.scene.bsdfs[two].two_sided = true;
  maker.scene.bsdfs[two].back = one;
  const uint32_t textured = maker.bsdf(BsdfKind::diffuse, Rgb(0.5f));
  maker.scene.textures[maker.scene.bsdfs[textured].reflectance].kind = TextureKind::checkerboard;
  const MaterialTable table(maker.scene);
  for (const uint32_t bsdf : {one, two}) {
    for (const float cosine : {0.3f, -0.3f}) {
      const Material expected = resolve_material(maker.scene, bsdf, Vec2(0.7f), cosine);
      const Material* found = table.find(bsdf, cosine);
      ASSERT_NE(found, nullptr);
      EXPECT_EQ(found->dark, expected.dark);
      EXPECT_EQ(found->turned, expected.turned);
      EXPECT_EQ(found->reflectance, expected.reflectance);
    }
    EXPECT_EQ(table.find(bsdf, 0.0f), nullptr);
    EXPECT_EQ(table.find(bsdf, std::numeric_limits<float>::quiet_NaN()), nullptr);
  }
  EXPECT_EQ(table.find(textured, 1.0f), nullptr);
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

// Figures of Mitsuba 3.9 for the same rays; mirrored by scale(-1, 1, 1) where said so.
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
    // Turned round, both normals are.
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
  EXPECT_EQ(surface_tangent(maker.scene, s), Vec3(0.0f));
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
    // Moving along the tangent changes u and leaves v: dp = dp/du du + dp/dv dv on both edges.
    const float det = (b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y);
    const Vec3 e1 = m.positions[1] - m.positions[0], e2 = m.positions[2] - m.positions[0];
    const Vec3 du = t / std::abs(det), dv = (e2 * (b.x - a.x) - e1 * (c.x - a.x)) / det;
    // Rounding is relative to the terms that cancel, all below 2 / |det|.
    expect_near(du * (b.x - a.x) + dv * (b.y - a.y), e1, 16.0f * 0x1p-24f / std::abs(det));
  }
}

}  // namespace
}  // namespace fieldtrace
