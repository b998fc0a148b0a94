// What a batch of points shares of a cell: it changes nothing, and rays confirm it.

#include "hybrid/sky/cell_occluders.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "core/mesh/mesh_procedural.h"
#include "core/trace/rays.h"
#include "field/bake/cell_lines.h"
#include "tests/support/random_lines.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace {
namespace {

constexpr int k_directions = 8, k_texels = 32;

// A turned knot over a square floor under a sky that is bright at the horizon, so that its cells there have parts.
struct Under : test::SceneMaker {
  uint32_t floor, knot;
  std::unique_ptr<Accel> accel;
  std::unique_ptr<SkyMaps> maps;
  // What is farther than 1 hides nothing of the second; objects send light back to the third.
  std::unique_ptr<Sky> sky, near_sky, lit_sky;

  Under() {
    const uint32_t grey = bsdf(BsdfKind::diffuse, Rgb(0.5f));
    floor = instance(shape(ShapeKind::rectangle), grey, test::scaling(Vec3(8.0f)));
    const float c = std::cos(0.6f), s = std::sin(0.6f);
    knot = instance(mesh(make_knot({.along = 192, .around = 16})), grey,
                    Affine(Vec3(c, 0, -s), Vec3(0, 1, 0), Vec3(s, 0, c), Vec3(0, 0, 1.2f)));
    environment(
        64, 33,
        [](int, int y) {
          const float up = std::cos(k_pi * float(y) / 32.0f);
          return Rgb(0.2f + 20.0f * std::exp(-150.0f * up * up));
        },
        Mat3(Vec3(1, 0, 0), Vec3(0, 0, 1), Vec3(0, -1, 0)));
    accel = std::make_unique<Accel>(scene);
    const std::vector<ShapeTraits> traits = shape_traits(scene);
    MappedShapes shapes = mapped_shapes(scene, traits);
    std::vector<std::shared_ptr<DirectionMaps>> baked;
    for (const MappedShape& of : shapes.shapes) {
      baked.push_back(std::make_unique<DirectionMaps>(of.ball, MapSize{k_directions, k_texels}));
      BakeCounters counters;
      bake_maps(*baked.back(), *accel, of.shape, DMat3(1.0), nullptr, counters);
    }
    maps = std::make_unique<SkyMaps>(scene, traits, std::move(shapes), std::move(baked), k_directions, SkyTolerance());
    sky = std::make_unique<Sky>(*maps, SkyRadiance(scene));
    near_sky = std::make_unique<Sky>(*maps, SkyRadiance(scene), 1.0f);
    lit_sky = std::make_unique<Sky>(*maps, SkyRadiance(scene));
    lit_sky->set_indirect(random_light(traits));
  }

  std::shared_ptr<const IndirectLight> random_light(std::span<const ShapeTraits> traits) const {
    const std::vector<uint8_t> sends(scene.instances.size(), 1);
    const auto light =
        std::make_shared<IndirectLight>(scene, *accel, *maps, traits, sends, std::span<const Vec3>(), 16);
    TestRandom random(5);
    for (size_t i = 0; i < light->size(); ++i) {
      std::vector<Rgb> radiance(light->surfels(i).points.size());
      for (Rgb& r : radiance) r = Rgb(random.uniform(), random.uniform(), random.uniform());
      light->set_radiance(i, radiance);
    }
    light->finish();
    return light;
  }

  // Points on `on` that rays from about `at` meet, padded as the kernels want them.
  ShadingPointBatch points_on(uint32_t on, const Vec3& at, size_t count, TestRandom& random) const {
    ShadingPointBatch points;
    points.resize(count);
    for (points.size = 0; points.size < count;) {
      const Vec3 from = at + random.in_ball() * 0.3f;
      RayBatch rays;
      HitBatch hits;
      rays.resize(1), hits.resize(1);
      const Vec3 aim = Vec3(0, 0, on == floor ? 0.0f : 1.2f) + random.in_ball() * 0.5f;
      rays.set(0, from, glm::normalize(aim - from), k_infinity);
      accel->intersect(rays, hits, Coherence::incoherent);
      if (hits.instance[0] != on) continue;
      const size_t i = points.size++;
      const Vec3 p = from + rays.direction(0) * hits.t[0];
      const TriangleMesh& of = scene.shapes[scene.instances[on].shape].mesh;
      const auto corner = [&](int k) { return of.positions[of.triangles[hits.primitive[0]][k]]; };
      const Mat3 turn(scene.instances[on].to_world);  // turns and even scaling alone
      Vec3 n = glm::normalize(turn * glm::cross(corner(1) - corner(0), corner(2) - corner(0)));
      if (glm::dot(n, rays.direction(0)) > 0.0f) n = -n;
      points.px[i] = p.x, points.py[i] = p.y, points.pz[i] = p.z;
      points.gx[i] = points.sx[i] = n.x, points.gy[i] = points.sy[i] = n.y, points.gz[i] = points.sz[i] = n.z;
      points.instance[i] = on;
    }
    for (size_t i = count; i < padded(count); ++i) points.copy(i, points, 0);
    return points;
  }
};

struct Sums {
  AlignedVector<float> values[6];
  std::vector<std::pair<uint32_t, uint32_t>> undecided;  // cell, point

