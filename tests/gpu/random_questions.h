// Random fields, and random questions about them with extreme values among them, for tests of kernels and devices.
//
// Thread-safety: one thread each.
#pragma once

#include <bit>
#include <limits>

#include "field/query/query.hd.h"
#include "field/query/segment_kernels.h"
#include "field/store/field.h"
#include "tests/support/random_lines.h"

namespace fieldtrace::gpu {

inline constexpr size_t k_most_entries = 4096;  // of one launch

// ---- fields of random cells

// Empty, whole, behind an edge, or noise; at one depth, on a slope, or in two layers.
inline TileLines random_tile(TestRandom& random) {
  TileLines lines(CoverageTiles::k_lines_per_tile);
  const uint32_t shape = random.index(6), depths = random.index(4), depth = 1 + random.index(1000);
  const float x = random.uniform(-1, 1), y = random.uniform(-1, 1), edge = random.uniform(-8.0f, 40.0f);
  for (uint32_t i = 0; i < lines.size(); ++i) {
    const float column = float(i % 32), row = float(i / 32);
    const bool inside = shape == 0   ? false
                        : shape <= 2 ? true
                        : shape <= 4 ? x * column + y * row < edge
                                     : random.index(2) == 0;
    uint32_t code = depth;
    if (depths == 1)
      code = 1 + uint32_t(std::min(std::max(float(depth) + 8 * x * column + 8 * y * row, 0.0f), 1022.0f));
    if (depths == 2) code = row < 16 ? depth : 1 + (depth + 300) % 1000;
    if (depths == 3) code = std::min(depth + random.index(3), 1023u);
    lines[i] = uint16_t(inside ? code : 0);
  }
  return lines;
}

class RandomField {
 public:
  // baked: share of the slices and tiles.
  // has_tiles: bakes coverage, too.
  RandomField(const FieldParameters& parameters, float baked, TestRandom& random, bool has_tiles = true)
      : field_(Sphere{Vec3(0.0f), 1.0f}, parameters) {
    for (const FieldLayer layer : {FieldLayer::visibility, FieldLayer::depth}) {
      for (uint32_t slice = 0; slice < field_.slice_count(); ++slice) {
        if (random.uniform() < baked) bake(layer, slice, random);
      }
    }
    for (uint32_t slot = 0; has_tiles && slot < field_.coverage().slot_count(); ++slot) {
      if (random.uniform() < baked) bake_tile(slot, random);
    }
  }
  const Field& field() const { return field_; }
  FieldView view() const { return field_.view(); }

 private:
  void bake(FieldLayer layer, uint32_t slice, TestRandom& random) {
    const std::optional<uint32_t> cell = field_.claim(layer, slice);
    if (!cell) return;
    for (uint32_t c = *cell; c < *cell + uint32_t(scalar::k_slice_cells); ++c) {
      if (layer == FieldLayer::visibility) {
        field_.store_visibility(c, uint8_t(1 + random.index(128)));
        continue;
      }
      const uint32_t kind = 1 + random.index(3), risk = random.index(64), error = random.index(256);
      field_.store_plane_fit(c, random.index(0xffffffffu), kind | risk << 2 | error << 8);
    }
    field_.finish(layer, slice);
  }
  void bake_tile(uint32_t slot, TestRandom& random) {
    if (field_.coverage().claim(slot)) field_.coverage().finish(slot, random_tile(random));
  }

  Field field_;
};

// Radiance maps of random tiles.
class RandomMaps {
 public:
  // baked: share of the tiles.
  RandomMaps(int directions, int plane, float baked, TestRandom& random)
      : tiles_(directions, plane, nullptr, TilePayload::radiance) {
    view_.directions = make_axis(directions);
    view_.coverage = tiles_.view();
    std::vector<Rgb> radiance(CoverageTiles::k_lines_per_tile);
    for (uint32_t slot = 0; slot < tiles_.slot_count(); ++slot) {
      if (random.uniform() >= baked || !tiles_.claim(slot)) continue;
      const TileLines lines = random_tile(random);
      const Rgb colour(random.uniform(), random.log_uniform(1e-3f, 1e3f), 0.0f);
      for (size_t i = 0; i < lines.size(); ++i) {
        radiance[i] = lines[i] == 0 ? Rgb(0.0f) : colour * random.uniform(0.5f, 1.0f);
      }
      tiles_.finish(slot, lines, radiance);
    }
  }
  const CoverageTiles& tiles() const { return tiles_; }
  const FieldView& view() const { return view_; }

