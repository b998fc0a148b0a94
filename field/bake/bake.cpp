#include "field/bake/bake.h"

#include <algorithm>
#include <thread>
#include <vector>

#include "core/platform/stopwatch.h"
#include "field/bake/cell_lines.h"
#include "field/store/encode.h"
#include "field/store/risk_classes.h"

namespace fieldtrace {
namespace {

constexpr int k_cells = scalar::k_slice_cells;
constexpr int k_first_round = 4;         // lines a cell traces before it may stop
constexpr size_t k_slices_at_once = 16;  // bounds the ray batch: 16 * 32 cells * 12 lines = 6144 rays

// Largest residual of a plane fit, in ball radii (docs/decisions/003-certificates.md), and in half widths of a plane
// cell; the smaller of the two holds.
constexpr float k_max_residual = 0.005f;
constexpr float k_max_residual_cells = 0.64f;

// A depth cell's lines fan out from a pivot at its frontmost hit. A pivot that turns out to lie further from it than
// this many half widths of a plane cell is moved there, and the lines are traced anew.
constexpr float k_near_pivot = 4.0f;

// A depth cell's lines spread over this many cell widths: an edge that none of them meets makes the whole cell wrong,
// and with it a sizeable part of a light for many shading points at once (docs/decisions/011-hard-meshes.md).
constexpr float k_depth_footprint = 1.4f;

// A depth cell is undecided where a line of a neighbouring cell hits more than this many plane cells in front of its
// plane fit: an edge runs there, which its own lines may have missed (docs/decisions/011-hard-meshes.md).
constexpr float k_front_cells = 2.0f;

// Normalises a geometric normal. Its length is proportional to the triangle's area in object units, so its square may
// leave single precision.
Vec3 unit_normal(const Vec3& n) {
  // Within these bounds no square overflows, and one that underflows is below 2^-26 of the sum.
  constexpr float k_least_square = 0x1p-100f, k_largest_square = 0x1p126f;
  const float square = glm::dot(n, n);
  if (square >= k_least_square && square <= k_largest_square) return glm::normalize(n);
  return Vec3(glm::normalize(DVec3(n)));
}

struct Claimed {
  uint32_t slice;
  uint32_t first_cell;
  SliceAddress at;
};

// The rays of one round, each with the cell (index into the batch's cells) that it is traced for.
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

// Whether `holds` is true of cell i of a batch or of any of its neighbours in the same slice.
template <class Holds>
bool any_beside(uint32_t i, const Holds& holds) {
  const int a = int(i % k_cells) / 8, b = int(i % k_cells) % 8;
  for (int na = std::max(a - 1, 0); na <= std::min(a + 1, 3); ++na) {
    for (int nb = std::max(b - 1, 0); nb <= std::min(b + 1, 7); ++nb) {
      if (holds(i / k_cells * k_cells + uint32_t(na * 8 + nb))) return true;
    }
  }
  return false;
}

class SliceBaker {
 public:
  SliceBaker(Field& field, const Accel& accel, uint32_t shape, BakeCounters& counters)
      : field_(field), parameters_(field.parameters()), accel_(accel), shape_(shape), counters_(counters) {}

  void bake_visibility(std::span<const Claimed> slices);
  void bake_depth(std::span<const Claimed> slices);
  void bake_primitive(std::span<const Claimed> slices);

 private:
  struct DepthCellFit {
    float depth = 0.0f;  // of the pivot; 0, the centre plane, until a line hits
    int lines = 0, hits = 0;
    std::array<Vec3, k_max_lines> points, normals;  // of the lines that hit, in unit space
  };

