// Answers of the C interface against exact rays, and what it keeps from commit to commit.
#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>

#include "core/trace/accel.h"
#include "tests/support/api_scene.h"
#include "tests/support/field_checks.h"

namespace fieldtrace {
namespace {

using test::ApiScene;

struct Rays {
  std::vector<Vec3> origins, directions;
  std::vector<float> t_max;
  size_t size() const { return origins.size(); }
};

// Rays between random points in and about the scene; every fifth goes on without end.
Rays random_rays(size_t count, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> x(-3.0f, 3.0f), y(0.05f, 4.0f), length(0.2f, 3.0f);
  Rays r;
  for (size_t i = 0; i < count; ++i) {
    const Vec3 a(x(random), y(random), x(random)), b(x(random), y(random), x(random));
    const float stretch = length(random);
    r.origins.push_back(a);
    r.directions.push_back((b - a) * stretch);
    r.t_max.push_back(i % 5 == 0 ? k_infinity : 1.0f / stretch);
  }
  return r;
}

struct Exact {
  RayBatch rays;
  HitBatch hits;
  std::vector<uint8_t> blocked;
};

Exact trace(const Scene& scene, const Rays& from) {
  Exact e;
  e.rays.resize(from.size());
  e.hits.resize(from.size());
  e.blocked.assign(from.size(), 0);
  std::vector<uint32_t> all;
  for (size_t i = 0; i < from.size(); ++i) {
    e.rays.set(i, from.origins[i], from.directions[i], from.t_max[i]);
    all.push_back(uint32_t(i));
  }
  const Accel accel(scene);
  accel.occluded(e.rays, all, e.blocked.data());
  accel.intersect(e.rays, e.hits, Coherence::incoherent);
  return e;
}

std::vector<uint8_t> ask(FTScene scene, const Rays& rays, bool certified) {
  std::vector<uint8_t> results(rays.size(), 9);
  const auto function = certified ? ftOccludedCertified : ftOccluded;
  EXPECT_EQ(function(scene, &rays.origins[0].x, 0, &rays.directions[0].x, sizeof(Vec3), rays.t_max.data(), 0, nullptr,
                     0, rays.size(), results.data(), 0),
            FT_ERROR_NONE);
  return results;
}

size_t differences(const std::vector<uint8_t>& answers, const std::vector<uint8_t>& exact, size_t& undecided) {
  size_t wrong = 0;
  undecided = 0;
  for (size_t i = 0; i < answers.size(); ++i) {
    if (answers[i] == FT_UNDECIDED_OCCLUSION) {
      ++undecided;
    } else {
      wrong += answers[i] != exact[i];
    }
  }
  return wrong;
}

TEST(ApiOccluded, IsThatOfExactRays) {
  const ApiScene s;
  ASSERT_EQ(ftBakeFields(s.scene), FT_ERROR_NONE);
  const Rays rays = random_rays(20000, 1);
  const Exact exact = trace(s.same.scene, rays);
  size_t undecided = 0;
  EXPECT_LE(differences(ask(s.scene, rays, false), exact.blocked, undecided), rays.size() / 500);
  EXPECT_EQ(undecided, 0u);
  EXPECT_LE(differences(ask(s.scene, rays, true), exact.blocked, undecided), rays.size() / 500);
  EXPECT_GT(undecided, 0u);
  EXPECT_LT(undecided, rays.size() / 2);
  double share = 0.0;
  EXPECT_EQ(ftGetSceneFloat(s.scene, "certified_occlusion", &share), FT_ERROR_NONE);
  EXPECT_GT(share, 0.5);
}

// The same rays with directions of any length; Embree ends the program for the longest.
TEST(ApiOccluded, DoesNotDependOnTheLengthOfDirections) {
  const ApiScene s;
  const Rays rays = random_rays(4000, 5);
  const std::vector<uint8_t> expected = ask(s.scene, rays, false);
  for (const float scale : {1e-30f, 1e-18f, 1e-6f, 1e6f, 1e19f, 1e30f}) {
    Rays scaled = rays;
    for (size_t i = 0; i < rays.size(); ++i) scaled.directions[i] *= scale, scaled.t_max[i] /= scale;
    const std::vector<uint8_t> answers = ask(s.scene, scaled, false);
    size_t wrong = 0;
    for (size_t i = 0; i < rays.size(); ++i) wrong += answers[i] != expected[i];
    EXPECT_LE(wrong, 4u) << scale;  // along edges
  }
}

TEST(ApiOccluded, TracesEveryRayAtToleranceZero) {
  const ApiScene s;
  ASSERT_EQ(ftSetSceneFloat(s.scene, "tolerance", 0.0), FT_ERROR_NONE);
  ASSERT_EQ(ftCommitScene(s.scene), FT_ERROR_NONE);
  const Rays rays = random_rays(20000, 2);
  Rays unit = rays;  // those without end become unit
  for (size_t i = 0; i < rays.size(); i += 5) unit.directions[i] = glm::normalize(rays.directions[i]);
  for (int round = 0; round < 600; ++round) ask(s.scene, unit, true);  // nor do bakes fall due
  EXPECT_EQ(ask(s.scene, unit, false), trace(s.same.scene, unit).blocked);
  int64_t baked = -1;
  EXPECT_EQ(ftGetSceneInt(s.scene, "cells_baked", &baked), FT_ERROR_NONE);
  EXPECT_EQ(baked, 0);
}

// Rays that come back are worth a bake, rays all over the place are not.
TEST(ApiOccluded, BakesForRaysThatComeBack) {
  const ApiScene s;
  const Rays rays = random_rays(2000, 8);
  const Exact exact = trace(s.same.scene, rays);
  const auto cells_baked = [&] {
    int64_t cells = -1;
    EXPECT_EQ(ftGetSceneInt(s.scene, "cells_baked", &cells), FT_ERROR_NONE);
    return cells;
  };
  size_t undecided = 0, undecided_later = 0;
  EXPECT_LE(differences(ask(s.scene, rays, true), exact.blocked, undecided), rays.size() / 500);
  EXPECT_EQ(cells_baked(), 0);
  const int most = 4 * 32 * (16 + 2);  // of rays that each cell, and each depth, can wait for
  for (int round = 0; round < most && cells_baked() == 0; ++round) ask(s.scene, rays, false);
  EXPECT_GT(cells_baked(), 0);
  for (int round = 0; round < most; ++round) ask(s.scene, rays, true);
  EXPECT_LE(differences(ask(s.scene, rays, true), exact.blocked, undecided_later), rays.size() / 500);
  EXPECT_LT(undecided_later, undecided / 2);
  EXPECT_LE(differences(ask(s.scene, rays, false), exact.blocked, undecided), rays.size() / 500);
}

TEST(ApiOccluded, FollowsTransformsWithoutANewBake) {
  ApiScene s;
  const Rays rays = random_rays(5000, 3);
  ask(s.scene, rays, false);
  ASSERT_EQ(ftBakeFields(s.scene), FT_ERROR_NONE);
  int64_t before = 0, after = 0;
  ASSERT_EQ(ftGetSceneInt(s.scene, "cells_baked", &before), FT_ERROR_NONE);
  EXPECT_GT(before, 1000000);
  const Affine moved = test::translation({0.4f, 2.0f, -0.7f});
  float columns[12];
  test::columns_of(moved, columns);
  ASSERT_EQ(ftSetInstanceTransform(s.scene, 0, columns), FT_ERROR_NONE);
  const std::vector<uint8_t> old = ask(s.scene, rays, false);
  ASSERT_EQ(ftCommitScene(s.scene), FT_ERROR_NONE);
  const Exact was = trace(s.same.scene, rays);
  s.same.scene.instances[0].to_world = moved;
  s.same.scene.instances[0].to_object = Affine(inverse_affine(DAffine(moved)));
  const Exact is = trace(s.same.scene, rays);
  size_t undecided = 0;
  EXPECT_LE(differences(old, was.blocked, undecided), rays.size() / 500);  // not before the commit
  EXPECT_LE(differences(ask(s.scene, rays, false), is.blocked, undecided), rays.size() / 500);
  EXPECT_GT(differences(old, is.blocked, undecided), rays.size() / 50);
  ASSERT_EQ(ftGetSceneInt(s.scene, "cells_baked", &after), FT_ERROR_NONE);
  EXPECT_EQ(before, after);
}

int64_t number(FTScene scene, const char* name) {
  int64_t value = -1;
  EXPECT_EQ(ftGetSceneInt(scene, name, &value), FT_ERROR_NONE) << name;
  return value;
}

// Queries and pictures take a new tolerance with the commit, and not before it.
TEST(ApiSettings, ToleranceWaitsForACommit) {
  const ApiScene s;
  const float from[] = {3, 3, 5}, to[] = {0, 0.8f, 0}, up[] = {0, 1, 0}, radiance[] = {4, 4, 4};
  ASSERT_EQ(ftSetSceneCamera(s.scene, from, to, up, 45.0f, 24, 16), FT_ERROR_NONE);
  ASSERT_EQ(ftSetInstanceRadiance(s.scene, 1, radiance), FT_ERROR_NONE);
  ASSERT_EQ(ftSetSceneInt(s.scene, "spp", 16), FT_ERROR_NONE);
  ASSERT_EQ(ftCommitScene(s.scene), FT_ERROR_NONE);
  ASSERT_EQ(ftBakeFields(s.scene), FT_ERROR_NONE);
  const Rays rays = random_rays(5000, 9);
  struct Answers {
    std::vector<uint8_t> occlusion, hits;
    std::vector<float> pixels;
    int64_t certified = 0;
  };
  const auto answers = [&] {
    Answers a = {ask(s.scene, rays, true), std::vector<uint8_t>(rays.size()), std::vector<float>(24 * 16 * 3),
                 number(s.scene, "cells_certified")};
    EXPECT_EQ(ftNearest(s.scene, 0.02f, &rays.origins[0].x, 0, &rays.directions[0].x, 0, nullptr, 0, nullptr, 0,
                        rays.size(), a.hits.data(), 0, nullptr, 0, nullptr, 0, nullptr, 0, nullptr, 0),
              FT_ERROR_NONE);
    EXPECT_EQ(ftRender(s.scene, a.pixels.data(), 0, 0), FT_ERROR_NONE);
    return a;
  };
  const Answers before = answers();
  ASSERT_EQ(ftSetSceneFloat(s.scene, "tolerance", 0.6), FT_ERROR_NONE);
  const Answers waiting = answers();
  EXPECT_EQ(waiting.occlusion, before.occlusion);
  EXPECT_EQ(waiting.hits, before.hits);
  EXPECT_EQ(waiting.pixels, before.pixels);
  EXPECT_EQ(waiting.certified, before.certified);
  ASSERT_EQ(ftCommitScene(s.scene), FT_ERROR_NONE);
  const Answers after = answers();
  EXPECT_NE(after.occlusion, before.occlusion);
  EXPECT_NE(after.hits, before.hits);
  EXPECT_NE(after.pixels, before.pixels);
  EXPECT_GT(after.certified, before.certified);
}

TEST(ApiNearest, IsThatOfExactRays) {
  const ApiScene s;
  ASSERT_EQ(ftBakeFields(s.scene), FT_ERROR_NONE);
  const Rays rays = random_rays(20000, 4);
  const Exact exact = trace(s.same.scene, rays);
  std::vector<uint8_t> status(rays.size(), 9);
  std::vector<float> t(rays.size(), -1.0f);
  std::vector<Vec3> normals(rays.size());
  std::vector<uint32_t> primitives(rays.size(), k_none), instances(rays.size(), k_none);
  const float max_error = 0.02f;
  ASSERT_EQ(ftNearest(s.scene, max_error, &rays.origins[0].x, 0, &rays.directions[0].x, 0, rays.t_max.data(), 0,
                      nullptr, 0, rays.size(), status.data(), 0, t.data(), 0, &normals[0].x, 0, primitives.data(), 0,
                      instances.data(), 0),
            FT_ERROR_NONE);
  size_t wrong = 0, hits = 0, misses = 0, undecided = 0, exact_hits = 0;
  for (size_t i = 0; i < rays.size(); ++i) {
    const bool met = exact.hits.instance[i] != k_none;
    exact_hits += met;
    ASSERT_LE(status[i], FT_UNDECIDED_HIT);
    undecided += status[i] == FT_UNDECIDED_HIT;
    misses += status[i] == FT_MISS, hits += status[i] == FT_HIT;
    if (status[i] == FT_MISS) wrong += met;
    if (status[i] != FT_HIT) continue;
    ASSERT_LT(instances[i], 3u);
    EXPECT_LT(primitives[i], s.same.scene.shapes[s.same.scene.instances[instances[i]].shape].triangle_count());
    EXPECT_NEAR(glm::length(normals[i]), 1.0f, 1e-4f);
    EXPECT_LE(glm::dot(normals[i], rays.directions[i]), 0.0f);
    EXPECT_LE(t[i], rays.t_max[i]);
    const float distance = glm::length(rays.directions[i]) * exact.hits.t[i];
    const float off = glm::length(rays.directions[i]) * std::abs(t[i] - exact.hits.t[i]) *
                      std::abs(glm::dot(glm::normalize(rays.directions[i]), normals[i]));
    wrong += !met || instances[i] != exact.hits.instance[i] || off > 2 * max_error * distance;
  }
  EXPECT_LE(wrong, rays.size() / 200);
  EXPECT_GT(hits, exact_hits / 4);
  EXPECT_GT(exact_hits, rays.size() / 20);
  EXPECT_GT(misses, rays.size() / 10);
  EXPECT_LT(undecided, rays.size() / 2);
}

// One instance of each mesh, unmoved; small fields.
struct PlainScene {
  FTDevice device = nullptr;
  FTScene scene = nullptr;

