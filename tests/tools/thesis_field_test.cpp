// The thesis' field: baked contents, look-ups, and parity of all instruction sets.
#include "field/thesis/thesis_field.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <numeric>

#include "core/mesh/mesh_procedural.h"
#include "field/file/thesis_file.h"
#include "field/query/query.hd.h"
#include "field/thesis/chart_thesis.hd.h"
#include "field/thesis/thesis_kernels.h"
#include "tests/support/random_lines.h"
#include "tools/thesis/cases.h"

namespace fieldtrace {
namespace {

struct BakedScene {
  PhongScene scene;
  std::unique_ptr<Accel> accel;
  std::unique_ptr<ThesisField> field;

  BakedScene(TriangleMesh mesh, int m, const Vec3& shift = Vec3(0.0f), float scale = 1.0f, float turn = 0.0f) {
    add_phong_instance(scene, add_phong_shape(scene, "object", std::move(mesh)), {}, shift, scale, turn);
    accel = std::make_unique<Accel>(scene.geometry);
    field = std::make_unique<ThesisField>(*bake_thesis_field(*accel, scene.geometry, 0, m));
  }
  ThesisInstanceView view() const { return thesis_instance_view(*field, scene.geometry.instances[0], 0); }
};

struct Answers {
  ThesisHits hits;
  RayStates shadows;
  SegmentCounts counts;
  bool hidden(size_t i) const { return (shadows.state[i] & RayStates::k_blocked) != 0; }
};

Answers query(const ThesisKernels& kernels, const ThesisInstanceView& view, const RayBatch& rays,
              const AlignedVector<uint32_t>& skip) {
  Answers a;
  a.hits.resize(rays.size);
  std::fill(a.hits.t.begin(), a.hits.t.end(), k_infinity);
  for (auto* n : {&a.hits.nx, &a.hits.ny, &a.hits.nz}) std::fill(n->begin(), n->end(), 0.0f);
  std::fill(a.hits.instance.begin(), a.hits.instance.end(), k_none);
  kernels.nearest(view, rays, skip, a.hits);
  a.shadows.keep_verdicts = true;
  a.shadows.reset(rays.size);
  a.counts = kernels.shadow(view, rays, 0, padded(rays.size), 0, a.shadows);
  return a;
}

// Rays at the object from all around, including ones from inside, along axes, past it, and inactive ones.
RayBatch random_rays(size_t count, uint32_t seed, const Vec3& centre, float radius) {
  TestRandom random(seed);
  RayBatch rays;
  rays.resize(count);
  for (size_t i = 0; i < count; ++i) {
    Vec3 d = random.direction();
    const uint32_t kind = random.index(16);
    if (kind == 0) d[int(random.index(3))] = 0.0f;
    if (kind == 1) d = Vec3(0.0f, 0.0f, -1.0f);
    const float away = kind == 2 ? 0.2f : random.log_uniform(1.5f, 100.0f);
    const Vec3 through = centre + radius * 1.1f * random.in_ball();
    rays.set(i, through - d * (away * radius), d * random.log_uniform(0.01f, 100.0f), kind == 3 ? -1.0f : 1.0f);
  }
  return rays;
}

TEST(ThesisField, HasTheThesisSize) {
  const double mb = 1024.0 * 1024.0;
  for (const auto& [m, distances, normals] : {std::tuple{32, 4.13, 12.38}, {64, 16.51, 49.52}, {128, 66.03, 198.09}}) {
    const ThesisField field({Vec3(0.0f), 1.0f}, m);
    EXPECT_EQ(field.samples(), size_t(4226) * size_t(m) * size_t(m));
    EXPECT_NEAR(double(field.bytes_distance()) / mb, distances, 0.005);
    EXPECT_NEAR(double(field.bytes_normal()) / mb, normals, 0.005);
  }
}

TEST(ThesisField, SamplesOfASphereAreItsDistancesAndNormals) {
  // Radius .5 in a ball that a distant vertex widens to 1.
  TriangleMesh mesh = make_sphere({.radius = 0.5f, .around = 256, .along = 128});
  const uint32_t first = uint32_t(mesh.positions.size());
  for (const Vec3& p : {Vec3(1, 0, 0), Vec3(-1, 0, 0)}) {
    mesh.positions.insert(mesh.positions.end(),
                          {p, p - 1e-3f * p + Vec3(0, 1e-3f, 0), p - 1e-3f * p + Vec3(0, 0, 1e-3f)});
    mesh.normals.insert(mesh.normals.end(), 3, p);
  }
  mesh.texcoords.clear();
  mesh.triangles.push_back({first, first + 1, first + 2});
  mesh.triangles.push_back({first + 3, first + 4, first + 5});
  const BakedScene baked(mesh, 32);
  const ThesisFieldView view = baked.field->view();
  const float radius = baked.field->ball().radius;
  EXPECT_NEAR(radius, 1.0f, 1e-4f);
  int hits = 0, misses = 0;
  for (int position = 7; position < scalar::k_thesis_positions; position += 13) {
    for (int v = 0; v < 32; ++v) {
      for (int u = 0; u < 32; ++u) {
        const auto ray = scalar::ray_of_address<float>({position, u, v}, view.directions);
        const DVec3 o(ray.point.x, ray.point.y, ray.point.z), d(ray.direction.x, ray.direction.y, ray.direction.z);
        if (std::abs(o.x) > 0.98) continue;  // the two slivers
        const double along = -glm::dot(o, d), off = 1.0 - along * along;
        if (std::abs(off - 0.25) < 0.002) continue;  // the silhouette of the mesh
        const size_t i = (size_t(position) * 32 + size_t(v)) * 32 + size_t(u);
        if (off > 0.25) {
          ++misses;
          ASSERT_EQ(view.distance[i], k_thesis_miss);
          continue;
        }
        ++hits;
        const double depth = along - std::sqrt(0.25 - off);
        // Half a quantisation step, plus the chords of the mesh.
        ASSERT_NEAR(view.distance[i] * 2.0 / 254.0, depth, 1.0 / 254.0 + 0.01);
        const DVec3 n = glm::normalize(o + d * depth);
        for (int axis = 0; axis < 3; ++axis) {
          ASSERT_NEAR((view.normal[3 * i + size_t(axis)] - 127) / 127.0, n[axis], 0.02);
        }
      }
    }
  }
  EXPECT_GT(hits, 10000);
  EXPECT_GT(misses, 10000);
}

TEST(ThesisField, LookUpsAgreeWithEmbreeWithinTheSlack) {
  // A sphere has no ridges: where both hit, away from the silhouette, depths agree within the slack.
  const BakedScene baked(make_sphere({.radius = 0.7f}), 64, {3.0f, -2.0f, 1.0f}, 2.5f, 40.0f);
  const RayBatch rays = random_rays(20000, 5, {3.0f, -2.0f, 1.0f}, 2.0f);
  const Answers a =
      query(thesis_kernels_scalar(), baked.view(), rays, AlignedVector<uint32_t>(padded(rays.size), k_none));
  HitBatch exact;
  exact.resize(rays.size);
  RayBatch long_rays = rays;
  for (size_t i = 0; i < rays.size; ++i) long_rays.tmax[i] = k_infinity;
  baked.accel->intersect(long_rays, exact, Coherence::incoherent);
  int agree = 0, both = 0, differ = 0;
  for (size_t i = 0; i < rays.size; ++i) {
    if (rays.tmax[i] < 0.0f) {
      ASSERT_EQ(a.hits.instance[i], k_none);
      continue;
    }
    const Vec3 o = rays.origin(i), d = rays.direction(i);
    if (glm::length(o - Vec3(3.0f, -2.0f, 1.0f)) < 1.8f) continue;  // starts inside: the field sees another surface
    const bool found = a.hits.instance[i] == 0, hit = exact.instance[i] == 0;
    differ += found != hit;
    if (!found || !hit) continue;
    ++both;
    const Vec3 p = o + d * exact.t[i];
    const float facing = -glm::dot(glm::normalize(p - Vec3(3.0f, -2.0f, 1.0f)), glm::normalize(d));
    if (facing < 0.8f) continue;
    ++agree;
    // The ball's radius is 1.75, the unit of the slack.
    ASSERT_LT(std::abs(a.hits.t[i] - exact.t[i]) * glm::length(d), 1.75f * thesis_slack(64));
    ASSERT_GT(glm::dot(Vec3(a.hits.nx[i], a.hits.ny[i], a.hits.nz[i]), glm::normalize(p - Vec3(3.0f, -2.0f, 1.0f))),
              0.98f);
  }
  EXPECT_GT(agree, 2000);
  EXPECT_LT(differ, both / 20);
}

TEST(ThesisField, ShadowsAgreeWithEmbreeAwayFromEdges) {
  // Shading points around and behind a ball, lights in front of it, at finite and infinite distance.
  const BakedScene baked(make_sphere({.radius = 0.7f}), 64, {3.0f, -2.0f, 1.0f}, 2.5f, 40.0f);
  const Vec3 centre(3.0f, -2.0f, 1.0f);
  TestRandom random(15);
  RayBatch rays;
  rays.resize(20000);
  for (size_t i = 0; i < rays.size; ++i) {
    const Vec3 shading_point = centre + random.direction() * random.uniform(1.9f, 8.0f);
    const Vec3 d = centre + 3.0f * random.in_ball() - shading_point;
    const uint32_t kind = random.index(4);
    // Lights in front of the ball, behind it and at infinity, and inactive rays.
    rays.set(i, shading_point, d, kind == 0 ? 0.05f : kind == 1 ? 50.0f : kind == 2 ? k_infinity : -1.0f);
  }
  const Answers a =
      query(thesis_kernels_scalar(), baked.view(), rays, AlignedVector<uint32_t>(padded(rays.size), k_none));
  std::vector<uint32_t> all(rays.size);
  std::iota(all.begin(), all.end(), 0u);
  std::vector<uint8_t> exact(padded(rays.size), 0);
  RayBatch traced = rays;
  for (size_t i = 0; i < rays.size; ++i) traced.tmax[i] = std::max(traced.tmax[i], 0.0f);
  baked.accel->occluded(traced, all, exact.data());
  size_t blocked = 0, wrong = 0, crossing = 0;
  for (size_t i = 0; i < rays.size; ++i) {
    if (rays.tmax[i] < 0.0f) {
      ASSERT_EQ(a.shadows.state[i], 0);
      ASSERT_EQ(a.shadows.verdict[i], scalar::k_verdict_none);
      continue;
    }
    crossing += (a.shadows.state[i] & RayStates::k_crosses) != 0;
    const Vec3 light = rays.origin(i) + rays.tmax[i] * rays.direction(i);
    if (glm::length(light - centre) < 1.76f) continue;  // within the ball: the field cannot see what it lights
    blocked += exact[i] != 0;
    if (a.hidden(i) == (exact[i] != 0)) continue;
    ++wrong;
    // Errors only near the silhouette: within the slack, in units of the ball's radius of 1.75.
    const Vec3 o = rays.origin(i) - centre, d = glm::normalize(rays.direction(i));
    const float beside = glm::length(o - d * glm::dot(o, d)) / 1.75f;
    ASSERT_NEAR(beside, 1.0f, thesis_slack(64)) << i;
  }
  EXPECT_EQ(crossing, a.counts.crossings);
  EXPECT_GT(blocked, 1500u);
  EXPECT_LT(wrong, blocked / 10);
}

TEST(ThesisField, LookUpsAgreeOnEveryInstructionSet) {
  const BakedScene baked(thesis_supershape_2(48, 24), 32, {0.3f, 0.2f, -5.0f}, 1.5f, 75.0f);
  const RayBatch rays = random_rays(1 << 16, 6, {0.3f, 0.2f, -5.0f}, 1.5f);
  AlignedVector<uint32_t> skip(padded(rays.size), k_none);
  for (size_t i = 0; i < skip.size(); i += 7) skip[i] = 0;
  const ThesisInstanceView view = baked.view();
  const Answers reference = query(thesis_kernels_scalar(), view, rays, skip);
  size_t hits = 0, hidden = 0;
  for (size_t i = 0; i < rays.size; ++i) {
    hits += reference.hits.instance[i] == 0;
    hidden += reference.hidden(i);
    if (i % 7 == 0) {
      ASSERT_EQ(reference.hits.instance[i], k_none);
    }
  }
  EXPECT_GT(hits, rays.size / 10);
  EXPECT_GT(hidden, 100u);
  EXPECT_LT(hidden, hits);
  const auto expect_same = [](const auto& a, const auto& b, const char* what, Isa isa) {
    size_t different = 0;
    for (size_t i = 0; i < a.size(); ++i) different += std::memcmp(&a[i], &b[i], sizeof(a[i])) != 0;
    EXPECT_EQ(different, 0u) << what << " on " << isa_name(isa);
  };
  for (const Isa isa : supported_isas()) {
    const Answers a = query(thesis_kernels(isa), view, rays, skip);
    expect_same(reference.hits.t, a.hits.t, "t", isa);
    expect_same(reference.hits.instance, a.hits.instance, "instance", isa);
    expect_same(reference.hits.nx, a.hits.nx, "nx", isa);
    expect_same(reference.hits.ny, a.hits.ny, "ny", isa);
    expect_same(reference.hits.nz, a.hits.nz, "nz", isa);
    expect_same(reference.shadows.state, a.shadows.state, "state", isa);
    expect_same(reference.shadows.verdict, a.shadows.verdict, "verdict", isa);
    EXPECT_EQ(reference.counts.crossings, a.counts.crossings) << isa_name(isa);
  }
}

TEST(ThesisField, BakingStopsWhenAsked) {
  const BakedScene baked(make_sphere({.around = 8, .along = 6}), 2);
  const std::atomic<bool> stop = true;
  EXPECT_FALSE(bake_thesis_field(*baked.accel, baked.scene.geometry, 0, 32, {.progress = {}, .stop = &stop}));
  float last = 0.0f;
  EXPECT_TRUE(bake_thesis_field(*baked.accel, baked.scene.geometry, 0, 2,
                                {.progress =
                                     [&](float share) {
                                       EXPECT_GT(share, last);
                                       last = share;
                                     },
                                 .stop = nullptr}));
  EXPECT_EQ(last, 1.0f);
}

std::string temporary_vdb() {
  return (std::filesystem::temp_directory_path() / ("thesis-" + std::to_string(getpid()) + ".vdb")).string();
}

TEST(ThesisField, FileIsSmallerThanTheSamplesAndHoldsThem) {
  const BakedScene baked(thesis_supershape_1(32, 16), 32);
  const std::string path = temporary_vdb();
  const FieldIdentity identity = thesis_identity(baked.scene.geometry.shapes[0], 32);
  const uint64_t bytes = save_thesis_field(*baked.field, identity, path);
  EXPECT_EQ(bytes, std::filesystem::file_size(path));
  EXPECT_GT(bytes, 1000u);
  EXPECT_LT(bytes, 4 * baked.field->samples());
  EXPECT_EQ(field_file_chart(path), k_chart_thesis);
  const ThesisField loaded = load_thesis_field(identity, path);
  EXPECT_EQ(loaded.ball().centre, baked.field->ball().centre);
  EXPECT_EQ(loaded.ball().radius, baked.field->ball().radius);
  EXPECT_FALSE(loaded.has_normals());
  EXPECT_EQ(std::memcmp(loaded.view().distance, baked.field->view().distance, loaded.samples()), 0);
  const ThesisFileInfo info = thesis_file_info(path);
  EXPECT_TRUE(info.has_normals);
  EXPECT_EQ(info.bytes_disk, bytes);
  EXPECT_EQ(info.samples, baked.field->samples());
  EXPECT_EQ(info.misses, uint64_t(std::count(loaded.view().distance, loaded.view().distance + loaded.samples(),
                                             uint8_t(k_thesis_miss))));
  std::filesystem::remove(path);
}

TEST(ThesisField, FilesThatAreNotTheFieldAreRefused) {
  const BakedScene baked(make_sphere({.around = 8, .along = 6}), 32);
  const std::string path = temporary_vdb();
  const Shape& shape = baked.scene.geometry.shapes[0];
  const FieldIdentity identity = thesis_identity(shape, 32);
  EXPECT_NE(identity.file_name(), field_identity(shape, {.directions = 32}).file_name());
  save_thesis_field(*baked.field, identity, path);
  EXPECT_THROW(load_thesis_field(thesis_identity(shape, 64), path), FieldFileError);
  Shape other = shape;
  other.mesh.positions[0].x += 1.0f;
  EXPECT_THROW(load_thesis_field(thesis_identity(other, 32), path), FieldFileError);
  // The orthographic chart's reader rejects the file too.
  EXPECT_THROW(FieldFile{path}, FieldFileError);
  std::fstream(path, std::ios::binary | std::ios::in | std::ios::out).seekp(2000).put('x').put('y');
  EXPECT_THROW(load_thesis_field(identity, path), FieldFileError);
  EXPECT_THROW(load_thesis_field(identity, path + ".missing"), FieldFileError);
  std::filesystem::remove(path);
}

}  // namespace
}  // namespace fieldtrace