  // The plane through the hits that lie on one surface with hit `anchor`, as the cell will store it.
  struct FittedPlane {
    uint32_t word = 0;             // depth and normal, encoded
    Vec3 normal = Vec3(0.0f);      // decoded
    float offset = 0.0f;           // dot(normal, x) = offset
    bool faces = false;            // the plane faces the lines' origins
    int members = 0;               // hits that the plane was fitted to
    float member_residual = 0.0f;  // their largest distance from the plane
    float distance(const Vec3& p) const { return glm::dot(normal, p) - offset; }
  };
  FittedPlane fit_plane(const DepthCellFit& cell, int anchor, const Vec3& in_plane, const Vec3& axis) const;

  void add_line(Round& round, const Line& line, uint32_t cell) {
    const float half_squared = 1.0f - glm::dot(line.foot, line.foot);
    if (half_squared <= 0.0f) return;  // outside the ball: a miss without a ray
    const float half = std::sqrt(half_squared);
    const float radius = field_.ball().radius;
    const Vec3 origin = field_.ball().centre + (line.foot - line.direction * half) * radius;
    round.rays.set(round.count, origin, line.direction * radius, 2.0f * half);
    round.cell[round.count++] = cell;
  }
  void add_centre_line(Round& round, const Claimed& s, uint32_t i, const CellFrame& frame) {
    constexpr std::array<float, 4> centre = {0.5f, 0.5f, 0.5f, 0.5f};
    add_line(round, foot_line(frame, s.at.u, s.at.v, cell_a(s, i), cell_b(s, i), centre, parameters_), i);
  }
  static int cell_a(const Claimed& s, uint32_t i) { return s.at.a0 + int(i % k_cells) / 8; }
  static int cell_b(const Claimed& s, uint32_t i) { return s.at.b0 + int(i % k_cells) % 8; }
  // Seed of the cell's line pattern: a function of the cell's place alone.
  uint32_t cell_seed(const Claimed& s, uint32_t i) const { return s.slice * uint32_t(k_cells) + i % k_cells; }

  std::array<float, 4> depth_point(const Claimed& s, uint32_t i, int k) const {
    return widened(cell_point(cell_seed(s, i), k), s.at.u, s.at.v, parameters_.directions, k_depth_footprint);
  }

  void trace_depth_lines(std::vector<DepthCellFit>& cells, Round& round);
  // Whether a line of this cell or of a neighbour hits at a point for which `counts` is true.
  template <class Counts>
  static bool meets_beside(const std::vector<DepthCellFit>& cells, uint32_t i, const Counts& counts) {
    return any_beside(i, [&](uint32_t j) {
      const auto begin = cells[j].points.begin();
      return std::any_of(begin, begin + cells[j].hits, counts);
    });
  }
  void store_depth_cell(const Claimed& slice, uint32_t i, const std::vector<DepthCellFit>& cells,
                        const CellFrame& frame);

  Field& field_;
  const FieldParameters& parameters_;
  const Accel& accel_;
  uint32_t shape_;
  BakeCounters& counters_;
  float max_residual_ = std::min(k_max_residual, k_max_residual_cells / float(parameters_.plane));
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
    } else if (any_beside(i, [&](uint32_t j) { return !unanimous(j) || (hits[j] > 0) != hit; })) {
      risk = 1;
    }
    field_.store_visibility(slices[i / k_cells].first_cell + i % k_cells, encode_visibility(hit, risk));
  }
}

void SliceBaker::trace_depth_lines(std::vector<DepthCellFit>& cells, Round& round) {
  round.end();
  ShapeHits hits;
  hits.resize(round.count);
  accel_.shape_intersect(shape_, round.rays, hits);
  counters_.rays += round.count;
  const float inverse_radius = 1.0f / field_.ball().radius;
  for (size_t r = 0; r < round.count; ++r) {
    if (hits.t[r] < 0.0f) continue;
    DepthCellFit& cell = cells[round.cell[r]];
    const Vec3 direction = round.rays.direction(r) * inverse_radius;
    const Vec3 origin = (round.rays.origin(r) - field_.ball().centre) * inverse_radius;
    // Normals are turned against the line: open and two-sided meshes need no inside.
    Vec3 normal = unit_normal({hits.nx[r], hits.ny[r], hits.nz[r]});
    if (glm::dot(normal, direction) > 0.0f) normal = -normal;
    cell.points[cell.hits] = origin + direction * hits.t[r];
    cell.normals[cell.hits] = normal;
    ++cell.hits;
  }
}

