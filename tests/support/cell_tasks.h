// Direction cells as shading points ask about them: a cell of its own map, parallelograms, and random tasks that reach
// all of the kernels.
//
// Thread-safety: pure functions, except of the generator that they are given.
#pragma once

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <span>
#include <vector>

#include "core/math/math.h"
#include "core/platform/aligned_vector.h"
#include "core/simd/vec_lanes.h"
#include "field/bake/cell_lines.h"
#include "field/chart/chart.hd.h"
#include "field/maps/cell_kernels.h"
#include "field/maps/direction_maps.h"
#include "field/maps/radiance_pyramids.h"
#include "tests/support/random_lines.h"

namespace fieldtrace::test {

inline float cell_width(int directions) { return 2.0f * std::sqrt(k_pi) / float(directions); }

// Direction (x, y), in [0, 1]^2, of cell `cell`.
inline Vec3 direction_in(int cell, int directions, float x, float y) {
  const float step = 2.0f / float(directions);
  return to_vec(scalar::frame_from_square<float>((float(cell / directions) + x) * step - 1.0f,
                                                 (float(cell % directions) + y) * step - 1.0f)
                    .c);
}

inline void set_row(const Vec3& a, float constant, float row[4]) {
  for (int i = 0; i < 3; ++i) row[i] = a[i];
  row[3] = constant;
}

// The lines of a map for the cell's own direction, with world space about the ball's centre, in units of its radius.
inline MapLines lines_of(const MapsView& view, int cell, int directions, float margin) {
  const CellFrame frame = cell_frame(cell / directions, cell % directions, directions);
  const float half = 0.5f * float(view.texels);
  MapLines lines;
  set_row(frame.s * half, half, lines.u);
  set_row(frame.t * half, half, lines.v);
  set_row(frame.c, 0.0f, lines.z);
  lines.reach = 0.58f * cell_width(directions) * half;
  lines.per_z = 1.0f;
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

// Maps with noise, the insides of bodies and nothing.
inline DirectionMaps noisy_maps(int texels, TestRandom& random) {
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

inline Answer ask(CellKernel kernel, const CellTask& task, const Points& points, const AlignedVector<float>& before) {
  Answer answer;
  for (auto& sum : answer.sums) sum = before;
  AlignedVector<int32_t> listed(size_t(points.size) + k_batch_padding);
  const int count = kernel(task, points.view(),
                           {answer.sums[0].data(), answer.sums[1].data(), answer.sums[2].data(), answer.sums[3].data(),
                            answer.sums[4].data(), answer.sums[5].data()},
                           listed.data());
  answer.undecided.assign(listed.begin(), listed.begin() + count);
  return answer;
}
inline Answer ask(Isa isa, const CellTask& task, const Points& points, const AlignedVector<float>& before) {
  return ask(cell_kernels(isa).see_cell, task, points, before);
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
inline RadiancePyramids noisy_radiance(int texels, int count, TestRandom& random) {
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

// Noisy maps of several sizes, of radiance likewise, and their views.
struct NoisyMaps {
  NoisyMaps(std::initializer_list<int> texels, std::initializer_list<int> radiance_texels, TestRandom& random) {
    constexpr int k_count = 4;
    for (const int t : texels) maps.push_back(noisy_maps(t, random));
    for (const DirectionMaps& m : maps) views.push_back(m.view());
    for (const int t : radiance_texels) pyramids.push_back(noisy_radiance(t, k_count, random));
    for (const RadiancePyramids& p : pyramids) radiance.push_back(p.view());
  }
  NoisyMaps(const NoisyMaps&) = delete;
  NoisyMaps& operator=(const NoisyMaps&) = delete;

  std::vector<DirectionMaps> maps;
  std::vector<MapsView> views;
  std::vector<RadiancePyramids> pyramids;
  std::vector<RadianceView> radiance;
};

// Light that comes back from some of what a task holds.
inline void add_radiance(std::span<const RadianceView> views, TestRandom& random, RandomTask& r) {
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

// Without views: no maps.
inline void make_task(std::span<const MapsView> views, TestRandom& random, RandomTask& r) {
  const int cell = int(random.index(16));
  const Vec3 d = direction_in(cell, 4, random.uniform(), random.uniform());
  const auto map = [&] {
    MapLines lines = lines_of(views[random.index(uint32_t(views.size()))], cell, 4, random.log_uniform(1e-2f, 10.0f));
    lines.slope_u = random.uniform(-9.0f, 9.0f), lines.slope_v = random.uniform(-9.0f, 9.0f);
    lines.reach *= random.log_uniform(1e-4f, 1e4f);
    return lines;
  };
  if (!views.empty() && random.index(2)) {
    r.own.lines = map();
    const CellFrame frame = cell_frame(cell / 4, cell % 4, 4);
    for (int a = 0; a < 3; ++a) r.own.s[a] = frame.s[a], r.own.t[a] = frame.t[a], r.own.c[a] = frame.c[a];
    r.own.clear_within = random.uniform(0.0f, 2.0f);
    r.own.hidden_from = r.own.clear_within + random.uniform(0.0f, 4.0f);
    r.task.own = &r.own;
  }
  for (uint32_t n = views.empty() ? 0 : random.index(4); n > 0; --n) r.maps.push_back(map());
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

inline Points random_points(const RandomTask& r, size_t count, TestRandom& random) {
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

}  // namespace fieldtrace::test