 private:
  CoverageTiles tiles_;
  FieldView view_;
};

// ---- random and extreme values

inline constexpr float k_extremes[] = {0.0f,
                                       -0.0f,
                                       1.0f,
                                       -1.0f,
                                       0x1p-149f,
                                       -0x1p-149f,
                                       0x1.fffffcp-127f,
                                       0x1p-126f,
                                       0x1p-60f,
                                       0x1p60f,
                                       0x1.fffffep127f,
                                       -0x1.fffffep127f,
                                       0x1.fffffep-1f,
                                       0x1.000002p0f,
                                       2147483648.0f,
                                       std::numeric_limits<float>::infinity(),
                                       -std::numeric_limits<float>::infinity(),
                                       std::numeric_limits<float>::quiet_NaN(),
                                       -std::numeric_limits<float>::quiet_NaN()};

class Values {
 public:
  explicit Values(uint32_t seed) : random(seed) {}

  // `value`, or with a probability of `wild` an extreme one.
  float spoilt(float value) {
    if (random.uniform() >= wild) return value;
    return random.index(4) == 0 ? std::bit_cast<float>(random.index(0xffffffffu))
                                : k_extremes[random.index(uint32_t(std::size(k_extremes)))];
  }
  Vec3 spoilt(const Vec3& v) { return {spoilt(v.x), spoilt(v.y), spoilt(v.z)}; }