SliceBaker::FittedPlane SliceBaker::fit_plane(const DepthCellFit& cell, int anchor, const Vec3& in_plane,
                                              const Vec3& axis) const {
  FittedPlane plane;
  const auto member = [&](int k) {
    return glm::dot(cell.normals[k], cell.normals[anchor]) > 0.0f &&
           std::abs(glm::dot(cell.points[k] - cell.points[anchor], cell.normals[anchor])) <= 4.0f * max_residual_;
  };
  Vec3 centroid(0.0f), normal(0.0f);
  for (int k = 0; k < cell.hits; ++k) {
    if (!member(k)) continue;
    centroid += cell.points[k];
    normal += cell.normals[k];
    ++plane.members;
  }
  centroid *= 1.0f / float(plane.members);
  // Quantise the normal first, then choose the depth at which the quantised plane passes through the centroid.
  const uint32_t normal_bits = encode_normal(glm::normalize(normal));
  const auto decoded = scalar::decode_normal<float>(int32_t(normal_bits));
  plane.normal = Vec3(decoded.x, decoded.y, decoded.z);
  const float cosine = glm::dot(plane.normal, axis);
  plane.faces = cosine < 0.0f;
  // dot(n, in_plane + axis depth - centroid) = 0. A plane parallel to the line has no such depth; its cell stays
  // undecided.
  const uint32_t depth_bits = encode_depth(plane.faces ? glm::dot(plane.normal, centroid - in_plane) / cosine : 1.0f);
  plane.word = depth_bits | normal_bits;
  plane.offset = glm::dot(plane.normal, in_plane + axis * scalar::decode_depth<float>(int32_t(depth_bits)));
  for (int k = 0; k < cell.hits; ++k) {
    if (member(k)) plane.member_residual = std::max(plane.member_residual, std::abs(plane.distance(cell.points[k])));
  }
  return plane;
}

void SliceBaker::store_depth_cell(const Claimed& slice, uint32_t i, const std::vector<DepthCellFit>& cells,
                                  const CellFrame& frame) {
  const DepthCellFit& cell = cells[i];
  const uint32_t target = slice.first_cell + i % k_cells;
  const int misses = cell.lines - cell.hits;
  if (cell.hits == 0) {
    const int risk = meets_beside(cells, i, [](const Vec3&) { return true; }) ? k_edge_class : 0;
    field_.store_plane_fit(target, 0, encode_certificate(scalar::k_kind_miss, risk, 255));
    return;
  }
  const float plane_cells = float(parameters_.plane);
  const Vec3 in_plane = frame.s * ((float(cell_a(slice, i)) + 0.5f) * (2.0f / plane_cells) - 1.0f) +
                        frame.t * ((float(cell_b(slice, i)) + 0.5f) * (2.0f / plane_cells) - 1.0f);
  const auto store = [&](const FittedPlane& plane, int kind, int risk, float residual) {
    const float error = k_residual_factor * residual + scalar::k_depth_quantum;
    field_.store_plane_fit(target, plane.word, encode_certificate(kind, risk, encode_error(error)));
  };

  const float well_in_front = k_front_cells * 2.0f / plane_cells;
  const auto edge_class = [&](const FittedPlane& plane) {
    return meets_beside(cells, i, [&](const Vec3& p) { return plane.distance(p) > well_in_front; }) ? k_edge_class : 0;
  };

  const FittedPlane plane = fit_plane(cell, 0, in_plane, frame.c);
  float residual = 0.0f;
  for (int k = 0; k < cell.hits; ++k) {
    residual = std::max(residual, std::abs(plane.distance(cell.points[k])));
  }
  const bool is_one_surface = residual <= max_residual_ && plane.faces;
  if (is_one_surface && misses == 0) {
    store(plane, scalar::k_kind_plane_fit, edge_class(plane), residual);
    return;
  }
  // What the plane of the frontmost hit does not cover lies behind it: it is still a one-sided bound.
  int front = 0;
  for (int k = 1; k < cell.hits; ++k) {
    if (glm::dot(cell.points[k] - cell.points[front], frame.c) < 0.0f) front = k;
  }
  const FittedPlane bound = fit_plane(cell, front, in_plane, frame.c);
  float above = bound.member_residual;
  for (int k = 0; k < cell.hits; ++k) above = std::max(above, bound.distance(cell.points[k]));
  if (bound.faces && above <= max_residual_) {
    int behind = 0;  // hits on another surface, which may extend further forward than these hits
    for (int k = 0; k < cell.hits; ++k) behind += bound.distance(cell.points[k]) < -2.0f * above;
    // Nor may the bound rest on a few lines alone.
    const bool mostly_one = 4 * behind < cell.hits && 4 * cell.hits >= cell.lines;
    store(bound, scalar::k_kind_one_sided, mostly_one ? edge_class(bound) : disagreeing_class(behind, cell.lines),
          above);
    return;
  }
  if (misses > cell.hits) {
    field_.store_plane_fit(target, 0,
                           encode_certificate(scalar::k_kind_miss, disagreeing_class(cell.hits, cell.lines), 255));
    return;
  }
  const int minority = misses > 0 ? misses : std::max(cell.lines - plane.members, 1);
  store(plane, scalar::k_kind_plane_fit, disagreeing_class(minority, cell.lines), residual);
}

