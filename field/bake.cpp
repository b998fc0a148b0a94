#include "field/bake.h"

#include <algorithm>
#include <chrono>
#include <thread>
#include <vector>

#include "field/encode.h"
#include "field/lines.h"
#include "field/risk.h"

namespace fieldtrace {
namespace {

constexpr int k_cells = scalar::k_slice_cells;
constexpr int k_first_round = 4;         // lines a cell traces before it may stop
constexpr size_t k_slices_at_once = 16;  // bounds the ray batch: 16 * 32 cells * 12 lines = 6144 rays

// A sheet's normals may spread by this much about their mean (cosine of 37 degrees), and its points lie this far off
// the plane, in radii (prototype figures of the design).
constexpr float k_min_normal_cosine = 0.8f;
constexpr float k_max_residual = 0.01f;
// The bound stored is this multiple of the largest residual seen: chosen so that 99.9 % of fresh lines lie within it
// (docs/decisions/003-certificates.md).
constexpr float k_residual_factor = 2.0f;

struct Claimed {
  uint32_t slice;
  uint32_t first_cell;
  SliceAddress at;
};

// Rays of the current round, each with the slice cell (index into the batch's cells) that it serves.
struct Round {
  RayBatch rays;
  std::vector<uint32_t> cell;
  size_t count = 0;

  void begin(size_t capacity) {
    rays.resize(capacity);
    cell.resize(capacity);
    count = 0;
  }
  void end() { rays.resize(count); }
};

class SliceBaker {
 public:
  SliceBaker(Field& field, const Accel& accel, uint32_t shape, BakeCounters& counters)
      : field_(field), parameters_(field.parameters()), accel_(accel), shape_(shape), counters_(counters) {}

  void bake_visibility(std::span<const Claimed> slices);
  void bake_depth(std::span<const Claimed> slices);

 private:
  struct SheetCell {
    bool centre_hit = false;
    bool active = false;
    float depth = 0.0f;  // of the centre line's hit; 0, the centre plane, on a miss
    uint32_t primitive = k_none;
    int lines = 0, hits = 0;
    std::array<Vec3, k_max_lines> points, normals;  // of the lines that hit, in unit space
  };

  void add_line(Round& round, const Line& line, uint32_t cell) {
    const float half_squared = 1.0f - glm::dot(line.foot, line.foot);
    if (half_squared <= 0.0f) return;  // outside the ball: a miss without a ray
    const float half = std::sqrt(half_squared);
    const float radius = field_.ball().radius;
    const Vec3 origin = field_.ball().centre + (line.foot - line.direction * half) * radius;
    round.rays.set(round.count, origin, line.direction * radius, 2.0f * half);
    round.cell[round.count++] = cell;
  }
  static int cell_a(const Claimed& s, uint32_t i) { return s.at.a0 + int(i % k_cells) / 8; }
  static int cell_b(const Claimed& s, uint32_t i) { return s.at.b0 + int(i % k_cells) % 8; }
  // Seeds the cell's line pattern: depends on nothing but the cell's place.
  uint32_t cell_seed(const Claimed& s, uint32_t i) const { return s.slice * uint32_t(k_cells) + i % k_cells; }

  void trace_sheet_lines(std::vector<SheetCell>& cells, Round& round);
  void store_sheet(const Claimed& slice, uint32_t i, const SheetCell& cell, const CellFrame& frame);