  TestRandom random;
  float wild = 0.0f;
};

// ---- one object under a random transform, and questions about it

struct Launch {
  SegmentTask task;
  float from_unit[9];
  Vec3 centre;  // of the object, in world space
  float size;
  size_t entries, warps;
};

inline Launch random_launch(const FieldView& view, Values& values) {
  TestRandom& random = values.random;
  Launch l;
  l.entries = 1 + random.index(k_most_entries);
  l.warps = padded(l.entries) / k_warp;
  // Many launches without extreme values in the transform, some with them.
  values.wild = random.index(8) == 0 ? 0.1f : 0.0f;
  const Vec3 x = random.direction(), z = glm::normalize(glm::cross(x, random.direction())), y = glm::cross(z, x);
  const bool is_similar = random.index(2) == 0;
  l.size = random.log_uniform(1e-2f, 1e2f);
  const float squash = is_similar ? 1.0f : random.log_uniform(0.05f, 1.0f);
  l.centre = l.size * 3.0f * random.in_ball();
  const Mat3 linear(x * l.size, y * (l.size * squash), z * l.size), inverse = glm::inverse(linear);
  const Vec3 offset = -(inverse * l.centre);
  for (int c = 0; c < 3; ++c) {
    for (int r = 0; r < 3; ++r) {
      l.task.to_unit[3 * c + r] = values.spoilt(inverse[c][r]);
      l.from_unit[3 * c + r] = values.spoilt(linear[c][r]);
    }
    l.task.to_unit[9 + c] = values.spoilt(offset[c]);
  }
  l.task.to_unit_stretch = values.spoilt(1.0f / (l.size * squash));
  l.task.to_unit_area = values.spoilt(1.0f / (l.size * l.size * squash));
  l.task.keeps_angles = is_similar && random.index(4) != 0;
  l.task.field = view;
  l.task.policy = {int(random.index(66)) - 1, int(random.index(66)) - 1, random.index(4) == 0,
                   random.log_uniform(0.1f, 10.0f)};
  l.task.instance = random.index(3);
  l.task.self_only = random.index(8) == 0;
  l.task.reads_depth = random.index(8) != 0;
  // Of the entries of a launch none, few or many are extreme.
  const float wild[] = {0.0f, 0.0f, 0.002f, 0.05f};
  values.wild = wild[random.index(4)];
  return l;
}

inline Launch random_launch(const RandomField& field, Values& values) { return random_launch(field.view(), values); }

// Rays about the object of a launch, past or towards it; those of the padding are inactive.
inline RayBatch rays_about(const Launch& l, Values& values) {
  TestRandom& random = values.random;
  RayBatch rays;
  rays.resize(l.entries);
  for (size_t i = 0; i < l.entries; ++i) {
    const Vec3 o = l.centre + l.size * random.uniform(0.0f, 3.0f) * random.direction();
    const Vec3 to = l.centre + l.size * 1.1f * random.in_ball();
    const float length = random.log_uniform(0.05f, 5.0f);
    const float tmax = random.index(16) == 0 ? -1.0f : random.index(8) == 0 ? k_infinity : length;
    rays.set(i, values.spoilt(o), values.spoilt(to - o), values.spoilt(tmax));
  }
  return rays;
}

struct QueryInputs {
  explicit QueryInputs(const Launch& l, Values& values) : rays(rays_about(l, values)), instances(padded(l.entries)) {
    for (uint32_t& i : instances) i = values.random.index(3);
  }
  RayBatch rays;
  AlignedVector<uint32_t> instances;
};

struct StratumInputs {
  StratumInputs(const Launch& l, Values& values)
      : rays(rays_about(l, values)), pdf(padded(l.entries)), radius(padded(l.entries)), wanted(padded(l.entries)) {
    TestRandom& random = values.random;
    task.segment = l.task;
    task.share = 1.0f / float(1 + random.index(64));
    task.least_disc = random.log_uniform(0.1f, 4.0f);
    const float least_pdf = random.log_uniform(0.1f, 1e4f);
    for (size_t i = 0; i < l.entries; ++i) {
      pdf[i] = values.spoilt(random.index(32) == 0 ? 0.0f : least_pdf * random.log_uniform(1.0f, 100.0f));
      radius[i] = values.spoilt(random.index(2) == 0 ? 0.0f : l.size * random.log_uniform(1e-4f, 0.1f));
      wanted[i] = random.index(8) != 0;
    }
  }
  StratumTask task;
  RayBatch rays;
  AlignedVector<float> pdf, radius;
  AlignedVector<int32_t> wanted;
};

struct ConeInputs {
  ConeInputs(const Launch& l, Values& values) {
    TestRandom& random = values.random;
    task.segment = l.task;
    std::copy_n(l.from_unit, 9, task.from_unit);
    for (float& h : task.half_extent) h = random.uniform(0.1f, 0.6f);
    task.plane_fit_side = int(random.index(5));
    const float distance = random.log_uniform(1.5f, 30.0f);
    light = {values.spoilt(l.centre + l.size * distance * random.direction()),
             values.spoilt(l.size * distance * random.log_uniform(1e-4f, 0.5f))};
    points.resize(l.entries);
    flags.assign(padded(l.entries), 0);
    for (size_t i = 0; i < l.entries; ++i) {
      // In the object's shadow, or anywhere.
      Vec3 p = l.centre + l.size * random.uniform(0.0f, 3.0f) * random.direction(), n = random.direction();
      if (random.index(2) == 0) {
        const Vec3 away = glm::normalize(l.centre + l.size * random.in_ball() - light.centre);
        p = l.centre + l.size * (random.in_ball() + random.uniform(0.0f, 3.0f) * away);
        n = -away;
      }
      p = values.spoilt(p), n = values.spoilt(n);
      points.px[i] = p.x, points.py[i] = p.y, points.pz[i] = p.z;
      points.gx[i] = n.x, points.gy[i] = n.y, points.gz[i] = n.z;
      points.error[i] = values.spoilt(l.size * 1e-6f);
      points.radius[i] = values.spoilt(random.index(2) == 0 ? 0.0f : l.size * random.log_uniform(1e-4f, 0.2f));
      points.instance[i] = random.index(3);
      points.transmits[i] = random.index(8) == 0;
      flags[i] = int32_t(random.index(8));
    }
  }
  ConeTask task;
  Sphere light;
  ShadingPointBatch points;
  AlignedVector<int32_t> flags;
};

// Samples of lobes about the object of a launch over radiance maps.
struct LobeInputs {
  LobeInputs(const Launch& l, Values& values) {
    TestRandom& random = values.random;
    task.segment = l.task;
    std::copy_n(l.from_unit, 9, task.from_unit);
    for (float& h : task.half_extent) h = random.uniform(0.1f, 0.6f);
    lobes.resize(l.entries);
    lobes.rays = rays_about(l, values);
    std::fill(lobes.density.begin(), lobes.density.end(), 0.0f);
    const float least_density = random.log_uniform(1.0f, 1e4f);
    for (size_t i = 0; i < l.entries; ++i) {
      const Vec3 d = glm::normalize(lobes.rays.direction(i));
      if (lobes.rays.tmax[i] >= 0.0f) lobes.rays.set(i, lobes.rays.origin(i), d, values.spoilt(k_infinity));
      const Vec3 n = values.spoilt(random.index(4) == 0 ? random.direction() : d);
      lobes.nx[i] = n.x, lobes.ny[i] = n.y, lobes.nz[i] = n.z;
      lobes.density[i] = values.spoilt(least_density * random.log_uniform(1.0f, 1e3f));
      lobes.blur[i] = values.spoilt(random.log_uniform(0.01f, 0.5f));
      lobes.instance[i] = random.index(3);
    }
  }
  ConeTask task;
  LobeBatch lobes;
};

}  // namespace fieldtrace::gpu
