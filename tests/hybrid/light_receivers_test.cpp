// Receivers of light and their clusters.

#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "hybrid/light/shading_clusters.h"
#include "tests/support/random_lines.h"

namespace fieldtrace {
namespace {

constexpr uint32_t k_count = 300;

// Surfaces of a few instances, seen from all around.
struct Wave {
  RayBatch rays;
  HitBatch hits;
  SurfaceBatch surfaces;

  explicit Wave(TestRandom& random) {
    rays.resize(k_count);
    hits.resize(k_count);
    surfaces.resize(k_count);
    for (uint32_t i = 0; i < k_count; ++i) {
      hits.instance[i] = hits.primitive[i] = 7;
      rays.set(i, Vec3(0.0f), random.direction(), k_infinity);
      const SurfacePoint point = {.position = random.direction() * 3.0f,
                                  .error = random.uniform(),
                                  .geometric_normal = random.direction(),
                                  .shading_normal = random.direction()};
      surfaces.set(i, point);
    }
  }
};

// Everything that describes a receiver, seeds and sample indices excepted.
std::vector<float> members(const LightReceivers& r, size_t i) {
  const ShadingPointBatch& p = r.points;
  return {p.px[i],
          p.py[i],
          p.pz[i],
          p.gx[i],
          p.gy[i],
          p.gz[i],
          p.sx[i],
          p.sy[i],
          p.sz[i],
          p.error[i],
          p.radius[i],
          r.red[i],
          r.green[i],
          r.blue[i],
          float(r.kind[i]),
          float(r.path[i]),
          float(p.instance[i]),
          float(p.transmits[i])};
}

TEST(LightReceivers, RunsAreTheirVertices) {
  TestRandom random(3);
  const Wave wave(random);
  for (const bool turned : {false, true}) {
    Material material;
    material.reflectance = {0.2f, 0.3f, 0.4f};
    material.turned = turned;
    LightReceivers runs, single;
    runs.clear(k_count);
    single.clear(k_count);
    for (const HitRun& run : {HitRun{2, 3}, HitRun{5, 105}, HitRun{120, k_count}}) {
      EXPECT_EQ(runs.add_run(wave.rays, wave.surfaces, run, 7, material), single.size());
      for (uint32_t i = run.begin; i < run.end; ++i) {
        const SurfacePoint surface = wave.surfaces.at(wave.hits, i);
        PathVertex v;
        v.path = i;
        v.surface = &surface;
        v.material = &material;
        v.frame.n = turned ? -surface.shading_normal : surface.shading_normal;
        const bool inside = glm::dot(surface.geometric_normal, wave.rays.direction(i)) > 0.0f;
        v.facing = inside ? -surface.geometric_normal : surface.geometric_normal;
        single.add(v, k_none, {}, 0);
      }
    }
    ASSERT_EQ(runs.size(), single.size());
    for (size_t i = 0; i < runs.size(); ++i) {
      EXPECT_EQ(members(runs, i), members(single, i)) << i;
      EXPECT_EQ(runs.vertex[i], k_none);
    }
  }
}

// Pixels of 1 to 150 samples, some over several instances, between which samples change at random.
LightReceivers pixels(TestRandom& random) {
  const Wave wave(random);
  LightReceivers r;
  Material material;
  material.reflectance = Rgb(0.5f);
  r.clear(4 * k_count);
  uint32_t seed = 0;
  for (int wave_number = 0; wave_number < 4; ++wave_number) {
    for (uint32_t begin = 0, end = 0; begin < k_count; begin = end) {
      end = std::min(begin + uint32_t(1.0f + random.uniform() * 150.0f), k_count);
      const bool is_mixed = random.uniform() < 0.5f;
      const uint32_t instance = random.index(3);
      ++seed;
      for (uint32_t i = begin; i < end; ++i) {
        const size_t at =
            r.add_run(wave.rays, wave.surfaces, {i, i + 1}, is_mixed ? random.index(3) : instance, material);
        r.points.seed[at] = r.cluster[at] = seed;
        r.points.sample[at] = r.path[at] = uint32_t(at);
        if (seed % 3) r.points.gx[at] = 0.0f, r.points.gy[at] = 0.0f, r.points.gz[at] = 1.0f;  // others fall apart
      }
    }
  }
  return r;
}

TEST(ShadingClusters, AreRangesOfOnePixelAndInstance) {
  TestRandom random(4);
  for (const uint32_t most : {1u, 20u, 1000u}) {
    LightReceivers r = pixels(random);
    const LightReceivers before = r;
    ShadingClusters clusters;
    clusters.build(r, {}, most, false);
    // Every receiver is there once and whole, in its pixel's place.
    std::set<uint32_t> met;
    for (size_t i = 0; i < r.size(); ++i) {
      EXPECT_TRUE(met.insert(r.path[i]).second);
      EXPECT_EQ(members(r, i), members(before, r.path[i]));
      EXPECT_EQ(r.points.sample[i], r.path[i]);
      EXPECT_EQ(r.points.seed[i], before.points.seed[i]);
    }
    ShadingPointBatch centres;
    clusters.centres(0, clusters.size(), centres);
    uint32_t at = 0;
    size_t largest = 0;
    for (size_t c = 0; c < clusters.size(); ++c) {
      EXPECT_EQ(clusters[c].begin, at);
      at = clusters[c].end;
      EXPECT_LE(clusters[c].size(), most);
      largest = std::max<size_t>(largest, clusters[c].size());
      // No cluster ends early.
      const auto facing = [&](size_t i) { return Vec3(r.points.gx[i], r.points.gy[i], r.points.gz[i]); };
      const bool could_grow = at < r.size() && clusters[c].size() < most && r.points.seed[at] == centres.seed[c] &&
                              r.points.instance[at] == centres.instance[c];
      EXPECT_TRUE(!could_grow || !(glm::dot(facing(clusters[c].begin), facing(at)) > 0.0f));
      const Vec3 centre(centres.px[c], centres.py[c], centres.pz[c]);
      for (uint32_t i = clusters[c].begin; i < at; ++i) {
        EXPECT_EQ(r.points.seed[i], centres.seed[c]);
        EXPECT_EQ(r.points.instance[i], centres.instance[c]);
        EXPECT_GT(glm::dot(facing(clusters[c].begin), facing(i)), 0.0f);
        EXPECT_LE(r.points.error[i], centres.error[c]);
        EXPECT_LE(glm::distance(centre, Vec3(r.points.px[i], r.points.py[i], r.points.pz[i])), centres.radius[c]);
        EXPECT_TRUE(i == clusters[c].begin || r.path[i - 1] < r.path[i]);  // sorting is stable
      }
    }
    EXPECT_EQ(at, r.size());
    EXPECT_GE(largest, std::min(most, 60u));
  }
}

}  // namespace
}  // namespace fieldtrace