void SliceBaker::bake_depth(std::span<const Claimed> slices) {
  const size_t cell_count = slices.size() * k_cells;
  std::vector<CellFrame> frames;
  for (const Claimed& s : slices) frames.push_back(cell_frame(s.at.u, s.at.v, parameters_.directions));
  std::vector<DepthCellFit> cells(cell_count);
  Round round;

  round.begin(cell_count);
  for (uint32_t i = 0; i < cell_count; ++i) {
    add_centre_line(round, slices[i / k_cells], i, frames[i / k_cells]);
    cells[i].lines = 1;
  }
  trace_depth_lines(cells, round);
  // Lines fan out from the frontmost surface found so far: shading points lie there. Where the first round finds a
  // surface far from the pivot (the centre plane, if the centre line missed), the cell starts again from that depth.
  const float near_depth = k_near_pivot / float(parameters_.plane);
  const auto frontmost = [&](uint32_t i) {
    float depth = k_infinity;
    for (int k = 0; k < cells[i].hits; ++k) {
      depth = std::min(depth, glm::dot(cells[i].points[k], frames[i / k_cells].c));
    }
    return depth;
  };
  for (uint32_t i = 0; i < cell_count; ++i) {
    if (cells[i].hits == 1) cells[i].depth = frontmost(i);
  }
  const auto trace_round = [&](int begin, int end) {
    round.begin(cell_count * size_t(end - begin));
    for (uint32_t i = 0; i < cell_count; ++i) {
      if (cells[i].lines >= end) continue;
      const Claimed& s = slices[i / k_cells];
      for (int k = cells[i].lines; k < end; ++k) {
        add_line(round,
                 depth_line(frames[i / k_cells], s.at.u, s.at.v, cell_a(s, i), cell_b(s, i), cells[i].depth,
                            depth_point(s, i, k), parameters_),
                 i);
      }
      cells[i].lines = end;
    }
    trace_depth_lines(cells, round);
  };
  trace_round(1, k_first_round);
  for (uint32_t i = 0; i < cell_count; ++i) {
    DepthCellFit& cell = cells[i];
    if (cell.hits == 0) continue;
    const float depth = frontmost(i);
    if (std::abs(depth - cell.depth) <= near_depth) continue;
    cell.depth = depth;
    cell.lines = cell.hits = 0;
  }
  trace_round(0, parameters_.lines);
  for (uint32_t i = 0; i < cell_count; ++i) store_depth_cell(slices[i / k_cells], i, cells, frames[i / k_cells]);
}

