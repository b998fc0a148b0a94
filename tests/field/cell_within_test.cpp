// What shading points see of direction cells within a distance: against exact rays, against cells without a distance,
// and the same bits on every instruction set.

#include "field/maps/cell_within.hd.h"

#include <gtest/gtest.h>

#include <bit>

#include "core/mesh/mesh_procedural.h"
#include "core/simd/vec_lanes.h"
#include "tests/support/mapped_mesh.h"

namespace fieldtrace {
namespace {

using namespace test;

constexpr int k_directions = 32, k_cells = k_directions * k_directions;

MapLines lines_within(const MapsView& view, int cell, float distance) {
  MapLines lines = lines_of(view, cell, k_directions, 2.0f);
  lines.within = distance;
  lines.back_begin = opposite_cell(cell, k_directions) * view.depth_bytes;
  return lines;
}

// Infinite planes hide the cone about their normal whose rays reach them: what cells count, weighted by the cosine to
// the normal, adds up to 1 - (h / D)^2 of half of the sphere's.
TEST(SharesOfPlanesWithin, AreAConeAboutTheNormal) {
  TestRandom random(51);
  for (const int directions : {16, 32}) {
    for (int trial = 0; trial < 200; ++trial) {
      const Vec3 n = random.direction(), x = glm::normalize(glm::cross(n, random.direction()));
      const float height = random.log_uniform(0.01f, 10.0f), distance = height * random.log_uniform(1.01f, 100.0f);
      const Parallelogram q = {n * -height, x * 1e4f, glm::cross(n, x) * 1e4f};
      double sum = 0.0, all = 0.0;
      for (int cell = 0; cell < directions * directions; ++cell) {
        const Vec3 d = direction_in(cell, directions, 0.5f, 0.5f);
        const PlaneLines lines = q.lines(d);
        const float half = 0.5f * cell_width(directions);
        const float share = scalar::share_of_slope<float>(lines, lines.centre, half, lanes(Vec3(0.0f)));
        const float part = scalar::share_of_plane_within<float>(lines, share, half, distance, lanes(Vec3(0.0f)));
        EXPECT_GE(part, 0.0f);
        EXPECT_LE(part, share);
        const double cosine = std::max(-glm::dot(d, n), 0.0f);
        sum += cosine * double(part), all += cosine;
        // Far cones end at the plane's horizon.
        const float far = scalar::share_of_plane_within<float>(lines, share, half, 1e6f * height, lanes(Vec3(0.0f)));
        EXPECT_NEAR(far, share, 0.02f);
      }
      const double c = double(height) / double(distance);
      EXPECT_NEAR(sum / all, 1.0 - c * c, directions == 16 ? 0.01 : 0.004) << height << " " << distance;
    }
  }
}

class WithinDistance : public testing::TestWithParam<const char*> {
 protected:
  static TriangleMesh mesh() {
    const std::string name = GetParam();
    if (name == "knot") return make_knot({.along = 256, .around = 24});
    if (name == "sphere") return make_sphere({.around = 96, .along = 48});
    return make_supershape({.around = 96, .along = 48});
  }
  const MappedMesh mapped_{mesh(), {.directions = k_directions, .texels = 64}};
  const MapsView view_ = mapped_.maps->view();
};

// Of distances that end before the object, in it, and behind it; from outside of its ball maps decide all.
TEST_P(WithinDistance, SharesFromOutsideAreNearThoseOfRays) {
  TestRandom random(52);
  ShareErrors all;
  double sum = 0.0, exact_sum = 0.0;
  for (int trial = 0; trial < 48; ++trial) {
    const float from = random.log_uniform(1.05f, 8.0f);
    const float distance = from + random.uniform(-1.2f, 1.2f);
    if (!(distance > 0.0f)) continue;
    const Vec3 p = random.direction() * from;
    double total = 0.0, exact_total = 0.0;
    for (int cell = 0; cell < k_cells; ++cell) {
      const auto share = scalar::share_of_map_within<float>(lines_within(view_, cell, distance), lanes(p), {});
      const float cosine = std::clamp(-glm::dot(direction_in(cell, k_directions, 0.5f, 0.5f), p) / from, -1.0f, 1.0f);
      if (std::acos(cosine) > std::asin(1.0f / from) + 1.25f * cell_width(k_directions)) {
        EXPECT_EQ(share.hidden, 0.0f);
        continue;
      }
      if (share.near) {  // beside the ball
        EXPECT_LT(from, 1.5f);
        continue;
      }
      const double exact = mapped_.share(p, cell, 16, distance);
      all.add(double(share.hidden), exact);
      total += double(share.hidden), exact_total += exact;
    }
    if (distance < from - 1.0f) {
      EXPECT_EQ(total, 0.0);
    }
    // Of the hemisphere.
    EXPECT_NEAR(total / (k_cells / 2), exact_total / (k_cells / 2), 0.006) << from << " " << distance;
    sum += total, exact_sum += exact_total;
  }
  EXPECT_GT(all.partial, all.cells / 20);
  EXPECT_LT(all.mean(), 0.03);
  EXPECT_NEAR(sum / exact_sum, 1.0, 0.02);
}

// In the ball, and on the object itself.
TEST_P(WithinDistance, SharesByDepthsAreNearThoseOfRays) {
  TestRandom random(53);
  const TriangleMesh& mesh = mapped_.scene.shapes[0].mesh;
  ShareErrors others, own;
  int undecided[2] = {}, all[2] = {};
  for (int trial = 0; trial < 6000; ++trial) {
    const int cell = int(random.index(k_cells));
    const float distance = random.log_uniform(0.05f, 4.0f);
    const Vec3 p = random.in_ball();
    const auto share = scalar::share_of_map_within<float>(lines_within(view_, cell, distance), lanes(p), {});
    ++all[0];
    if (share.near) {
      ++undecided[0];
    } else {
      others.add(double(share.hidden), mapped_.share(p, cell, 16, distance));
    }
    const UVec3 t = mesh.triangles[random.index(uint32_t(mesh.triangles.size()))];
    const Vec3 a = mesh.positions[t.x], b = mesh.positions[t.y], c = mesh.positions[t.z];
    const Vec3 normal = glm::cross(b - a, c - a), on = (a + b + c) / 3.0f;
    if (glm::length(normal) == 0.0f) continue;
    const Vec3 g = glm::normalize(normal);
    const CellFrame frame = cell_frame(cell / k_directions, cell % k_directions, k_directions);
    if (glm::dot(frame.c, g) < 2.0f * cell_width(k_directions)) continue;  // the horizon cuts the cell
    OwnLines lines;
    lines.lines = lines_within(view_, cell, distance);
    for (int i = 0; i < 3; ++i) lines.s[i] = frame.s[i], lines.t[i] = frame.t[i], lines.c[i] = frame.c[i];
    lines.clear_within = 0.25f, lines.hidden_from = 1.5f;
    const auto of_own = scalar::share_of_own<float, true>(lines, lanes(on), lanes(g));
    ++all[1];
    if (of_own.near) {
      ++undecided[1];
    } else {
      own.add(double(of_own.hidden), mapped_.share(on + 1e-5f * g, cell, 16, distance));
    }
  }
  for (const ShareErrors& errors : {others, own}) {
    EXPECT_LT(errors.mean(), 0.025);
    EXPECT_LT(std::abs(errors.bias()), 0.005);
    EXPECT_GT(errors.cells, 500);
  }
  // Between surfaces of a line, and on the object below what lies beyond the distance.
  for (int i = 0; i < 2; ++i) EXPECT_LT(undecided[i], all[i] / 2);
}

// A distance beyond everything changes no bit.
TEST_P(WithinDistance, FarDistancesHideAsNone) {
  TestRandom random(54);
  int hidden = 0;
  for (int trial = 0; trial < 20000; ++trial) {
    const int cell = int(random.index(k_cells));
    const Vec3 p = random.direction() * random.log_uniform(0.1f, 5.0f);
    const MapLines lines = lines_within(view_, cell, 7.0f);
    const auto within = scalar::share_of_map_within<float>(lines, lanes(p), {});
    const auto share = scalar::share_of_map<float>(lines, lanes(p), {});
    ASSERT_EQ(within.hidden, share.hidden);
    ASSERT_EQ(within.near, share.near);
    hidden += share.hidden > 0.0f;
  }
  EXPECT_GT(hidden, 1000);
}

INSTANTIATE_TEST_SUITE_P(Meshes, WithinDistance, testing::Values("knot", "supershape", "sphere"),
                         [](const auto& instance) { return std::string(instance.param); });

// The first surfaces are those of the lines whose last ones are read, also where the place lies on a row of texels.
TEST(CellWithin, FirstSurfacesAreOfTheSameLines) {
  constexpr int k_texels = 8;
  DirectionMaps maps({Vec3(0.0f), 1.0f}, {.directions = 4, .texels = k_texels});
  for (int i = 0; i < k_texels * k_texels; ++i) {
    maps.depths(0)[i] = uint16_t(1000 + i);
    // The opposite map: rows the other way.
    maps.depths(1)[(k_texels - 1 - i / k_texels) * k_texels + i % k_texels] = uint16_t(2000 + i);
  }
  const MapsView view = maps.view();
  MapLines lines;
  lines.maps = &view, lines.depth_begin = 0, lines.back_begin = view.depth_bytes;
  for (const float y : {0.0f, 0.5f, 1.0f, 1.5f, 2.25f, 3.5f, 6.5f, 7.5f, 8.0f}) {
    const auto last = scalar::read_depths<float>(lines, 3.3f, y, true);
    const auto first = scalar::read_first<float>(lines, 3.3f, y, true);
    for (int i = 0; i < 4; ++i) {
      const float line = last.depth[i] - 1000.0f;
      EXPECT_EQ(first.depth[i ^ 2], k_depth_codes + 2.0f - (2000.0f + line)) << y << " " << i;
      EXPECT_NEAR(first.weight[i ^ 2], last.weight[i], 1e-6f) << y << " " << i;
    }
  }
}

TEST(CellWithin, GivesTheSameBitsOnEveryInstructionSet) {
  TestRandom random(55);
  const NoisyMaps maps({8, 16, 64}, {}, random);
  size_t undecided = 0, taken = 0, all = 0;
  for (int trial = 0; trial < 2000; ++trial) {
    RandomTask r;
    make_task(maps.views, random, r);
    r.task.within = random.log_uniform(1e-2f, 1e2f);
    const auto set = [&](MapLines& lines) {
      lines.within = r.task.within;
      lines.back_begin = int32_t(random.index(16)) * lines.maps->depth_bytes;
    };
    if (r.task.own) set(r.own.lines);
    for (MapLines& lines : r.maps) set(lines);
    const Points points = random_points(r, 1 + random.index(100), random);
    const AlignedVector<float> before(size_t(points.size), 0.0f);
    const Answer expected = ask(cell_kernels(Isa::scalar).see_cell_within, r.task, points, before);
    undecided += expected.undecided.size(), all += size_t(points.size);
    for (size_t i = 0; i < size_t(points.size); ++i) taken += expected.sums[0][i] > 0.0f;
    for (const Isa isa : supported_isas()) {
      const Answer answer = ask(cell_kernels(isa).see_cell_within, r.task, points, before);
      ASSERT_EQ(answer.undecided, expected.undecided) << isa_name(isa) << " " << trial;
      for (size_t i = 0; i < size_t(points.size); ++i) {
        ASSERT_EQ(std::bit_cast<uint32_t>(answer.sums[0][i]), std::bit_cast<uint32_t>(expected.sums[0][i]))
            << isa_name(isa) << " " << trial << " " << i;
      }
    }
  }
  EXPECT_GT(undecided, all / 10);
  EXPECT_GT(taken, all / 5);
}

}  // namespace
}  // namespace fieldtrace
