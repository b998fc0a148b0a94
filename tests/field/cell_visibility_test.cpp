// What shading points see of direction cells: shares against exact rays.

#include "field/maps/cell_visibility.hd.h"

#include <gtest/gtest.h>

#include "core/mesh/mesh_procedural.h"
#include "core/simd/vec_lanes.h"
#include "tests/support/cell_tasks.h"
#include "tests/support/mapped_mesh.h"

namespace fieldtrace {
namespace {

using namespace test;

// -------------------------------------------------------------------------------------------- horizons

// Cells that a surface cuts, against the mean of the shading normal's cosine over squares about their centres.
TEST(ShareAbove, IsNearThatOfASquare) {
  TestRandom random(41);
  constexpr int k_side = 96, k_trials = 3000;
  double largest = 0.0, sum = 0.0;
  int cells = 0, cut = 0;
  for (int trial = 0; trial < k_trials; ++trial) {
    const Vec3 c = random.direction(), s = random.direction();
    const Vec3 x = glm::normalize(glm::cross(c, random.direction())), y = glm::cross(c, x);
    const float half = random.log_uniform(0.02f, 0.2f);
    // The surface's horizon lies near the cell, the normals up to about 45 degrees apart.
    const Vec3 tilted = glm::normalize(s + random.direction() * random.uniform(0.0f, 0.7f));
    const Vec3 g = glm::normalize(tilted - c * (glm::dot(tilted, c) - random.uniform(-2.0f, 2.0f) * half));
    const float turn = glm::dot(g, s), shading = glm::dot(c, s);
    const float cosine = scalar::cosine_over_cell<float>(shading, half);
    if (!(cosine > 0.0f) || turn < 0.5f) continue;
    const float share = scalar::share_above<float>(cosine, shading, glm::dot(c, g), turn, half);
    EXPECT_GE(share, 0.0f);
    EXPECT_LE(share, 1.0f);
    double above = 0.0, all = 0.0;
    for (int i = 0; i < k_side * k_side; ++i) {
      const float u = (2.0f * (float(i / k_side) + 0.5f) / k_side - 1.0f) * half;
      const float v = (2.0f * (float(i % k_side) + 0.5f) / k_side - 1.0f) * half;
      const Vec3 d = c + x * u + y * v;
      const double lit = std::max(double(glm::dot(d, s)), 0.0);
      all += lit, above += glm::dot(d, g) > 0.0f ? lit : 0.0;
    }
    if (!(all > 0.25 * double(half) * (k_side * k_side))) continue;  // hardly any of the cell is lit
    const double error = double(share) - above / all;
    largest = std::max(largest, std::abs(error)), sum += error;
    ++cells, cut += above > 0.0 && above < all;
  }
  // A cell is taken for a square with its side along the horizon: across its corner that is off by .043.
  EXPECT_LT(largest, 0.1);
  EXPECT_LT(std::abs(sum / cells), 0.002);
  EXPECT_GT(cut, cells / 2);
  EXPECT_GT(cells, 500);
}

// The middle of what the cosine leaves of a square about a direction, against sums.
TEST(CosineShift, IsThatOfTheMiddle) {
  TestRandom random(44);
  constexpr int k_steps = 4000;
  for (int trial = 0; trial < 300; ++trial) {
    const float half = random.log_uniform(0.01f, 0.2f), mean = random.uniform(-0.9f, 5.0f) * half;
    double weight = 0.0, sum = 0.0;
    for (int i = 0; i < k_steps; ++i) {
      const double c = double(mean) + double(half) * ((2.0 * i + 1.0) / k_steps - 1.0);
      if (c > 0.0) weight += c, sum += c * c;
    }
    EXPECT_NEAR(scalar::cosine_shift<float>(mean, half), sum / weight - double(mean), 1e-3 * double(half));
  }
}

TEST(ShareAbove, ChangesNothingWhereNormalsAgree) {
  TestRandom random(42);
  for (int trial = 0; trial < 10000; ++trial) {
    const float half = random.log_uniform(1e-3f, 0.5f), at = random.uniform(-1.0f, 1.2f) * half;
    const float cosine = scalar::cosine_over_cell<float>(at, half);
    if (at < -0.95f * half) continue;  // rounding is all that is left
    EXPECT_NEAR(scalar::share_above<float>(cosine, at, at, 1.0f, half), 1.0f, 1e-5f) << at / half;
    // Wholly above, wholly below.
    EXPECT_NEAR(scalar::share_above<float>(0.9f, 0.9f, 1.5f * half, 0.8f, half), 1.0f, 1e-5f);
    EXPECT_EQ(scalar::share_above<float>(0.9f, 0.9f, -half, 0.8f, half), 0.0f);
  }
}

TEST(SharesOfPlanes, AreNearThoseOfRays) {
  TestRandom random(21);
  for (const int directions : {16, 32}) {
    ShareErrors all, partial;
    for (int trial = 0; trial < 12000; ++trial) {
      const float size = random.log_uniform(0.1f, 10.0f);
      const Vec3 x = random.direction() * size;
      const Vec3 aside = glm::normalize(glm::cross(x, random.direction()));
      const Parallelogram q = {random.direction(), x,
                               aside * size * random.log_uniform(0.2f, 1.0f) + x * random.uniform(-0.5f, 0.5f)};
      // In all places about it, and near the plane: over it, and beyond its edges.
      const Vec3 n = glm::normalize(glm::cross(q.x, q.y));
      Vec3 p = q.centre + random.direction() * size * random.log_uniform(0.1f, 10.0f);
      if (trial % 3 == 0) {
        p = q.centre + q.x * random.uniform(-3.0f, 3.0f) + q.y * random.uniform(-3.0f, 3.0f) +
            n * (size * random.log_uniform(1e-5f, 0.1f));
      }
      // The cell at its edge, or any.
      const Vec3 at =
          q.centre + q.x * (random.index(2) ? 1.0f : random.uniform(-1.0f, 1.0f)) + q.y * random.uniform(-1.0f, 1.0f);
      const Vec3 to = trial % 4 ? glm::normalize(at - p) : random.direction();
      scalar::CellAddress<float> address;
      scalar::find_direction_cell(lanes(to), make_axis(directions), address);
      const int cell = address.u * directions + address.v;
      const PlaneLines lines = q.lines(direction_in(cell, directions, 0.5f, 0.5f));
      const float share = scalar::share_of_slope<float>(lines, lines.centre, 0.5f * cell_width(directions), lanes(p));
      EXPECT_GE(share, 0.0f);
      EXPECT_LE(share, 1.0f);
      const double exact = q.share(p, cell, directions, 64);
      all.add(double(share), exact);
      if (exact > 0.0 && exact < 1.0) partial.add(double(share), exact);
    }
    // A cell is taken for a square of its area about each edge, whatever its shape, and its parts between edges for
    // independent, nested or opposite.
    EXPECT_LT(all.largest, 0.35);
    EXPECT_LT(partial.mean(), 0.05);
    EXPECT_LT(std::abs(partial.bias()), 0.02);
    EXPECT_GT(partial.cells, all.cells / 2);
  }
}

// What a surface loses of an even sky to a parallelogram: errors of cells make up for one another.
TEST(SharesOfPlanes, SumUpToTheirIrradiance) {
  constexpr int k_directions = 32, k_trials = 60;
  TestRandom random(22);
  double squares = 0.0, hidden = 0.0;
  for (int trial = 0; trial < k_trials; ++trial) {
    const Vec3 x = random.direction() * random.log_uniform(0.3f, 10.0f);
    const Parallelogram q = {random.direction(), x,
                             glm::normalize(glm::cross(x, random.direction())) * random.log_uniform(0.3f, 10.0f)};
    const Vec3 n = random.direction(), p(0.0f);
    double sum = 0.0, exact = 0.0;
    for (int cell = 0; cell < k_directions * k_directions; ++cell) {
      const Vec3 d = direction_in(cell, k_directions, 0.5f, 0.5f);
      const float cosine = glm::dot(n, d);
      if (!(cosine > 0.0f)) continue;
      const float half = 0.5f * cell_width(k_directions);
      const PlaneLines lines = q.lines(d);
      sum += double(scalar::share_of_slope<float>(lines, lines.centre, half, lanes(p)) * cosine);
      exact += q.share(p, cell, k_directions, 12) * double(cosine);
    }
    constexpr double k_open = k_directions * k_directions / 4.0;  // the sum of all cosines
    squares += (sum - exact) * (sum - exact) / (k_open * k_open), hidden += exact / k_open;
  }
  EXPECT_GT(hidden / k_trials, 0.1);
  EXPECT_LT(std::sqrt(squares / k_trials), 0.005);
}

class SharesOfMaps : public testing::TestWithParam<const char*> {};

TEST_P(SharesOfMaps, AreNearThoseOfRays) {
  TestRandom random(31);
  const MappedMesh m(std::string(GetParam()) == "knot" ? make_knot({.along = 256, .around = 24})
                                                       : make_supershape({.around = 96, .along = 48}),
                     {.directions = 32, .texels = 64});
  const MapsView view = m.maps->view();
  constexpr int k_cells = 32 * 32, k_trials = 32;
  ShareErrors all;
  double sum = 0.0, exact_sum = 0.0, squares = 0.0;
  int near = 0;
  for (int trial = 0; trial < k_trials; ++trial) {
    const float distance = random.log_uniform(1.05f, 20.0f);
    const Vec3 p = random.direction() * distance;
    double total = 0.0, exact_total = 0.0;
    for (int cell = 0; cell < k_cells; ++cell) {
      const Vec3 d = direction_in(cell, 32, 0.5f, 0.5f);
      const scalar::MapShare<float> share = scalar::share_of_map<float>(lines_of(view, cell, 32, 2.0f), lanes(p), {});
      // Where the ball is out of reach of the cell's filter, 1.25 widths about its centre.
      const float cosine = std::clamp(-glm::dot(d, p) / distance, -1.0f, 1.0f);
      if (std::acos(cosine) > std::asin(1.0f / distance) + 1.25f * cell_width(32)) {
        EXPECT_EQ(share.hidden, 0.0f);
        EXPECT_FALSE(share.near);
        continue;
      }
      const double exact = m.share(p, cell, 24);
      if (share.near) {  // beside the ball
        EXPECT_LT(distance, 1.5f);
        continue;
      }
      all.add(double(share.hidden), exact);
      total += double(share.hidden), exact_total += exact;
    }
    // Of the hemisphere.
    EXPECT_NEAR(total / (k_cells / 2), exact_total / (k_cells / 2), 0.005) << distance;
    // Far away the object is smaller than a cell, and what sees it depends on where among cells it lies.
    if (distance < 6.0f) {
      const double off = total / exact_total - 1.0;
      squares += off * off, ++near;
    }
    sum += total, exact_sum += exact_total;
  }
  EXPECT_GT(all.partial, all.cells / 8);
  EXPECT_LT(all.largest, 0.5);
  EXPECT_LT(all.mean(), 0.025);
  EXPECT_NEAR(sum / exact_sum, 1.0, 0.02);
  EXPECT_LT(std::sqrt(squares / near), 0.1);  // .056 over ten seeds, of which a tenth have single ones of .2 to .4
}

// Points outside the ball follow the cell's ray to the centre plane; the nearer to the centre, the less they do.
TEST(MapPlace, FollowsRaysOutsideTheBall) {
  TestRandom random(33);
  constexpr float k_half = 32.0f;
  MapsView view;
  view.texels = 64;
  int outside = 0;
  for (int trial = 0; trial < 4000; ++trial) {
    const int cell = int(random.index(16 * 16));
    const CellFrame frame = cell_frame(cell / 16, cell % 16, 16);
    const Vec3 d = direction_in(cell, 16, random.uniform(), random.uniform());
    const float along = glm::dot(frame.c, d);
    MapLines lines = lines_of(view, cell, 16, 2.0f);
    lines.slope_u = k_half * glm::dot(frame.s, d) / along, lines.slope_v = k_half * glm::dot(frame.t, d) / along;
    const Vec3 p = random.direction() * random.uniform(0.0f, 3.0f);
    const float z = glm::dot(frame.c, p), distance = glm::length(p);
    const scalar::MapPlace<float> at = scalar::place_in_map<float>(lines, lanes(p), {});
    const float part = z < 0.0f ? std::min(distance * distance, 1.0f) : 0.0f;
    const Vec3 met = p - d * (part * z / along);
    EXPECT_NEAR(at.x, k_half * (1.0f + glm::dot(frame.s, met)), 1e-4f * k_half);
    EXPECT_NEAR(at.y, k_half * (1.0f + glm::dot(frame.t, met)), 1e-4f * k_half);
    outside += z < 0.0f && distance > 1.0f;
  }
  EXPECT_GT(outside, 1000);
}

// What points of a floor see of an object in a ball that touches it, weighed by their cosine: cells lean to where the
// cosine is larger. Without the lean floors are too bright.
TEST_P(SharesOfMaps, WeighedByTheCosineAreNearThoseOfRays) {
  TestRandom random(34);
  constexpr int k_directions = 16, k_cells = k_directions * k_directions, k_trials = 384, k_side = 12;
  const MappedMesh m(std::string(GetParam()) == "knot" ? make_knot({.along = 256, .around = 24})
                                                       : make_supershape({.around = 96, .along = 48}),
                     {.directions = k_directions, .texels = 64});
  const MapsView view = m.maps->view();
  const float half = 0.5f * cell_width(k_directions);
  double squares = 0.0, bias = 0.0, centred_bias = 0.0;
  for (int trial = 0; trial < k_trials; ++trial) {
    const float distance = random.uniform(1.2f, 3.0f), rise = 1.0f / distance;
    const Vec3 to = random.direction(), p = -to * distance;
    const Vec3 n = rise * to + std::sqrt(1.0f - rise * rise) * glm::normalize(glm::cross(to, random.direction()));
    double sum = 0.0, centred = 0.0, exact = 0.0, open = 0.0;
    for (int cell = 0; cell < k_cells; ++cell) {
      const Vec3 d = direction_in(cell, k_directions, 0.5f, 0.5f);
      const float mean = glm::dot(d, n), cosine = scalar::cosine_over_cell<float>(mean, half);
      open += double(cosine);
      if (!(cosine > 0.0f)) continue;
      const MapLines lines = lines_of(view, cell, k_directions, 0.0f);
      const Vec3 lean = n * scalar::cosine_shift<float>(mean, half);
      sum += double(cosine * scalar::share_of_map<float>(lines, lanes(p), lanes(lean)).hidden);
      centred += double(cosine * scalar::share_of_map<float>(lines, lanes(p), {}).hidden);
      exact += m.received(p, n, cell, k_side);
    }
    squares += (sum - exact) * (sum - exact) / (open * open);
    bias += (sum - exact) / open / k_trials, centred_bias += (centred - exact) / open / k_trials;
  }
  EXPECT_LT(std::sqrt(squares / k_trials), 0.005);
  EXPECT_LT(centred_bias, -0.0002);
  EXPECT_LT(std::abs(bias), 0.75 * std::abs(centred_bias));
}

// Points in the ball compare depths: of other objects, and of the one that they lie on.
TEST_P(SharesOfMaps, ByDepthsAreNearThoseOfRays) {
  TestRandom random(32);
  const MappedMesh m(std::string(GetParam()) == "knot" ? make_knot({.along = 256, .around = 24})
                                                       : make_supershape({.around = 96, .along = 48}),
                     {.directions = 32, .texels = 64});
  const MapsView view = m.maps->view();
  const TriangleMesh& mesh = m.scene.shapes[0].mesh;
  ShareErrors others, own;
  int undecided[2] = {};
  for (int trial = 0; trial < 4000; ++trial) {
    const int cell = int(random.index(32 * 32));
    const Vec3 p = random.in_ball();
    const scalar::MapShare<float> share = scalar::share_of_map<float>(lines_of(view, cell, 32, 2.0f), lanes(p), {});
    share.near ? void(++undecided[0]) : others.add(double(share.hidden), m.share(p, cell, 16));

    const UVec3 t = mesh.triangles[random.index(uint32_t(mesh.triangles.size()))];
    const Vec3 a = mesh.positions[t.x], b = mesh.positions[t.y], c = mesh.positions[t.z];
    const Vec3 g = glm::normalize(glm::cross(b - a, c - a)), on = (a + b + c) / 3.0f;
    const CellFrame frame = cell_frame(cell / 32, cell % 32, 32);
    if (glm::dot(frame.c, g) < 2.0f * cell_width(32)) continue;  // the horizon cuts the cell
    OwnLines lines;
    lines.lines = lines_of(view, cell, 32, 2.0f);
    for (int i = 0; i < 3; ++i) lines.s[i] = frame.s[i], lines.t[i] = frame.t[i], lines.c[i] = frame.c[i];
    lines.clear_within = 0.5f, lines.hidden_from = 3.0f;
    const scalar::MapShare<float> of_own = scalar::share_of_own<float>(lines, lanes(on), lanes(g));
    of_own.near ? void(++undecided[1]) : own.add(double(of_own.hidden), m.share(on + 1e-5f * g, cell, 16));
  }
  for (const ShareErrors& errors : {others, own}) {
    EXPECT_LT(errors.mean(), 0.025);
    EXPECT_LT(std::abs(errors.bias()), 0.005);
    EXPECT_GT(errors.partial, 10);
  }
  // Depths about as high as the point: a few.
  for (const int count : undecided) {
    EXPECT_GT(count, 0);
    EXPECT_LT(count, 200);
  }
}

INSTANTIATE_TEST_SUITE_P(Meshes, SharesOfMaps, testing::Values("knot", "supershape"),
                         [](const auto& instance) { return std::string(instance.param); });

}  // namespace
}  // namespace fieldtrace
