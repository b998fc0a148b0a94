// What shading points see of direction cells: the same bits on every instruction set, and shares against exact rays.

#include "field/maps/cell_visibility.hd.h"

#include <gtest/gtest.h>

#include <bit>
#include <numeric>

#include "core/mesh/mesh_procedural.h"
#include "core/simd/vec_lanes.h"
#include "core/trace/accel.h"
#include "field/bake/cell_lines.h"
#include "field/chart/chart.hd.h"
#include "field/maps/cell_kernels.h"
#include "field/maps/direction_maps.h"
#include "field/maps/radiance_pyramids.h"
#include "field/store/field.h"
#include "tests/support/random_lines.h"

namespace fieldtrace {
namespace {

float cell_width(int directions) { return 2.0f * std::sqrt(k_pi) / float(directions); }

// Direction (x, y), in [0, 1]^2, of cell `cell`.
Vec3 direction_in(int cell, int directions, float x, float y) {
  const float step = 2.0f / float(directions);
  return to_vec(scalar::frame_from_square<float>((float(cell / directions) + x) * step - 1.0f,
                                                 (float(cell % directions) + y) * step - 1.0f)
                    .c);
}

void set_row(const Vec3& a, float constant, float row[4]) {
  for (int i = 0; i < 3; ++i) row[i] = a[i];
  row[3] = constant;
}

// The lines of a map for the cell's own direction, with world space about the ball's centre, in units of its radius.
MapLines lines_of(const MapsView& view, int cell, int directions, float margin) {
  const CellFrame frame = cell_frame(cell / directions, cell % directions, directions);
  const float half = 0.5f * float(view.texels);
  MapLines lines;
  set_row(frame.s * half, half, lines.u);
  set_row(frame.t * half, half, lines.v);
  set_row(frame.c, 0.0f, lines.z);
  lines.reach = 0.58f * cell_width(directions) * half;
  lines.margin = margin / half;
  lines.depth_begin = cell * view.depth_bytes;
  lines.coverage_begin = cell * view.coverage_bytes;
  lines.maps = &view;
  return lines;
}

struct Parallelogram {
  Vec3 centre, x, y;  // half axes

  PlaneLines lines(const Vec3& d) const {
    const Vec3 n = glm::normalize(glm::cross(x, y));
    const Mat3 rows = glm::transpose(glm::inverse(Mat3(x, y, n)));
    PlaneLines lines;
    set_row(rows[0], -glm::dot(rows[0], centre), lines.x);
    set_row(rows[1], -glm::dot(rows[1], centre), lines.y);
    set_row(n, -glm::dot(n, centre), lines.height);
    lines.centre = {glm::dot(rows[0], d), glm::dot(rows[1], d), glm::dot(n, d)};
    lines.per_unit_x = glm::dot(rows[0], rows[0]), lines.per_unit_y = glm::dot(rows[1], rows[1]);
    lines.x_dot_y = glm::dot(rows[0], rows[1]);
    return lines;
  }

  // The part of side x side rays from `p` over a cell that meet it.
  double share(const Vec3& p, int cell, int directions, int side) const {
    const DVec3 n = glm::normalize(glm::cross(DVec3(x), DVec3(y))), to = DVec3(centre) - DVec3(p);
    const glm::dmat3 inverse = glm::inverse(glm::dmat3(DVec3(x), DVec3(y), n));
    int met = 0;
    for (int i = 0; i < side * side; ++i) {
      const DVec3 d(direction_in(cell, directions, (float(i / side) + 0.5f) / float(side),
                                 (float(i % side) + 0.5f) / float(side)));
      const double t = glm::dot(to, n) / glm::dot(d, n);
      const DVec3 at = inverse * (d * t - to);
      met += t > 0.0 && std::abs(at.x) <= 1.0 && std::abs(at.y) <= 1.0;
    }
    return double(met) / double(side * side);
  }
};

// -------------------------------------------------------------------------------------------- parity

// Maps with noise, the insides of bodies and nothing.
DirectionMaps noisy_maps(int texels, TestRandom& random) {
  DirectionMaps maps({Vec3(0.0f), 1.0f}, {.directions = 4, .texels = texels});
  for (int direction = 0; direction < 16; ++direction) {
    uint16_t* const depth = maps.depths(direction);
    const float covered = float(direction % 4) / 3.0f;
    const uint32_t base = random.index(60000), spread = 1u << random.index(16);
    for (int i = 0; i < texels * texels; ++i) {
      depth[i] = random.uniform() < covered ? uint16_t(std::min(1 + base + random.index(spread), 65535u)) : uint16_t(0);
    }
    maps.finish(direction);
  }
  return maps;
}

struct Points {
  AlignedVector<float> values[9];
  int32_t size = 0;

