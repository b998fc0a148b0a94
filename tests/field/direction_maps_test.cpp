// Direction maps: depths against rays, mipmaps of coverage against the depths, and bakes that end early.

#include "field/maps/direction_maps.h"

#include <gtest/gtest.h>

#include <chrono>
#include <thread>

#include "core/mesh/mesh_procedural.h"
#include "field/bake/cell_lines.h"
#include "field/store/field.h"
#include "tests/support/random_lines.h"

namespace fieldtrace {
namespace {

constexpr uint32_t k_shape = 0;

struct MappedMesh {
  Scene scene;
  std::unique_ptr<Accel> accel;
  DirectionMaps maps;
  BakeCounters counters;
  bool is_whole = false;

  MappedMesh(TriangleMesh mesh, const MapSize& size, const std::atomic<bool>* stop = nullptr)
      : maps(field_ball(mesh.bounds()), size) {
    Shape shape;
    shape.bounds = mesh.bounds();
    shape.mesh = std::move(mesh);
    scene.shapes.push_back(std::move(shape));
    accel = std::make_unique<Accel>(scene);
    is_whole = bake_maps(maps, *accel, k_shape, DMat3(1.0), stop, counters);
  }

  // Distance to the nearest hit; negative: a miss.
  float nearest(const Vec3& origin, const Vec3& direction) const {
    RayBatch rays;
    ShapeHits hits;
    rays.resize(1);
    hits.resize(1);
    rays.set(0, origin, direction, k_infinity);
    accel->shape_intersect(k_shape, rays, hits);
    return hits.t[0];
  }
};

// Bytes of all maps; those of depths follow those of coverage.
std::vector<uint8_t> bytes_of(const DirectionMaps& maps, int direction) {
  const MapsView view = maps.view();
  const uint8_t* const coverage = view.coverage + size_t(direction) * size_t(view.coverage_bytes);
  const uint8_t* const depth = view.depth + size_t(direction) * size_t(view.depth_bytes);
  std::vector<uint8_t> bytes(coverage, coverage + view.coverage_bytes);
  bytes.insert(bytes.end(), depth, depth + view.depth_bytes);
  return bytes;
}

class Maps : public testing::TestWithParam<const char*> {
 protected:
  static TriangleMesh mesh() {
    TriangleMesh mesh = std::string(GetParam()) == "knot" ? make_knot({.along = 192, .around = 16})
                                                          : make_supershape({.around = 96, .along = 48});
    for (Vec3& p : mesh.positions) p = p * 3.0f + Vec3(7.0f, -5.0f, 2.0f);  // units are those of the ball
    return mesh;
  }
};

// The rays start farther away than the bake's.
TEST_P(Maps, DepthsAreThoseOfRays) {
  const MappedMesh m(mesh(), {.directions = 16, .texels = 64});
  ASSERT_TRUE(m.is_whole);
  const Sphere ball = m.maps.ball();
  TestRandom random(11);
  int hits = 0, different = 0;
  constexpr int k_trials = 20000;
  for (int i = 0; i < k_trials; ++i) {
    const int u = int(random.index(16)), v = int(random.index(16)), x = int(random.index(64)),
              y = int(random.index(64));
    const CellFrame frame = cell_frame(u, v, 16);
    const float px = (float(x) + 0.5f) / 32.0f - 1.0f, py = (float(y) + 0.5f) / 32.0f - 1.0f;
    const uint16_t depth = m.maps.depths(u * 16 + v)[y * 64 + x];
    const Vec3 from = ball.centre + ball.radius * (frame.s * px + frame.t * py + frame.c * 3.0f);
    const float t = m.nearest(from, -frame.c);
    if ((t < 0.0f) != (depth == 0)) {
      ++different;
      continue;
    }
    if (depth == 0) continue;
    ++hits;
    const double z = 3.0 - double(t) / double(ball.radius);
    const double stored = double(depth - 1) / 65534.0 * 2.0 - 1.0;
    // Half a step of the depth, and the rounding of coordinates of up to 12 over a radius of 4.
    EXPECT_NEAR(stored, z, 1.0 / 65534.0 + 1e-5) << u << " " << v << " " << x << " " << y;
  }
  EXPECT_GT(hits, k_trials / 10);
  EXPECT_LT(hits, k_trials);
  // Lines that graze an edge may be rounded to either side of it.
  EXPECT_LE(different, 2);
}

// Each level against the depths themselves; 0 beyond the map.
TEST_P(Maps, CoverageIsTheMeanOfCoveredTexels) {
  for (const int texels : {8, 64, 128}) {
    const MappedMesh m(mesh(), {.directions = 4, .texels = texels});
    const MapsView view = m.maps.view();
    EXPECT_EQ(1 << view.levels, texels);
    for (int direction = 0; direction < 16; ++direction) {
      const uint16_t* const depth = m.maps.depths(direction);
      const uint8_t* const coverage = view.coverage + direction * view.coverage_bytes;
      int32_t end = 0;
      for (int level = 1; level <= view.levels; ++level) {
        const int n = texels >> level, side = 1 << level;
        const auto share = [&](int column, int row) {
          if (column < 0 || row < 0 || column >= n || row >= n) return 0.0;
          int covered = 0;
          for (int i = 0; i < side * side; ++i) {
            covered += depth[(row * side + i / side) * texels + column * side + i % side] != 0;
          }
          return double(covered) / double(side * side);
        };
        ASSERT_EQ(view.level_begin[level - 1], end);
        end += 4 * (n + 1) * (n + 1);
        for (int i = 0; i < 4 * (n + 1) * (n + 1); ++i) {
          const int column = i / 4 % (n + 1) - 1 + i % 2, row = i / 4 / (n + 1) - 1 + i % 4 / 2;
          const double error = double(coverage[view.level_begin[level - 1] + i]) - 255.0 * share(column, row);
          ASSERT_LE(std::abs(error), 0.5 + 1e-4) << texels << " " << level << " " << column << " " << row;
        }
      }
      EXPECT_EQ(view.coverage_bytes, end);
    }
  }
}

// Every map is whole or untouched, whenever a bake was stopped.
TEST_P(Maps, StoppedBakesLeaveWholeAndEmptyMaps) {
  const MapSize size = {.directions = 32, .texels = 64};
  const MappedMesh whole(mesh(), size);
  std::atomic<bool> stop = true;
  const MappedMesh none(mesh(), size, &stop);
  EXPECT_FALSE(none.is_whole);
  EXPECT_EQ(none.counters.rays, 0u);
  stop = false;
  std::thread stopper([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(15));
    stop = true;
  });
  const MappedMesh some(mesh(), size, &stop);
  stopper.join();
  // Stopped or, on a machine that did not let the other thread run, whole.
  EXPECT_EQ(some.is_whole, some.counters.rays == whole.counters.rays);
  uint64_t whole_maps = 0;
  for (int direction = 0; direction < 32 * 32; ++direction) {
    const std::vector<uint8_t> bytes = bytes_of(some.maps, direction), expected = bytes_of(whole.maps, direction);
    const std::vector<uint8_t> empty(expected.size(), 0);
    EXPECT_NE(expected, empty);
    EXPECT_EQ(bytes_of(none.maps, direction), empty);
    whole_maps += bytes == expected;
    EXPECT_TRUE(bytes == expected || bytes == empty) << direction;
  }
  EXPECT_EQ(some.counters.rays, whole.counters.rays / (32 * 32) * whole_maps);
}

INSTANTIATE_TEST_SUITE_P(Meshes, Maps, testing::Values("knot", "supershape"),
                         [](const auto& instance) { return std::string(instance.param); });

TEST(DirectionMaps, OfNothingAreEmpty) {
  TriangleMesh point;
  point.positions = {Vec3(0.0f), Vec3(0.0f), Vec3(0.0f)};
  point.triangles = {UVec3(0, 1, 2)};
  TriangleMesh none = point;
  none.triangles.clear();
  for (const TriangleMesh& mesh : {point, none}) {
    const MappedMesh m(mesh, {.directions = 4, .texels = 8});
    EXPECT_TRUE(m.is_whole);
    for (int direction = 0; direction < 16; ++direction) {
      for (const uint8_t byte : bytes_of(m.maps, direction)) EXPECT_EQ(byte, 0);
    }
  }
}

TEST(DirectionMaps, BytesAreThoseOfTheView) {
  for (const int texels : {8, 16, 64, 256}) {
    const MapSize size = {.directions = 2, .texels = texels};
    const DirectionMaps maps({Vec3(0.0f), 1.0f}, size);
    const MapsView view = maps.view();
    EXPECT_EQ(maps.bytes(), 4u * uint64_t(view.depth_bytes + view.coverage_bytes));
    EXPECT_LE(view.levels, k_most_coverage_levels);
  }
}

}  // namespace
}  // namespace fieldtrace