void SliceBaker::bake_primitive(std::span<const Claimed> slices) {
  const size_t cell_count = slices.size() * k_cells;
  Round round;
  round.begin(cell_count);
  for (size_t s = 0; s < slices.size(); ++s) {
    const CellFrame frame = cell_frame(slices[s].at.u, slices[s].at.v, parameters_.directions);
    for (uint32_t i = 0; i < uint32_t(k_cells); ++i) {
      add_centre_line(round, slices[s], uint32_t(s) * k_cells + i, frame);
    }
  }
  round.end();
  ShapeHits hits;
  hits.resize(round.count);
  accel_.shape_intersect(shape_, round.rays, hits);
  counters_.rays += round.count;
  std::vector<uint32_t> primitives(cell_count, k_none);
  for (size_t r = 0; r < round.count; ++r) {
    if (hits.t[r] >= 0.0f) primitives[round.cell[r]] = hits.primitive[r];
  }
  for (uint32_t i = 0; i < cell_count; ++i) {
    field_.store_primitive(slices[i / k_cells].first_cell + i % k_cells, primitives[i]);
  }
}

// The slices claimed by one call, in order. Those unfinished when an exception ends the call are given back, because
// other threads wait for them.
struct Claims {
  Field& field;
  FieldLayer layer;
  std::vector<Claimed> list;
  size_t finished = 0;

  Claims(Field& f, FieldLayer l) : field(f), layer(l) {}
  Claims(const Claims&) = delete;
  ~Claims() {
    for (const Claimed& c : std::span(list).subspan(finished)) field.give_back(layer, c.slice);
  }
  // Unchecked: the list has room, so that nothing can throw between claiming a slice and noting it.
  bool take(uint32_t slice) {
    const auto cell = field.claim(layer, slice);
    if (cell) list.push_back({slice, *cell, field.slice_address(slice)});
    return cell.has_value();
  }
  std::span<const Claimed> next(size_t most) const {
    return std::span(list).subspan(finished, std::min(most, list.size() - finished));
  }
  void finish(size_t count) {
    for (; count > 0; --count) field.finish(layer, list[finished++].slice);
  }
};

}  // namespace

void bake_slices(Field& field, FieldLayer layer, std::span<const uint32_t> slices, const Accel& accel, uint32_t shape,
                 BakeCounters& counters) {
  const ScopedTimer timer(counters.seconds);
  Claims claims(field, layer);
  claims.list.reserve(slices.size());
  std::vector<uint32_t> elsewhere;
  elsewhere.reserve(slices.size());
  SliceBaker baker(field, accel, shape, counters);
  const auto bake_claims = [&] {
    while (claims.finished < claims.list.size()) {
      const auto part = claims.next(k_slices_at_once);
      switch (layer) {
        case FieldLayer::visibility:
          baker.bake_visibility(part);
          break;
        case FieldLayer::depth:
          baker.bake_depth(part);
          break;
        case FieldLayer::primitive:
          baker.bake_primitive(part);
          break;
      }
      claims.finish(part.size());
    }
  };
  for (const uint32_t slice : slices) {
    if (field.finished(layer, slice)) continue;
    if (!claims.take(slice) && !field.pool_full()) elsewhere.push_back(slice);
  }
  bake_claims();
  // A thread bakes what it has claimed before it waits, so this ends. Slices that another thread failed to bake were
  // given back, and are baked here; if the pool is full, no thread can bake them.
  for (const uint32_t slice : elsewhere) {
    while (!field.finished(layer, slice) && !field.pool_full()) {
      std::this_thread::yield();
      if (claims.take(slice)) bake_claims();
    }
  }
}

}  // namespace fieldtrace