  explicit Points(size_t n) : size(int32_t(padded(n))) {
    for (auto& v : values) v.resize(size_t(size));
  }
  void set(size_t i, const Vec3& p, const Vec3& g, const Vec3& s) {
    for (int a = 0; a < 3; ++a) values[a][i] = p[a], values[3 + a][i] = g[a], values[6 + a][i] = s[a];
  }
  CellPoints view() const {
    return {values[0].data(), values[1].data(), values[2].data(), values[3].data(), values[4].data(),
            values[5].data(), values[6].data(), values[7].data(), values[8].data(), size};
  }
};

struct Answer {
  AlignedVector<float> sums[6];
  std::vector<int32_t> undecided;
};

Answer ask(Isa isa, const CellTask& task, const Points& points, const AlignedVector<float>& before) {
  Answer answer;
  for (auto& sum : answer.sums) sum = before;
  AlignedVector<int32_t> listed(size_t(points.size) + k_batch_padding);
  const int count = cell_kernel_for(isa)(task, points.view(),
                                         {answer.sums[0].data(), answer.sums[1].data(), answer.sums[2].data(),
                                          answer.sums[3].data(), answer.sums[4].data(), answer.sums[5].data()},
                                         listed.data());
  answer.undecided.assign(listed.begin(), listed.begin() + count);
  return answer;
}

struct RandomTask {
  CellTask task;
  OwnLines own;
  std::vector<MapLines> maps;
  std::vector<PlaneLines> planes;
  std::vector<BallLines> balls;
  std::vector<Parallelogram> parallelograms;
  MapRadiance own_radiance;
  std::vector<MapRadiance> radiance;
  std::vector<PlaneRadiance> plane_radiance;
};

// Pyramids of radiance up to about 1, with places of which nothing is known.
RadiancePyramids noisy_radiance(int texels, int count, TestRandom& random) {
  RadiancePyramids pyramids(texels, count);
  pyramids.set_most(1.0f);
  std::vector<Rgb> values(size_t(texels) * size_t(texels));
  std::vector<uint8_t> is_known(values.size());
  for (int i = 0; i < count; ++i) {
    for (size_t t = 0; t < values.size(); ++t) {
      values[t] = Rgb(random.uniform(), random.uniform(), random.uniform());
      is_known[t] = random.index(4) != 0;
    }
    pyramids.fill(i, values, is_known);
  }
  return pyramids;
}

// Light that comes back from some of what a task holds.
void add_radiance(std::span<const RadianceView> views, TestRandom& random, RandomTask& r) {
  r.task.reflects = true;
  const auto radiance = [&] {
    MapRadiance m;
    for (float* row : {m.u, m.v}) set_row(random.direction() * random.log_uniform(0.1f, 100.0f), 8.0f, row);
    m.slope_u = random.uniform(-9.0f, 9.0f), m.slope_v = random.uniform(-9.0f, 9.0f);
    m.reach = random.log_uniform(1e-3f, 1e3f);
    m.place = random.uniform(-3.0f, 3.0f);
    m.view = &views[random.index(uint32_t(views.size()))];
    m.outer = m.view->bytes * int32_t(random.index(4)), m.inner = m.view->bytes * int32_t(random.index(4));
    return m;
  };
  if (r.task.own && random.index(4)) {
    r.own_radiance = radiance();
    r.task.own_radiance = &r.own_radiance;
  }
  for (size_t k = 0; k < r.maps.size(); ++k) r.radiance.push_back(radiance());
  std::sort(r.radiance.begin(), r.radiance.end(), [](const auto& a, const auto& b) { return a.place < b.place; });
  if (!r.radiance.empty() && random.index(4) == 0) r.radiance[0].view = nullptr;
  r.task.map_radiance = r.radiance.data();
  r.plane_radiance.resize(r.planes.size());
  for (size_t k = 0; k < r.planes.size(); ++k) {
    PlaneRadiance& plane = r.plane_radiance[k];
    plane.view = &views[random.index(uint32_t(views.size()))];
    plane.windows = 1 + int(random.index(2));
    const float texels = float(plane.view->texels);
    plane.window[0] = {0.0f, 0.0f, 0.5f * texels, 0.5f * texels, random.log_uniform(0.1f, 100.0f)};
    plane.window[1] = {random.uniform(-1.0f, 1.0f), random.uniform(-1.0f, 1.0f), texels, 2.0f * texels,
                       random.log_uniform(0.1f, 100.0f)};
    if (random.index(4)) r.planes[k].radiance = &plane;
  }
}

void make_task(std::span<const MapsView> views, TestRandom& random, RandomTask& r) {
  const int cell = int(random.index(16));
  const Vec3 d = direction_in(cell, 4, random.uniform(), random.uniform());
  const auto map = [&] {
    MapLines lines = lines_of(views[random.index(uint32_t(views.size()))], cell, 4, random.log_uniform(1e-2f, 10.0f));
    lines.slope_u = random.uniform(-9.0f, 9.0f), lines.slope_v = random.uniform(-9.0f, 9.0f);
    lines.reach *= random.log_uniform(1e-4f, 1e4f);
    return lines;
  };
  if (random.index(2)) {
    r.own.lines = map();
    const CellFrame frame = cell_frame(cell / 4, cell % 4, 4);
    for (int a = 0; a < 3; ++a) r.own.s[a] = frame.s[a], r.own.t[a] = frame.t[a], r.own.c[a] = frame.c[a];
    r.own.clear_within = random.uniform(0.0f, 2.0f);
    r.own.hidden_from = r.own.clear_within + random.uniform(0.0f, 4.0f);
    r.task.own = &r.own;
  }
  for (uint32_t n = random.index(4); n > 0; --n) r.maps.push_back(map());
  for (uint32_t n = random.index(3); n > 0; --n) {
    const float size = random.log_uniform(1e-3f, 1e3f);
    r.parallelograms.push_back({random.in_ball() * 3.0f, random.direction() * size, random.direction() * size});
    r.planes.push_back(r.parallelograms.back().lines(d));
  }
  for (uint32_t n = random.index(3); n > 0; --n) {
    const Vec3 c = random.direction() * random.log_uniform(0.1f, 100.0f);
    r.balls.push_back({{c.x, c.y, c.z}, random.log_uniform(1e-3f, 10.0f)});
  }
  const float length = random.index(4) ? random.uniform(0.9f, 1.0f) : 0.0f;
  for (int a = 0; a < 3; ++a) {
    r.task.direction[a] = d[a], r.task.vector[a] = d[a] * length;
    r.task.weight[a] = random.index(8) ? random.log_uniform(1e-15f, 1e15f) : 0.0f;
  }
  r.task.half = 0.5f * cell_width(4);
  r.task.cosine_half = cell_width(4) / 2.0f;
  r.task.maps = r.maps.data(), r.task.map_count = int(r.maps.size());
  r.task.planes = r.planes.data(), r.task.plane_count = int(r.planes.size());
  r.task.balls = r.balls.data(), r.task.ball_count = int(r.balls.size());
}

Points random_points(const RandomTask& r, size_t count, TestRandom& random) {
  Points points(count);
  for (size_t i = 0; i < size_t(points.size); ++i) {
    Vec3 p = random.in_ball();
    switch (random.index(5)) {
      case 0:
        p = random.direction() * random.log_uniform(1.0f, 1e8f);
        break;
      case 1:  // below the map or above it
        p += Vec3(r.task.direction[0], r.task.direction[1], r.task.direction[2]) * random.uniform(-30.0f, 30.0f);
        break;
      case 2:
        if (!r.parallelograms.empty()) {
          const Parallelogram& q = r.parallelograms[0];
          p = q.centre + q.x * random.uniform(-2.0f, 2.0f) + q.y * random.uniform(-1.0f, 1.0f);
        }
        break;
      default:
        break;
    }
    const Vec3 g = random.direction();
    points.set(i, p, g, random.index(2) ? g : random.direction());
  }
  return points;
}

TEST(CellKernels, GiveTheSameBitsOnEveryInstructionSet) {
  TestRandom random(5);
  std::vector<DirectionMaps> maps;
  for (const int texels : {8, 16, 64}) maps.push_back(noisy_maps(texels, random));
  std::vector<MapsView> views;
  for (const DirectionMaps& m : maps) views.push_back(m.view());
  std::vector<RadiancePyramids> pyramids;
  for (const int texels : {2, 8, 16}) pyramids.push_back(noisy_radiance(texels, 4, random));
  std::vector<RadianceView> radiance;
  for (const RadiancePyramids& p : pyramids) radiance.push_back(p.view());
  size_t undecided = 0, taken = 0, partly = 0, all = 0, reflected = 0;
  for (int trial = 0; trial < 2000; ++trial) {
    RandomTask r;
    make_task(views, random, r);
    if (trial % 4 >= 2) add_radiance(radiance, random, r);
    const Points points = random_points(r, 1 + random.index(100), random);
    AlignedVector<float> before(size_t(points.size), 0.0f);
    if (trial % 2) std::generate(before.begin(), before.end(), [&] { return random.uniform(); });
    const Answer expected = ask(Isa::scalar, r.task, points, before);
    undecided += expected.undecided.size(), all += size_t(points.size);
    for (size_t i = 0; i < size_t(points.size); ++i) {
      const float most = r.task.weight[0] * scalar::cosine_over_cell<float>(r.task.vector[0] * points.values[6][i] +
                                                                                r.task.vector[1] * points.values[7][i] +
                                                                                r.task.vector[2] * points.values[8][i],
                                                                            r.task.cosine_half);
      const float sum = expected.sums[0][i] - before[i];
      EXPECT_GE(sum, 0.0f);
      EXPECT_LE(sum, most * (1.0f + 1e-5f) + 1e-6f * before[i]);
      const float back = expected.sums[3][i] - before[i], whole = 4.0f * r.task.half * r.task.half;
      EXPECT_GE(back, 0.0f);
      EXPECT_LE(back, whole * 1.01f);
      EXPECT_TRUE(back == 0.0f || r.task.reflects);
      reflected += back > 0.0f;
      taken += sum > 0.0f, partly += sum > 0.01f * most && sum < 0.99f * most;
    }
    for (const Isa isa : supported_isas()) {
      const Answer answer = ask(isa, r.task, points, before);
      ASSERT_EQ(answer.undecided, expected.undecided) << isa_name(isa) << " " << trial;
      for (int channel = 0; channel < 6; ++channel) {
        for (size_t i = 0; i < size_t(points.size); ++i) {
          ASSERT_EQ(std::bit_cast<uint32_t>(answer.sums[channel][i]),
                    std::bit_cast<uint32_t>(expected.sums[channel][i]))
              << isa_name(isa) << " " << trial << " " << i;
        }
      }
    }
  }
  // The tasks reach all of the kernel.
  EXPECT_GT(undecided, all / 10);
  EXPECT_LT(undecided, all / 2);
  EXPECT_GT(taken, all / 4);
  EXPECT_GT(partly, all / 50);
  EXPECT_GT(reflected, all / 20);
}

TEST(CellKernels, WeightlessAndUnlitCellsTakeNothing) {
  TestRandom random(6);
  const DirectionMaps maps = noisy_maps(16, random);
  const std::vector<MapsView> views = {maps.view()};
  for (int trial = 0; trial < 200; ++trial) {
    RandomTask r;
    make_task(views, random, r);
    const Points points = random_points(r, 64, random);
    const AlignedVector<float> before(size_t(points.size), 0.75f);
    for (const Isa isa : supported_isas()) {
      CellTask black = r.task;
      for (float& w : black.weight) w = 0.0f;
      for (const auto& sum : ask(isa, black, points, before).sums) EXPECT_EQ(sum, before);
      CellTask open = r.task;
      open.own = nullptr, open.map_count = open.plane_count = open.ball_count = 0;
      const Answer answer = ask(isa, open, points, before);
      for (const auto& sum : answer.sums) EXPECT_EQ(sum, before);
      EXPECT_TRUE(answer.undecided.empty());
    }
  }
}

// -------------------------------------------------------------------------------------------- shares

struct ShareErrors {
  double largest = 0.0, sum = 0.0, signed_sum = 0.0;
  int cells = 0, partial = 0;