  explicit PlainScene(const std::vector<TriangleMesh>& meshes) {
    EXPECT_EQ(ftNewDevice(2, &device), FT_ERROR_NONE);
    EXPECT_EQ(ftNewScene(device, &scene), FT_ERROR_NONE);
    EXPECT_EQ(ftSetSceneInt(scene, "directions", 32), FT_ERROR_NONE);
    EXPECT_EQ(ftSetSceneInt(scene, "plane", 64), FT_ERROR_NONE);
    for (const TriangleMesh& mesh : meshes) {
      uint32_t number = 0;
      EXPECT_EQ(ftAddMesh(scene, &mesh.positions[0].x, sizeof(Vec3), mesh.positions.size(), &mesh.triangles[0].x,
                          sizeof(UVec3), mesh.triangles.size(), &number),
                FT_ERROR_NONE);
      EXPECT_EQ(ftAddInstance(scene, number, nullptr, nullptr), FT_ERROR_NONE);
    }
    EXPECT_EQ(ftCommitScene(scene), FT_ERROR_NONE);
  }
  ~PlainScene() {
    EXPECT_EQ(ftReleaseScene(scene), FT_ERROR_NONE);
    EXPECT_EQ(ftReleaseDevice(device), FT_ERROR_NONE);
  }
  PlainScene(const PlainScene&) = delete;
  PlainScene& operator=(const PlainScene&) = delete;
};

// Few rays find their hits certified at once where all is baked; the triangles of hits are not, and are baked for them.
TEST(ApiNearest, IsCertifiedAtOnceWhereAllIsBaked) {
  const PlainScene s({make_sphere()});
  std::vector<Vec3> origins, directions;
  for (int i = 0; i < 50; ++i) {
    const float a = 2.4f * float(i);
    origins.push_back({3.0f * std::cos(a), 3.0f * std::sin(a), 0.02f * float(i) - 0.5f});
    directions.push_back(Vec3(0.2f, 0.1f, 0.3f) - origins.back());
  }
  const auto hits = [&] {
    std::vector<uint8_t> status(50, 9);
    EXPECT_EQ(ftNearest(s.scene, 0.1f, &origins[0].x, 0, &directions[0].x, 0, nullptr, 0, nullptr, 0, 50, status.data(),
                        0, nullptr, 0, nullptr, 0, nullptr, 0, nullptr, 0),
              FT_ERROR_NONE);
    return std::count(status.begin(), status.end(), uint8_t(FT_HIT));
  };
  EXPECT_EQ(hits(), 0);
  ASSERT_EQ(ftBakeFields(s.scene), FT_ERROR_NONE);
  EXPECT_GT(hits(), 5);
}

double certified_hits(FTScene scene) {
  double share = -1.0;
  EXPECT_EQ(ftGetSceneFloat(scene, "certified_hits", &share), FT_ERROR_NONE);
  return share;
}

struct NearestHits {
  std::vector<uint8_t> status;
  std::vector<uint32_t> instances;
};
NearestHits nearest(FTScene scene, const Rays& rays) {
  NearestHits hits = {std::vector<uint8_t>(rays.size(), 9), std::vector<uint32_t>(rays.size(), k_none)};
  EXPECT_EQ(ftNearest(scene, 0.1f, &rays.origins[0].x, 0, &rays.directions[0].x, 0, nullptr, 0, nullptr, 0, rays.size(),
                      hits.status.data(), 0, nullptr, 0, nullptr, 0, nullptr, 0, hits.instances.data(), 0),
            FT_ERROR_NONE);
  return hits;
}

TEST(ApiNearest, CountsAsCertifiedWhatFieldsAnswer) {
  const ApiScene s;
  ASSERT_EQ(ftBakeFields(s.scene), FT_ERROR_NONE);
  const Rays rays = random_rays(2000, 13);
  const NearestHits hits = nearest(s.scene, rays);
  size_t certified = 0, on_floor = 0;
  for (size_t i = 0; i < rays.size(); ++i) {
    const bool met_floor = hits.status[i] == FT_HIT && hits.instances[i] == 2;  // two triangles have no field
    on_floor += met_floor;
    certified += hits.status[i] != FT_UNDECIDED_HIT && !met_floor;
  }
  EXPECT_GT(on_floor, 100u);
  EXPECT_DOUBLE_EQ(certified_hits(s.scene), double(certified) / double(rays.size()));
}

// As in pictures: some cells answer there whose error has no known bound.
TEST(ApiNearest, TracesEveryRayAtToleranceOne) {
  const ApiScene s;
  ASSERT_EQ(ftBakeFields(s.scene), FT_ERROR_NONE);
  ASSERT_EQ(ftSetSceneFloat(s.scene, "tolerance", 1.0), FT_ERROR_NONE);
  ASSERT_EQ(ftCommitScene(s.scene), FT_ERROR_NONE);
  const Rays rays = random_rays(2000, 14);
  const NearestHits hits = nearest(s.scene, rays);
  Rays endless = rays;
  endless.t_max.assign(rays.size(), k_infinity);
  const Exact exact = trace(s.same.scene, endless);
  size_t wrong = 0;
  for (size_t i = 0; i < rays.size(); ++i) {
    EXPECT_NE(hits.status[i], FT_UNDECIDED_HIT) << i;
    wrong += hits.instances[i] != exact.hits.instance[i];
  }
  EXPECT_LE(wrong, 4u);  // along edges
  EXPECT_EQ(certified_hits(s.scene), 0.0);
}

// Rays beside one whose part of the field waits for its bake keep their answers.
TEST(ApiNearest, AnUndecidedRayTakesNothingFromOthers) {
  const PlainScene s({make_knot({.along = 128, .around = 16})});
  const Rays rays = random_rays(400, 12);
  // Of 15 times one ray, with another one among them.
  const auto ask = [&](size_t many, size_t one) {
    std::vector<Vec3> origins(16, rays.origins[many]), directions(16, rays.directions[many]);
    origins[7] = rays.origins[one], directions[7] = rays.directions[one];
    std::vector<uint8_t> status(16, 9);
    EXPECT_EQ(ftNearest(s.scene, 0.1f, &origins[0].x, 0, &directions[0].x, 0, nullptr, 0, nullptr, 0, 16, status.data(),
                        0, nullptr, 0, nullptr, 0, nullptr, 0, nullptr, 0),
              FT_ERROR_NONE);
    return status[0];
  };
  std::vector<size_t> waiting;
  for (size_t i = 0; i < rays.size(); ++i) {
    if (ask(i, i) == FT_UNDECIDED_HIT) waiting.push_back(i);
  }
  ASSERT_GT(waiting.size(), 10u);
  const size_t other = waiting.back();
  waiting.pop_back();
  size_t misses = 0;
  for (const size_t i : waiting) {
    for (int round = 0; round < 60; ++round) ask(i, i);  // bakes what it needs
    if (ask(i, i) != FT_MISS) continue;
    ++misses;
    EXPECT_EQ(ask(i, other), FT_MISS);
  }
  EXPECT_GT(misses, 2u);
  EXPECT_EQ(ask(other, other), FT_UNDECIDED_HIT);
}

// Points on the floor.
struct Points {
  std::vector<Vec3> at, normals;
  std::vector<uint32_t> from;
};
Points floor_points(size_t side) {
  Points p;
  for (size_t i = 0; i < side * side; ++i) {
    p.at.push_back({-2.9f + 5.8f * float(i % side) / float(side), 0, -2.9f + 5.8f * float(i / side) / float(side)});
    p.normals.push_back({0, 1, 0});
    p.from.push_back(2);
  }
  return p;
}

TEST(ApiLightVisibility, IsTheShareOfExactRays) {
  const ApiScene s;
  const Points p = floor_points(24);
  const std::vector<uint32_t> shapes = {FT_LIGHT_RECTANGLE, FT_LIGHT_SPHERE, FT_LIGHT_DISK};
  const std::vector<float> lights = {0, 6, 0, 0.8f, 0,  0, 0, 0,    0.8f, 4, 6, 1, 0.7f, 0,
                                     0, 0, 0, 0,    -3, 5, 2, 0.6f, 0,    0, 0, 0, 0.6f};
  std::vector<float> shares(p.at.size() * 3, -1.0f), certain(p.at.size() * 3, -1.0f);
  ASSERT_EQ(ftLightVisibility(s.scene, &p.at[0].x, 0, &p.normals[0].x, 0, p.from.data(), 0, p.at.size(), shapes.data(),
                              0, lights.data(), 0, 3, shares.data(), 0, certain.data(), 0),
            FT_ERROR_NONE);
  // The spheres of points of lights, cast at random; u x v of the flat ones points down.
  std::mt19937 random(5);
  std::uniform_real_distribution<float> unit(-1.0f, 1.0f);
  double sum = 0.0, worst = 0.0, mean_certain = 0.0;
  size_t shaded = 0;
  const size_t k_rays = 256;
  for (size_t k = 0; k < 3; ++k) {
    const float* const l = &lights[9 * k];
    const Vec3 c(l[0], l[1], l[2]), u(l[3], l[4], l[5]), v(l[6], l[7], l[8]);
    for (size_t i = 0; i < p.at.size(); ++i) {
      Rays rays;
      while (rays.size() < k_rays) {
        const float a = unit(random), b = unit(random);
        if (k > 0 && a * a + b * b > 1.0f) continue;
        Vec3 target = c + a * u + b * v;
        const Vec3 o = p.at[i] + Vec3(0, 1e-4f, 0);
        if (k == 1) {  // a disk across the sphere's middle that the point sees head on
          const Vec3 z = glm::normalize(o - c), x = glm::normalize(glm::cross(z, Vec3(1, 0, 0)));
          target = c + 0.7f * (a * x + b * glm::cross(z, x));
        }
        rays.origins.push_back(o);
        rays.directions.push_back(target - o);
        rays.t_max.push_back(0.999f);
      }
      static const Accel accel(s.same.scene);
      RayBatch batch;
      batch.resize(k_rays);
      std::vector<uint32_t> all(k_rays);
      std::vector<uint8_t> blocked(k_rays, 0);
      for (size_t j = 0; j < k_rays; ++j) {
        batch.set(j, rays.origins[j], rays.directions[j], rays.t_max[j]);
        all[j] = uint32_t(j);
      }
      accel.occluded(batch, all, blocked.data());
      double clear = 0.0;
      for (const uint8_t b : blocked) clear += b ? 0.0 : 1.0 / double(k_rays);
      const double share = double(shares[3 * i + k]);
      ASSERT_GE(share, 0.0);
      ASSERT_LE(share, 1.0);
      sum += std::abs(share - clear);
      worst = std::max(worst, std::abs(share - clear));
      mean_certain += double(certain[3 * i + k]);
      shaded += clear < 0.5;
    }
  }
  const auto count = double(3 * p.at.size());
  EXPECT_GT(shaded, 50u);
  EXPECT_LE(sum / count, 0.02);
  EXPECT_LE(worst, 0.4);
  EXPECT_GT(mean_certain / count, 0.5);
}

TEST(ApiSkyVisibility, IsTheShareOfExactRays) {
  const ApiScene s;
  const Points p = floor_points(12);
  std::vector<float> shares(p.at.size(), -1.0f), certain(p.at.size(), -1.0f);
  ASSERT_EQ(ftSkyVisibility(s.scene, &p.at[0].x, 0, &p.normals[0].x, 0, p.from.data(), 0, p.at.size(), shares.data(), 0,
                            certain.data(), 0),
            FT_ERROR_NONE);
  std::mt19937 random(6);
  std::uniform_real_distribution<float> unit(0.0f, 1.0f);
  const Accel accel(s.same.scene);
  double sum = 0.0;
  size_t shaded = 0;
  for (size_t i = 0; i < p.at.size(); ++i) {
    const size_t k_rays = 2048;
    RayBatch rays;
    rays.resize(k_rays);
    std::vector<uint32_t> all(k_rays);
    std::vector<uint8_t> blocked(k_rays, 0);
    for (size_t j = 0; j < k_rays; ++j) {
      const float r = std::sqrt(unit(random)), phi = 2.0f * k_pi * unit(random);
      rays.set(j, p.at[i] + Vec3(0, 1e-4f, 0), Vec3(r * std::cos(phi), std::sqrt(1.0f - r * r), r * std::sin(phi)),
               k_infinity);
      all[j] = uint32_t(j);
    }
    accel.occluded(rays, all, blocked.data());
    double clear = 0.0;
    for (const uint8_t b : blocked) clear += b ? 0.0 : 1.0 / double(k_rays);
    EXPECT_NEAR(shares[i], clear, 0.06);
    sum += std::abs(double(shares[i]) - clear);
    shaded += clear < 0.9;
  }
  EXPECT_LE(sum / double(p.at.size()), 0.015);
  EXPECT_GT(shaded, 3u);
}

// Where all of the sky is hidden, nothing is left of it.
TEST(ApiSkyVisibility, IsNothingWithinAShell) {
  TriangleMesh floor;
  floor.positions = {{-0.2f, 0, -0.2f}, {-0.2f, 0, 0.2f}, {0.2f, 0, 0.2f}, {0.2f, 0, -0.2f}};
  floor.triangles = {{0, 1, 2}, {0, 2, 3}};
  const PlainScene s({make_sphere(), floor});
  std::vector<Vec3> at, normals;
  for (int i = 0; i < 100; ++i) {
    const float y = 1.0f - 0.02f * float(i) - 0.01f, r = std::sqrt(1.0f - y * y), a = 2.4f * float(i);
    at.push_back({0.05f, 0, 0.02f});
    normals.push_back({r * std::cos(a), y, r * std::sin(a)});
  }
  const std::vector<uint32_t> from(at.size(), 1);
  std::vector<float> shares(at.size(), -1.0f);
  ASSERT_EQ(
      ftSkyVisibility(s.scene, &at[0].x, 0, &normals[0].x, 0, from.data(), 0, at.size(), shares.data(), 0, nullptr, 0),
      FT_ERROR_NONE);
  for (const float share : shares) EXPECT_LE(share, 1e-5f);
}

TEST(ApiFields, AreTheSameFromAFile) {
  const test::TemporaryFolder folder;
  const std::string path = folder / "knot.vdb";
  const Rays rays = random_rays(3000, 7);
  std::vector<uint8_t> answers;
  int64_t baked = 0, loaded = 0;
  {
    const ApiScene s;
    ASSERT_EQ(ftBakeFields(s.scene), FT_ERROR_NONE);
    answers = ask(s.scene, rays, true);
    ASSERT_EQ(ftSaveField(s.scene, 0, path.c_str()), FT_ERROR_NONE);
    ASSERT_EQ(ftGetMeshInt(s.scene, 0, "cells_baked", &baked), FT_ERROR_NONE);
    EXPECT_EQ(ftSaveField(s.scene, 1, path.c_str()), FT_ERROR_INVALID_ARGUMENT);  // two triangles have no field
  }
  const ApiScene s;
  ASSERT_EQ(ftLoadField(s.scene, 0, path.c_str()), FT_ERROR_NONE);
  ASSERT_EQ(ftGetMeshInt(s.scene, 0, "cells_baked", &loaded), FT_ERROR_NONE);
  EXPECT_EQ(baked, loaded);
  EXPECT_GT(loaded, 0);
  EXPECT_EQ(ask(s.scene, rays, true), answers);
  ASSERT_EQ(ftGetMeshInt(s.scene, 0, "cells_baked", &loaded), FT_ERROR_NONE);
  EXPECT_EQ(baked, loaded);
}

// A mesh's number in a scene of it alone, which is committed.
int64_t number_of(const TriangleMesh& mesh, const char* name) {
  FTDevice device = nullptr;
  FTScene scene = nullptr;
  EXPECT_EQ(ftNewDevice(2, &device), FT_ERROR_NONE);
  EXPECT_EQ(ftNewScene(device, &scene), FT_ERROR_NONE);
  EXPECT_EQ(ftSetSceneInt(scene, "directions", 32), FT_ERROR_NONE);
  EXPECT_EQ(ftSetSceneInt(scene, "plane", 64), FT_ERROR_NONE);
  EXPECT_EQ(ftAddMesh(scene, &mesh.positions[0].x, 0, mesh.positions.size(), &mesh.triangles[0].x, 0,
                      mesh.triangles.size(), nullptr),
            FT_ERROR_NONE);
  EXPECT_EQ(ftAddInstance(scene, 0, nullptr, nullptr), FT_ERROR_NONE);
  EXPECT_EQ(ftCommitScene(scene), FT_ERROR_NONE);
  EXPECT_EQ(ftBakeFields(scene), FT_ERROR_NONE);
  int64_t value = -1;
  EXPECT_EQ(ftGetMeshInt(scene, 0, name, &value), FT_ERROR_NONE);
  EXPECT_EQ(ftReleaseScene(scene), FT_ERROR_NONE);
  EXPECT_EQ(ftReleaseDevice(device), FT_ERROR_NONE);
  return value;
}

// Buffers of positions that several meshes share.
TEST(ApiFields, DoNotDependOnPositionsThatNoTriangleUses) {
  const TriangleMesh knot = make_knot({.along = 64, .around = 8});
  TriangleMesh among = {{Vec3(1e4f), Vec3(-1e4f, 0, 3)}, {}, {}, {}};
  among.positions.insert(among.positions.end(), knot.positions.begin(), knot.positions.end());
  among.positions.push_back(Vec3(0, 1e5f, 0));
  for (const UVec3& t : knot.triangles) among.triangles.push_back(t + 2u);
  const int64_t certified = number_of(knot, "cells_certified");
  EXPECT_GT(certified, 0);
  EXPECT_EQ(number_of(among, "cells_certified"), certified);
}

// Cells would call themselves empty where none of their lines meets such a part.
TEST(ApiFields, AreNotMadeOfSmallParts) {
  const TriangleMesh ball = make_sphere({.around = 8, .along = 8});
  const auto scattered = [&](float radius) {
    TriangleMesh all;
    std::mt19937 random(3);
    std::uniform_real_distribution<float> x(-1.0f, 1.0f);
    for (int i = 0; i < 100; ++i) {
      const auto first = uint32_t(all.positions.size());
      const Vec3 centre(x(random), 0.0f, x(random));
      for (const Vec3& p : ball.positions) all.positions.push_back(centre + radius * p);
      for (const UVec3& t : ball.triangles) all.triangles.push_back(t + first);
    }
    return all;
  };
  EXPECT_GT(number_of(scattered(0.1f), "cells_full"), 0);
  EXPECT_EQ(number_of(scattered(0.01f), "cells_full"), 0);
}

TEST(ApiRender, IsThatOfTheRenderer) {
  const ApiScene s;
  const float from[] = {3, 3, 5}, to[] = {0, 0.8f, 0}, up[] = {0, 1, 0}, sky[] = {1, 1, 1};
  ASSERT_EQ(ftSetSceneCamera(s.scene, from, to, up, 45.0f, 24, 16), FT_ERROR_NONE);
  ASSERT_EQ(ftSetSceneSky(s.scene, sky), FT_ERROR_NONE);
  ASSERT_EQ(ftSetSceneInt(s.scene, "spp", 4), FT_ERROR_NONE);
  ASSERT_EQ(ftSetSceneInt(s.scene, "max_depth", 2), FT_ERROR_NONE);
  ASSERT_EQ(ftCommitScene(s.scene), FT_ERROR_NONE);
  std::vector<float> packed(24 * 16 * 3, -1.0f), spread(24 * 17 * 4, -1.0f);
  ASSERT_EQ(ftRender(s.scene, packed.data(), 0, 0), FT_ERROR_NONE);
  ASSERT_EQ(ftRender(s.scene, spread.data(), 4 * sizeof(float), 24 * 4 * sizeof(float)), FT_ERROR_NONE);
  double sum = 0.0;
  for (size_t i = 0; i < 24 * 16; ++i) {
    for (size_t c = 0; c < 3; ++c) EXPECT_EQ(packed[3 * i + c], spread[4 * i + c]);
    EXPECT_EQ(spread[4 * i + 3], -1.0f);
    sum += double(packed[3 * i]);
  }
  EXPECT_GT(sum, 0.2 * 24 * 16);
  EXPECT_LT(sum, 1.0 * 24 * 16);
}

// The mean of a picture of 8 x 8 pixels.
float mean_of_picture(const ApiScene& s) {
  std::vector<float> pixels(8 * 8 * 3, -1.0f);
  EXPECT_EQ(ftCommitScene(s.scene), FT_ERROR_NONE);
  EXPECT_EQ(ftRender(s.scene, pixels.data(), 0, 0), FT_ERROR_NONE);
  return std::accumulate(pixels.begin(), pixels.end(), 0.0f) / float(pixels.size());
}

TEST(ApiRender, ClipsNothingInAnyUnit) {
  for (const float unit : {1e-3f, 1.0f, 1e5f}) {
    SCOPED_TRACE(unit);
    const ApiScene s(/*commits=*/false);
    for (uint32_t i = 0; i < 3; ++i) {
      const float columns[12] = {unit, 0, 0, 0, unit, 0, 0, 0, unit, 0, 0, 0}, black[] = {0, 0, 0};
      ASSERT_EQ(ftSetInstanceTransform(s.scene, i, columns), FT_ERROR_NONE);
      ASSERT_EQ(ftSetInstanceReflectance(s.scene, i, black), FT_ERROR_NONE);
    }
    const float from[] = {0, 5 * unit, 0}, to[] = {0, 0, 0}, up[] = {1, 0, 0}, sky[] = {1, 1, 1};
    ASSERT_EQ(ftSetSceneCamera(s.scene, from, to, up, 40.0f, 8, 8), FT_ERROR_NONE);
    ASSERT_EQ(ftSetSceneSky(s.scene, sky), FT_ERROR_NONE);
    EXPECT_EQ(mean_of_picture(s), 0.0f);
  }
}

TEST(ApiRender, ASkyAndAReflectanceReplaceThoseBefore) {
  const ApiScene s;
  const float from[] = {0, 9, 0}, to[] = {0, 0, 0}, up[] = {1, 0, 0}, sky[] = {1, 1, 1}, black[] = {0, 0, 0};
  ASSERT_EQ(ftSetSceneCamera(s.scene, from, to, up, 120.0f, 8, 8), FT_ERROR_NONE);
  for (const float* colour : {sky, black}) ASSERT_EQ(ftSetSceneSky(s.scene, colour), FT_ERROR_NONE);
  EXPECT_EQ(mean_of_picture(s), 0.0f);
  for (uint32_t i = 0; i < 3; ++i) {
    for (const float* colour : {sky, black}) ASSERT_EQ(ftSetInstanceReflectance(s.scene, i, colour), FT_ERROR_NONE);
  }
  ASSERT_EQ(ftSetSceneSky(s.scene, sky), FT_ERROR_NONE);
  const float all = mean_of_picture(s);
  EXPECT_GT(all, 0.1f);  // the sky beside the floor
  EXPECT_LT(all, 0.95f);
}

// Whatever else the rays meet, and whether fields or rays answer.
TEST(ApiQueries, FlatMeshesDoNotHideRaysThatLeaveThem) {
  const ApiScene s;
  std::vector<Vec3> origins, directions;
  const Rays random = random_rays(500, 7);
  for (size_t i = 0; i < random.size(); ++i) {
    // From just below the floor, and from farther.
    origins.emplace_back(random.origins[i].x, i % 2 == 0 ? -1e-6f : -0.5f, random.origins[i].z);
    directions.push_back(Vec3(0.3f * random.directions[i].x, std::abs(random.directions[i].y) + 0.1f, 0.1f));
  }
  constexpr uint32_t k_floor = 2;
  const size_t n = origins.size();
  const std::vector<uint32_t> from(n, k_floor);
  std::vector<uint8_t> blocked(n), status(n);
  std::vector<float> t(n);
  std::vector<uint32_t> met(n);
  ASSERT_EQ(ftOccluded(s.scene, &origins[0].x, sizeof(Vec3), &directions[0].x, sizeof(Vec3), nullptr, 0, from.data(), 0,
                       n, blocked.data(), 0),
            FT_ERROR_NONE);
  ASSERT_EQ(ftNearest(s.scene, 1e-6f, &origins[0].x, sizeof(Vec3), &directions[0].x, sizeof(Vec3), nullptr, 0,
                      from.data(), 0, n, status.data(), 0, t.data(), 0, nullptr, 0, nullptr, 0, met.data(), 0),
            FT_ERROR_NONE);
  // The same rays from above the floor.
  Rays above;
  for (size_t i = 0; i < n; ++i) {
    const float begin = (1e-4f - origins[i].y) / directions[i].y;
    above.origins.push_back(origins[i] + begin * directions[i]);
    above.directions.push_back(directions[i]);
    above.t_max.push_back(k_infinity);
  }
  const Exact exact = trace(s.same.scene, above);
  size_t hits = 0;
  for (size_t i = 0; i < n; ++i) {
    EXPECT_EQ(blocked[i], exact.blocked[i] ? FT_BLOCKED : FT_CLEAR) << i;
    if (status[i] == FT_UNDECIDED_HIT) continue;
    ASSERT_EQ(status[i], exact.hits.instance[i] == k_none ? FT_MISS : FT_HIT) << i;
    if (status[i] != FT_HIT) continue;
    ++hits;
    EXPECT_EQ(met[i], exact.hits.instance[i]);
    EXPECT_NEAR(t[i], exact.hits.t[i] + (1e-4f - origins[i].y) / directions[i].y, 1e-3f);
  }
  EXPECT_GT(hits, 20u);
}

}  // namespace
}  // namespace fieldtrace