  Field& field_;
  const FieldParameters& parameters_;
  const Accel& accel_;
  uint32_t shape_;
  BakeCounters& counters_;
};

void SliceBaker::bake_visibility(std::span<const Claimed> slices) {
  const size_t cell_count = slices.size() * k_cells;
  std::vector<CellFrame> frames;
  for (const Claimed& s : slices) frames.push_back(cell_frame(s.at.u, s.at.v, parameters_.directions));
  std::vector<int> hits(cell_count, 0), lines(cell_count, 0);
  std::vector<uint8_t> blocked;
  Round round;
  for (int begin = 0; begin < parameters_.lines;) {
    const int end = begin == 0 ? k_first_round : parameters_.lines;
    round.begin(cell_count * size_t(end - begin));
    for (uint32_t i = 0; i < cell_count; ++i) {
      if (hits[i] != 0 && hits[i] != lines[i]) continue;
      const Claimed& s = slices[i / k_cells];
      for (int k = begin; k < end; ++k) {
        add_line(round,
                 foot_line(frames[i / k_cells], s.at.u, s.at.v, cell_a(s, i), cell_b(s, i),
                           cell_point(cell_seed(s, i), k), parameters_),
                 i);
      }
      lines[i] = end;
    }
    round.end();
    blocked.resize(padded(round.count));
    accel_.shape_occluded(shape_, round.rays, blocked.data());
    for (size_t r = 0; r < round.count; ++r) hits[round.cell[r]] += blocked[r];
    counters_.rays += round.count;
    begin = end;
  }
  const auto unanimous = [&](uint32_t i) { return hits[i] == 0 || hits[i] == lines[i]; };
  for (uint32_t i = 0; i < cell_count; ++i) {
    const bool hit = 2 * hits[i] >= lines[i];
    int risk = 0;
    if (!unanimous(i)) {
      risk = disagreeing_class(std::min(hits[i], lines[i] - hits[i]), lines[i]);
    } else {
      const int a = int(i % k_cells) / 8, b = int(i % k_cells) % 8;
      for (int da = std::max(a - 1, 0); da <= std::min(a + 1, 3); ++da) {
        for (int db = std::max(b - 1, 0); db <= std::min(b + 1, 7); ++db) {
          const uint32_t j = i / k_cells * k_cells + uint32_t(da * 8 + db);
          if (!unanimous(j) || (hits[j] > 0) != hit) risk = 1;
        }
      }
    }
    field_.store_visibility(slices[i / k_cells].first_cell + i % k_cells, encode_visibility(hit, risk));
  }
}

void SliceBaker::trace_sheet_lines(std::vector<SheetCell>& cells, Round& round) {
  round.end();
  ShapeHits hits;
  hits.resize(round.count);
  accel_.shape_intersect(shape_, round.rays, hits);
  counters_.rays += round.count;
  const float inverse_radius = 1.0f / field_.ball().radius;
  for (size_t r = 0; r < round.count; ++r) {
    if (hits.t[r] < 0.0f) continue;
    SheetCell& cell = cells[round.cell[r]];
    const Vec3 direction = round.rays.direction(r) * inverse_radius;
    const Vec3 origin = (round.rays.origin(r) - field_.ball().centre) * inverse_radius;
    // Normals are turned to the side that the line comes from: open and two-sided meshes need no inside.
    Vec3 normal = glm::normalize(Vec3(hits.nx[r], hits.ny[r], hits.nz[r]));
    if (glm::dot(normal, direction) > 0.0f) normal = -normal;
    cell.points[cell.hits] = origin + direction * hits.t[r];
    cell.normals[cell.hits] = normal;
    if (cell.hits == 0) cell.primitive = hits.primitive[r];
    ++cell.hits;
  }
}

void SliceBaker::store_sheet(const Claimed& slice, uint32_t i, const SheetCell& cell, const CellFrame& frame) {
  const uint32_t target = slice.first_cell + i % k_cells;
  const int misses = cell.lines - cell.hits;
  if (cell.hits == 0 || misses > cell.hits) {
    const int risk = cell.hits == 0 ? 0 : disagreeing_class(cell.hits, cell.lines);
    field_.store_sheet(target, 0, encode_certificate(scalar::k_kind_miss, risk, 255), k_none);
    return;
  }
  // The sheet nearest to the centre line, or to the first hit where the centre line misses.
  const Vec3 anchor = cell.points[0], anchor_normal = cell.normals[0];
  Vec3 centroid(0.0f), normal(0.0f);
  int members = 0;
  for (int k = 0; k < cell.hits; ++k) {
    if (glm::dot(cell.normals[k], anchor_normal) < k_min_normal_cosine) continue;
    if (std::abs(glm::dot(cell.points[k] - anchor, anchor_normal)) > 4.0f * k_max_residual) continue;
    centroid += cell.points[k];
    normal += cell.normals[k];
    ++members;
  }
  centroid *= 1.0f / float(members);
  normal = glm::normalize(normal);
  const float plane = float(parameters_.plane);
  const Vec3 in_plane = frame.s * ((float(cell_a(slice, i)) + 0.5f) * (2.0f / plane) - 1.0f) +
                        frame.t * ((float(cell_b(slice, i)) + 0.5f) * (2.0f / plane) - 1.0f);
  // Quantise the normal first, then choose the depth at which the quantised plane passes through the centroid.
  const uint32_t normal_bits = encode_normal(normal);
  const auto decoded = scalar::decode_normal<float>(int32_t(normal_bits));
  const Vec3 n(decoded.x, decoded.y, decoded.z);
  const float cosine = glm::dot(n, frame.c);
  // dot(n, in_plane + c depth - centroid) = 0. A plane along the line has no such depth; its cell will ask.
  const uint32_t depth_bits = encode_depth(cosine < 0.0f ? glm::dot(n, centroid - in_plane) / cosine : 1.0f);
  const float stored = scalar::decode_depth<float>(int32_t(depth_bits));
  const Vec3 hit = in_plane + frame.c * stored;
  float residual = 0.0f, spread = 1.0f;
  for (int k = 0; k < cell.hits; ++k) {
    residual = std::max(residual, std::abs(glm::dot(cell.points[k] - hit, n)));
    spread = std::min(spread, glm::dot(cell.normals[k], n));
  }
  const float error = k_residual_factor * residual + scalar::k_depth_quantum;
  int risk = 0;
  if (misses > 0) {
    risk = disagreeing_class(misses, cell.lines);
  } else if (residual > k_max_residual || spread < k_min_normal_cosine || cosine >= 0.0f) {
    risk = disagreeing_class(std::max(cell.lines - members, 1), cell.lines);
  } else if (cell.lines < parameters_.lines) {
    risk = 2;
  }
  field_.store_sheet(target, depth_bits | normal_bits,
                     encode_certificate(scalar::k_kind_sheet, risk, encode_error(error)), cell.primitive);
}

void SliceBaker::bake_depth(std::span<const Claimed> slices) {
  const size_t cell_count = slices.size() * k_cells;
  std::vector<CellFrame> frames;
  for (const Claimed& s : slices) frames.push_back(cell_frame(s.at.u, s.at.v, parameters_.directions));
  std::vector<SheetCell> cells(cell_count);
  Round round;
  constexpr std::array<float, 4> centre = {0.5f, 0.5f, 0.5f, 0.5f};

  round.begin(cell_count);
  for (uint32_t i = 0; i < cell_count; ++i) {
    const Claimed& s = slices[i / k_cells];
    add_line(round, foot_line(frames[i / k_cells], s.at.u, s.at.v, cell_a(s, i), cell_b(s, i), centre, parameters_), i);
    cells[i].lines = 1;
  }
  trace_sheet_lines(cells, round);
  for (uint32_t i = 0; i < cell_count; ++i) {
    cells[i].centre_hit = cells[i].hits == 1;
    cells[i].active = true;
    if (cells[i].centre_hit) cells[i].depth = glm::dot(cells[i].points[0], frames[i / k_cells].c);
  }
  for (int begin = 1; begin < parameters_.lines;) {
    const int end = begin == 1 ? k_first_round : parameters_.lines;
    round.begin(cell_count * size_t(end - begin));
    for (uint32_t i = 0; i < cell_count; ++i) {
      SheetCell& cell = cells[i];
      cell.active = cell.active && (cell.hits == 0 || cell.hits == cell.lines);
      for (int k = 1; k < cell.hits && cell.active; ++k) {
        const float off_plane = glm::dot(cell.points[k] - cell.points[0], cell.normals[0]);
        cell.active = std::abs(off_plane) <= 4.0f * k_max_residual &&
                      glm::dot(cell.normals[k], cell.normals[0]) >= k_min_normal_cosine;
      }
      if (!cell.active) continue;
      const Claimed& s = slices[i / k_cells];
      for (int k = begin; k < end; ++k) {
        add_line(round,
                 depth_line(frames[i / k_cells], s.at.u, s.at.v, cell_a(s, i), cell_b(s, i), cell.depth,
                            cell_point(cell_seed(s, i), k), parameters_),
                 i);
      }
      cell.lines = end;
    }
    trace_sheet_lines(cells, round);
    begin = end;
  }
  for (uint32_t i = 0; i < cell_count; ++i) store_sheet(slices[i / k_cells], i, cells[i], frames[i / k_cells]);
}

}  // namespace

void bake_slices(Field& field, FieldLayer layer, std::span<const uint32_t> slices, const Accel& accel, uint32_t shape,
                 BakeCounters& counters) {
  const auto start = std::chrono::steady_clock::now();
  std::vector<Claimed> claimed;
  std::vector<uint32_t> elsewhere;
  for (const uint32_t slice : slices) {
    if (field.finished(layer, slice)) continue;
    if (const auto cell = field.claim(layer, slice)) {
      claimed.push_back({slice, *cell, field.slice_address(slice)});
    } else if (!field.pool_full()) {
      elsewhere.push_back(slice);
    }
  }
  SliceBaker baker(field, accel, shape, counters);
  for (size_t begin = 0; begin < claimed.size(); begin += k_slices_at_once) {
    const auto part = std::span(claimed).subspan(begin, std::min(k_slices_at_once, claimed.size() - begin));
    if (layer == FieldLayer::visibility) {
      baker.bake_visibility(part);
    } else {
      baker.bake_depth(part);
    }
    for (const Claimed& c : part) field.finish(layer, c.slice);
  }
  // Whoever claimed these holds no other wait, so this ends.
  for (const uint32_t slice : elsewhere) {
    while (!field.finished(layer, slice)) std::this_thread::yield();
  }
  counters.seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

}  // namespace fieldtrace