  void add(double share, double exact) {
    const double error = std::abs(share - exact);
    largest = std::max(largest, error), sum += error, signed_sum += share - exact;
    ++cells, partial += exact > 0.0 && exact < 1.0;
  }
  double mean() const { return sum / cells; }
  double bias() const { return signed_sum / cells; }
};

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

struct MappedMesh {
  Scene scene;
  std::unique_ptr<Accel> accel;
  std::unique_ptr<DirectionMaps> maps;

  MappedMesh(TriangleMesh mesh, const MapSize& size) {
    const Sphere ball = field_ball(mesh.bounds());
    for (Vec3& p : mesh.positions) p = (p - ball.centre) / ball.radius;
    Shape shape;
    shape.bounds = mesh.bounds();
    shape.mesh = std::move(mesh);
    scene.shapes.push_back(std::move(shape));
    accel = std::make_unique<Accel>(scene);
    maps = std::make_unique<DirectionMaps>(Sphere{Vec3(0.0f), 1.0f}, size);
    BakeCounters counters;
    bake_maps(*maps, *accel, 0, DMat3(1.0), nullptr, counters);
  }

  // The part of side x side rays from `p` over a cell that are blocked.
  double share(const Vec3& p, int cell, int side) const {
    const size_t count = size_t(side * side);
    RayBatch rays;
    rays.resize(count);
    for (size_t i = 0; i < count; ++i) {
      const float x = (float(i / size_t(side)) + 0.5f) / float(side),
                  y = (float(i % size_t(side)) + 0.5f) / float(side);
      rays.set(i, p, direction_in(cell, maps->size().directions, x, y), k_infinity);
    }
    std::vector<uint8_t> blocked(padded(count), 0);
    accel->shape_occluded(0, rays, blocked.data());
    return double(std::accumulate(blocked.begin(), blocked.begin() + ptrdiff_t(count), 0)) / double(count);
  }
};

class SharesOfMaps : public testing::TestWithParam<const char*> {};

TEST_P(SharesOfMaps, AreNearThoseOfRays) {
  TestRandom random(31);
  const MappedMesh m(std::string(GetParam()) == "knot" ? make_knot({.along = 256, .around = 24})
                                                       : make_supershape({.around = 96, .along = 48}),
                     {.directions = 32, .texels = 64});
  const MapsView view = m.maps->view();
  constexpr int k_cells = 32 * 32, k_trials = 32;
  ShareErrors all;
  double sum = 0.0, exact_sum = 0.0;
  for (int trial = 0; trial < k_trials; ++trial) {
    const float distance = random.log_uniform(1.05f, 20.0f);
    const Vec3 p = random.direction() * distance;
    double total = 0.0, exact_total = 0.0;
    for (int cell = 0; cell < k_cells; ++cell) {
      const Vec3 d = direction_in(cell, 32, 0.5f, 0.5f);
      const scalar::MapShare<float> share = scalar::share_of_map<float>(lines_of(view, cell, 32, 2.0f), lanes(p));
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
      EXPECT_NEAR(total / exact_total, 1.0, 0.15) << distance;
    }
    sum += total, exact_sum += exact_total;
  }
  EXPECT_GT(all.partial, all.cells / 8);
  EXPECT_LT(all.largest, 0.5);
  EXPECT_LT(all.mean(), 0.025);
  EXPECT_NEAR(sum / exact_sum, 1.0, 0.02);
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
    const scalar::MapShare<float> share = scalar::share_of_map<float>(lines_of(view, cell, 32, 2.0f), lanes(p));
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
