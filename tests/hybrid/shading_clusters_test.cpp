// Clusters of shading points: what they hold and how wide they are.
#include "hybrid/light/shading_clusters.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/support/random_lines.h"

namespace fieldtrace {
namespace {

// Vertices of camera rays, pixel after pixel.
struct Pixels {
  std::vector<SurfacePoint> surfaces;
  std::vector<Material> materials = std::vector<Material>(6);
  std::vector<PathVertex> vertices;
  std::vector<PathState> paths;

  Pixels() {
    materials[0].reflectance = Rgb(0.3f, 0.5f, 0.7f);
    materials[1].dark = true;
    materials[2].kind = materials[3].kind = BsdfKind::rough_dielectric;
    materials[4].kind = materials[5].kind = BsdfKind::conductor;
    surfaces.reserve(1 << 16);  // vertices point to them
  }
  void add(uint32_t pixel, const Vec3& position, const Vec3& normal, uint32_t instance, int material) {
    SurfacePoint& s = surfaces.emplace_back();
    s.position = position;
    s.instance = instance;
    s.error = 1e-6f * (1.0f + glm::length(position));
    PathVertex& v = vertices.emplace_back();
    v.surface = &s;
    v.material = &materials[size_t(material)];
    v.facing = normal;
    v.frame.n = glm::normalize(normal + Vec3(0.1f, 0, 0));
    v.seed = pixel * 2654435761u + 1u;
    v.path = uint32_t(paths.size());
    paths.emplace_back().index = uint32_t(7 * paths.size());
  }
  LightReceivers receivers() const {
    LightReceivers r;
    r.clear(vertices.size());
    for (uint32_t i = 0; i < vertices.size(); ++i) r.add(vertices[i], i, paths[vertices[i].path], vertices[i].seed);
    return r;
  }
  bool is_lit(uint32_t m) const { return !vertices[m].material->delta() && !vertices[m].material->dark; }
};

// A cluster's vertices.
std::span<const uint32_t> members_of(const LightReceivers& receivers, const ShadingCluster& cluster) {
  return {&receivers.vertex[cluster.begin], cluster.size()};
}

LightExtent ball_light(const Vec3& centre, float radius) {
  LightExtent light;
  light.kind = LightExtent::Kind::bounded;
  light.ball = {centre, radius};
  return light;
}

// Materials of instances; the next one is their other side.
constexpr int k_material_of[] = {0, 0, 2, 4};

Pixels random_pixels(TestRandom& random) {
  Pixels p;
  const float unit = random.log_uniform(1e-3f, 1e3f);
  for (uint32_t pixel = 0; pixel < 60; ++pixel) {
    const Vec3 centre = 10.0f * unit * random.in_ball(), normal = random.direction();
    const float width = unit * random.log_uniform(1e-4f, 1.0f);
    const uint32_t instances = 1 + random.index(4), samples = 1 + random.index(70);
    for (uint32_t i = 0; i < samples; ++i) {
      const bool turned = random.index(8) == 0;
      const Vec3 bent = turned ? random.direction() : glm::normalize(normal + 0.3f * random.in_ball());
      const uint32_t instance = random.index(instances);
      p.add(pixel, centre + width * random.in_ball(), bent, instance, k_material_of[instance] + (random.index(8) == 0));
    }
  }
  return p;
}

TEST(ShadingClusters, PartTheVerticesThatTakeLight) {
  TestRandom random(41);
  size_t joined = 0;
  for (int i = 0; i < 40; ++i) {
    const Pixels p = random_pixels(random);
    const uint32_t most = 1 + random.index(64);
    const std::vector<LightExtent> lights = {ball_light(2e4f * random.direction(), 1.0f)};
    LightReceivers receivers = p.receivers();
    ShadingClusters clusters;
    clusters.build(receivers, lights, most, false);
    std::vector<int> seen(p.vertices.size(), 0);
    uint32_t last_pixel = 0;
    for (size_t c = 0; c < clusters.size(); ++c) {
      const auto members = members_of(receivers, clusters[c]);
      ASSERT_GE(members.size(), 1u);
      ASSERT_LE(members.size(), most);
      joined += members.size() > 1;
      const PathVertex& first = p.vertices[members[0]];
      // Pixels follow one another.
      const auto is_first = [&](const PathVertex& v) { return v.seed == first.seed; };
      const auto pixel = uint32_t(std::find_if(p.vertices.begin(), p.vertices.end(), is_first) - p.vertices.begin());
      ASSERT_GE(pixel, last_pixel);
      last_pixel = pixel;
      for (const uint32_t& m : members) {
        const PathVertex& v = p.vertices[m];
        ++seen[m];
        const size_t at = clusters[c].begin + size_t(&m - members.data());
        ASSERT_EQ(Vec3(receivers.points.px[at], receivers.points.py[at], receivers.points.pz[at]), v.surface->position);
        ASSERT_EQ(receivers.points.sample[at], p.paths[v.path].index);
        ASSERT_FLOAT_EQ(receivers.red[at], v.material->plain_diffuse() ? v.material->reflectance.x / k_pi : 0.0f);
        ASSERT_EQ(v.seed, first.seed);
        ASSERT_EQ(v.surface->instance, first.surface->instance);
        ASSERT_GT(glm::dot(v.facing, first.facing), 0.0f);
        if (v.material->transmits()) {
          ASSERT_EQ(m, members[0]);
        }
      }
    }
    for (uint32_t m = 0; m < seen.size(); ++m) ASSERT_EQ(seen[m], p.is_lit(m)) << m;
  }
  EXPECT_GT(joined, 1000u);
}

TEST(ShadingClusters, RadiiEncloseTheMembersAndAreSmallBesideTheWayToLights) {
  TestRandom random(42);
  size_t joined = 0, single = 0;
  for (int i = 0; i < 40; ++i) {
    const Pixels p = random_pixels(random);
    const float unit = glm::length(p.surfaces[0].position);
    std::vector<LightExtent> lights = {ball_light(unit * 5.0f * random.in_ball(), unit),
                                       ball_light(unit * 5.0f * random.in_ball(), unit)};
    lights.emplace_back().kind = LightExtent::Kind::everywhere;
    LightReceivers receivers = p.receivers();
    ShadingClusters clusters;
    clusters.build(receivers, lights, 1000, false);
    ShadingPointBatch points;
    const size_t begin = clusters.size() / 3, end = clusters.size();
    clusters.centres(begin, end, points);
    ASSERT_EQ(points.size, end - begin);
    for (size_t k = 0; k < points.size; ++k) {
      const auto members = members_of(receivers, clusters[begin + k]);
      const DVec3 centre(points.px[k], points.py[k], points.pz[k]);
      float error = 0.0f;
      for (const uint32_t m : members) {
        const SurfacePoint& s = *p.vertices[m].surface;
        ASSERT_LE(glm::length(DVec3(s.position) - centre), double(points.radius[k]));
        error = std::max(error, s.error);
        ASSERT_EQ(points.instance[k], s.instance);
        ASSERT_EQ(points.seed[k], p.vertices[m].seed);
      }
      ASSERT_EQ(points.error[k], error);
      const ShadingCluster& cluster = clusters[begin + k];
      const Vec3 facing(points.gx[k], points.gy[k], points.gz[k]), shading(points.sx[k], points.sy[k], points.sz[k]);
      bool is_plain = true;
      for (const uint32_t m : members) {
        const PathVertex& v = p.vertices[m];
        ASSERT_LE(glm::length(v.facing - facing), cluster.spread + 1e-6f);
        ASSERT_LE(glm::length(v.frame.n - shading), cluster.spread + 1e-6f);
        is_plain = is_plain && v.material->plain_diffuse();
      }
      ASSERT_EQ(cluster.plain_diffuse(), is_plain);
      ASSERT_NEAR(glm::length(Vec3(points.gx[k], points.gy[k], points.gz[k])), 1.0f, 1e-5f);
      if (members.size() == 1) {
        ++single;
        ASSERT_EQ(points.radius[k], 0.0f);
        continue;
      }
      ++joined;
      for (size_t l = 0; l < 2; ++l) {
        const double distance = glm::length(DVec3(lights[l].ball.centre) - centre);
        ASSERT_LE(double(points.radius[k]), double(k_widest_cluster) * distance * (1.0 + 1e-6));
      }
    }
  }
  EXPECT_GT(joined, 200u);
  EXPECT_GT(single, 200u);
}

// 64 samples of a pixel of half width 1 on a plane.
size_t clusters_of_a_pixel(float light_distance, uint32_t most, bool single) {
  TestRandom random(43);
  Pixels p;
  for (int i = 0; i < 64; ++i) {
    p.add(0, {random.uniform(-1.0f, 1.0f), random.uniform(-1.0f, 1.0f), 0.0f}, {0, 0, 1}, 0, 0);
  }
  const std::vector<LightExtent> lights = {ball_light({0, 0, light_distance}, 0.5f)};
  LightReceivers receivers = p.receivers();
  ShadingClusters clusters;
  clusters.build(receivers, lights, most, single);
  return clusters.size();
}

TEST(ShadingClusters, APixelIsOneUnlessItIsWideOrHoldsTooManyPoints) {
  EXPECT_EQ(clusters_of_a_pixel(40.0f, 1000, false), 1u);
  EXPECT_EQ(clusters_of_a_pixel(15.0f, 1000, false), 64u);
  EXPECT_EQ(clusters_of_a_pixel(1e9f, 1000, false), 1u);
  EXPECT_EQ(clusters_of_a_pixel(40.0f, 20, false), 4u);
  EXPECT_EQ(clusters_of_a_pixel(40.0f, 1000, true), 64u);
}

// A batch of camera rays may meet nothing. The standard library's assertions (asan-ubsan) see an access past the end.
// What lights plainly diffuse points leaves them the sky by no other way.
TEST(ShadingClusters, HoldDiffusePointsAloneOrNone) {
  Pixels p;
  p.materials[3].kind = BsdfKind::rough_conductor;
  for (int i = 0; i < 16; ++i) p.add(0, Vec3(0.01f * float(i), 0, 0), Vec3(0, 0, 1), 0, i % 5 == 2 ? 3 : 0);
  LightReceivers r = p.receivers();
  ASSERT_EQ(r.size(), 16u);
  ShadingClusters clusters;
  clusters.build(r, {}, 100, false);
  size_t points = 0;
  for (size_t c = 0; c < clusters.size(); ++c) {
    for (uint32_t i = clusters[c].begin; i < clusters[c].end; ++i, ++points) {
      EXPECT_EQ(clusters[c].kind, r.kind[i]) << i;
    }
  }
  EXPECT_EQ(points, 16u);
  EXPECT_GT(clusters.size(), 1u);
}

TEST(ShadingClusters, OfNoPointsAreNone) {
  for (const bool single : {false, true}) {
    LightReceivers receivers = Pixels().receivers();
    ShadingClusters clusters;
    clusters.build(receivers, {}, 1000, single);
    EXPECT_EQ(clusters.size(), 0u);
    ShadingPointBatch centres;
    clusters.centres(0, 0, centres);
    EXPECT_EQ(centres.size, 0u);
  }
}

// Far from the origin the mean of the positions must not round to beside the cluster.
TEST(ShadingClusters, FarFromTheOriginAreNoWider) {
  for (const float shift : {0.0f, 1e4f}) {
    TestRandom random(44);
    Pixels p;
    for (int i = 0; i < 64; ++i) {
      p.add(0, Vec3(shift) + Vec3(random.uniform(-1.0f, 1.0f), random.uniform(-1.0f, 1.0f), 0.0f), {0, 0, 1}, 0, 0);
    }
    LightReceivers receivers = p.receivers();
    ShadingClusters clusters;
    clusters.build(receivers, {}, 1000, false);
    ASSERT_EQ(clusters.size(), 1u);
    ShadingPointBatch points;
    clusters.centres(0, 1, points);
    EXPECT_LT(points.radius[0], 1.5f);
    EXPECT_LT(glm::length(Vec3(points.px[0], points.py[0], points.pz[0]) - Vec3(shift)), 0.3f);
  }
}

}  // namespace
}  // namespace fieldtrace
