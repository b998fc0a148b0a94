#include "field/bake/cell_lines.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "core/simd/vec_lanes.h"
#include "field/chart/chart.hd.h"

namespace fieldtrace {
namespace {

float in_cell(int i, float x, int n) { return (float(i) + x) * (2.0f / float(n)) - 1.0f; }

// Finalizer of MurmurHash3 (Appleby): four operations, and no library's, since it chooses the lines that cells are
// baked from. With other bits every field, and with it the pictures, would differ in their noise.
uint32_t mix(uint32_t h) {
  h ^= h >> 16;
  h *= 0x85ebca6bu;
  h ^= h >> 13;
  h *= 0xc2b2ae35u;
  return h ^ (h >> 16);
}

}  // namespace

Vec3 direction_in_cell(int u, int v, float x, float y, int directions) {
  return to_vec(scalar::frame_from_square(in_cell(u, x, directions), in_cell(v, y, directions)).c);
}

int direction_cell(const Vec3& direction, int directions) {
  scalar::CellAddress<float> cell;
  scalar::find_direction_cell(lanes(direction), make_axis(directions), cell);
  return cell.u * directions + cell.v;
}

int opposite_cell(int cell, int directions) {
  // Of centres, in 1 / D: opposite directions lie beyond the diamond of the hemisphere, as far from its edges.
  const int u = 2 * (cell / directions) + 1 - directions, v = 2 * (cell % directions) + 1 - directions;
  const int to_u = (u < 0 ? 1 : -1) * (directions - std::abs(v)), to_v = (v < 0 ? 1 : -1) * (directions - std::abs(u));
  return (to_u + directions - 1) / 2 * directions + (to_v + directions - 1) / 2;
}

CellFrame cell_frame(int u, int v, int directions) {
  const auto f = scalar::frame_from_square(in_cell(u, 0.5f, directions), in_cell(v, 0.5f, directions));
  return {to_vec(f.c), to_vec(f.s), to_vec(f.t)};
}

std::optional<BallLine> line_of_texel(const CellFrame& frame, int x, int y, int texels) {
  const float s = in_cell(x, 0.5f, texels), t = in_cell(y, 0.5f, texels), squared = 1.0f - (s * s + t * t);
  if (squared <= 0.0f) return {};
  return BallLine{frame.s * s + frame.t * t, std::sqrt(squared)};
}

std::array<float, 4> cell_point(uint32_t cell, int k) {
  // 2^32 / phi_4^i for i = 1 ... 4.
  constexpr uint32_t alpha[4] = {3679390609u, 3152041523u, 2700274806u, 2313257605u};
  std::array<float, 4> x;
  uint32_t h = cell;
  for (int i = 0; i < 4; ++i) {
    h = mix(h + 0x9e3779b9u);
    x[i] = float((h + alpha[i] * uint32_t(k)) >> 8) * 0x1p-24f;
  }
  return x;
}

std::array<float, 4> widened(std::array<float, 4> x, int u, int v, int directions, float width) {
  for (float& coordinate : x) coordinate = 0.5f + (coordinate - 0.5f) * width;
  x[0] = std::clamp(x[0], -float(u), float(directions - u));
  x[1] = std::clamp(x[1], -float(v), float(directions - v));
  return x;
}

Line foot_line(const CellFrame& f, int u, int v, int a, int b, const std::array<float, 4>& x,
               const FieldParameters& p) {
  Line line;
  line.direction = direction_in_cell(u, v, x[0], x[1], p.directions);
  const Vec3 in_plane = f.s * in_cell(a, x[2], p.plane) + f.t * in_cell(b, x[3], p.plane);
  // The foot is perpendicular to the line's own direction and projects to `in_plane` along the cell's direction.
  line.foot = in_plane - f.c * (glm::dot(in_plane, line.direction) / glm::dot(f.c, line.direction));
  return line;
}

Line depth_line(const CellFrame& f, int u, int v, int a, int b, float depth, const std::array<float, 4>& x,
                const FieldParameters& p) {
  Line line;
  line.direction = direction_in_cell(u, v, x[0], x[1], p.directions);
  const Vec3 pivot = f.s * in_cell(a, x[2], p.plane) + f.t * in_cell(b, x[3], p.plane) + f.c * depth;
  line.foot = pivot - line.direction * glm::dot(pivot, line.direction);
  return line;
}

}  // namespace fieldtrace