  explicit Sums(size_t size) {
    for (auto& v : values) v.assign(size, 0.0f);
  }
  CellSums view() {
    return {values[0].data(), values[1].data(), values[2].data(), values[3].data(), values[4].data(), values[5].data()};
  }
};

// What points see with what their cells share is what each cell's task alone says.
TEST(CellOccluders, SharingChangesNothing) {
  const Under scene;
  TestRandom random(3);
  const std::vector<Isa> isas = supported_isas();
  CellOccluders occluders;
  CellScratch scratch;
  std::array<size_t, 3> shared = {};
  size_t undecided = 0, reflected = 0;
  for (size_t trial = 0; trial < 240; ++trial) {
    const Isa isa = isas[trial % isas.size()];
    const size_t kind = trial / 5 % 3;
    const Sky& sky = *std::array{scene.sky.get(), scene.near_sky.get(), scene.lit_sky.get()}[kind];
    const uint32_t on = trial / 15 % 3 ? scene.knot : scene.floor;
    const Vec3 at = random.direction() * 4.0f * Vec3(1, 1, 0.4f) + Vec3(0, 0, 3);
    const ShadingPointBatch points = scene.points_on(on, at, 1 + random.index(60), random);
    const size_t size = padded(points.size);
    occluders.find(sky, points, scene.maps->place(on, at));
    Sums expected(size), found(size);
    AlignedVector<int32_t> listed(size + k_batch_padding);
    uint64_t alone = 0;
    for (uint32_t k = 0; k < occluders.cells().size(); ++k) {
      if (occluders.is_clear(k)) continue;
      OwnObject own;
      const CellTask task = occluders.task(k, own);
      EXPECT_TRUE(task.clear > 0.0f || &sky == scene.sky.get());
      const int open = occluders.kernel_for(isa)(task, cell_points(points), expected.view(), listed.data());
      alone += uint64_t(task.map_count + (task.own != nullptr)) * points.size;
      for (int j = 0; j < open; ++j) {
        if (size_t(listed[size_t(j)]) < points.size) expected.undecided.emplace_back(k, uint32_t(listed[size_t(j)]));
      }
    }
    const uint64_t lookups =
        occluders.see(isa, cell_points(points), found.view(), scratch,
                      [&](const CellTask&, size_t k, uint32_t i) { found.undecided.emplace_back(uint32_t(k), i); });
    if (&sky == scene.near_sky.get()) {
      EXPECT_EQ(lookups, alone);
    } else {
      EXPECT_LE(lookups, alone);
    }
    shared[kind] += lookups < alone, undecided += found.undecided.size();
    ASSERT_EQ(found.undecided, expected.undecided) << trial;
    reflected += found.values[3][0] > 0.0f;
    for (int channel = 0; channel < 6; ++channel) {
      for (size_t i = 0; i < points.size; ++i) {
        ASSERT_EQ(found.values[channel][i], expected.values[channel][i]) << trial << " " << i;
      }
    }
  }
  EXPECT_GT(shared[0], 20u);
  EXPECT_GT(shared[2], 20u);
  EXPECT_GT(undecided, 100u);
  EXPECT_GT(reflected, 20u);
}

// Of a cell that a parallelogram hides from all points, it blocks all rays by itself.
TEST(CellOccluders, HiddenCellsAreHiddenFromAllPoints) {
  const Under scene;
  TestRandom random(4);
  Scene alone = scene.scene;
  alone.instances.resize(1);
  const Accel floor(alone);
  CellOccluders occluders;
  size_t hidden = 0, below = 0;
  for (int trial = 0; trial < 60; ++trial) {
    const Vec3 at = random.direction() * 4.0f * Vec3(1, 1, 0.4f) + Vec3(0, 0, 3);
    const ShadingPointBatch points = scene.points_on(scene.knot, at, 1 + random.index(60), random);
    occluders.find(*scene.sky, points, scene.maps->place(scene.knot, at));
    RayBatch rays;
    rays.resize(0);
    std::vector<Vec3> origins, directions;
    for (size_t k = 0; k < occluders.cells().size(); ++k) {
      const SkyCell& cell = occluders.cell(k);
      below += occluders.direction(k).z < -0.3f;
      OwnObject own;
      if (occluders.task(k, own).clear > 0.0f) continue;
      ++hidden;
      const Mat3& grid = scene.maps->occluders()[scene.knot].cells;
      for (int r = 0; r < 9; ++r) {
        const Vec3 d = grid * direction_in_cell(cell.u, cell.v, 0.5f * float(r / 3), 0.5f * float(r % 3), cell.side);
        const size_t i = random.index(uint32_t(points.size));
        const Vec3 n(points.gx[i], points.gy[i], points.gz[i]);
        if (glm::dot(d, n) <= 0.0f) continue;
        origins.push_back(Vec3(points.px[i], points.py[i], points.pz[i]) + n * 1e-4f);
        directions.push_back(d);
      }
    }
    rays.resize(origins.size());
    std::vector<uint32_t> indices;
    for (size_t i = 0; i < origins.size(); ++i) {
      rays.set(i, origins[i], directions[i], k_infinity);
      indices.push_back(uint32_t(i));
    }
    AlignedVector<uint8_t> blocked(padded(origins.size()), 0);
    floor.occluded(rays, indices, blocked.data());
    EXPECT_EQ(std::count(blocked.begin(), blocked.begin() + ptrdiff_t(origins.size()), 1), ptrdiff_t(origins.size()))
        << trial;
  }
  // Most of those that head for the floor are found.
  EXPECT_GT(hidden, below / 2);
  EXPECT_GT(below, 500u);
}

}  // namespace
}  // namespace fieldtrace
