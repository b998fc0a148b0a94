#include "hybrid/light/light_edge.h"

#include <algorithm>
#include <cmath>

namespace fieldtrace {
namespace {

// Calls visit(point, next) for each pair of neighbours along the rim, once around.
template <class Visit>
void along_rim(int side, const Visit& visit) {
  const int last = side - 1, bottom = last * side;
  for (int i = 0; i < last; ++i) {
    visit(i, i + 1);
    visit(bottom + i, bottom + i + 1);
    visit(i * side, (i + 1) * side);
    visit(i * side + last, (i + 1) * side + last);
  }
}

// The number of points connected to the first one of this kind by steps between neighbours of the same kind.
int reached(std::span<const uint8_t> hidden, int side, uint8_t kind) {
  const auto first = std::find(hidden.begin(), hidden.end(), kind);
  if (first == hidden.end()) return 0;
  std::vector<uint8_t> seen(hidden.size(), 0);
  std::vector<int> open = {int(first - hidden.begin())};
  seen[size_t(open[0])] = 1;
  int count = 0;
  while (!open.empty()) {
    const int point = open.back();
    open.pop_back();
    ++count;
    const auto step = [&](bool inside, int next) {
      if (!inside || seen[size_t(next)] || hidden[size_t(next)] != kind) return;
      seen[size_t(next)] = 1;
      open.push_back(next);
    };
    const int column = point % side, row = point / side;
    step(column > 0, point - 1);
    step(column + 1 < side, point + 1);
    step(row > 0, point - side);
    step(row + 1 < side, point + side);
  }
  return count;
}

// The centroid of a smaller share of a cell is lost in rounding, and too small to matter; the cell's centre is kept.
constexpr float k_least_share = 1e-3f;

// A straight piece of the edge across one cell, with the hidden part on its left.
struct Piece {
  int cell = 0, begin = 0, end = 0;  // crossings where the piece begins and ends
  float dx = 0, dy = 0;              // in cells
};

// The angle by which the second piece turns left of the first; at most k_most_turn, because arcs do not fit corners.
constexpr float k_most_turn = 1.0f;
float turn(const Piece& from, const Piece& to) {
  const float angle = std::atan2(from.dx * to.dy - from.dy * to.dx, from.dx * to.dx + from.dy * to.dy);
  return std::clamp(angle, -k_most_turn, k_most_turn);
}

}  // namespace

SquarePoint lattice_point(int point, int side) { return point_in(point, side, 0.0f, 0.0f); }

SquarePoint point_in(int corner, int side, float x, float y) {
  const float step = 2.0f / float(side - 1);
  return {(float(corner % side) + x) * step - 1.0f, (float(corner / side) + y) * step - 1.0f};
}

SquarePoint point_on(const EdgeCrossing& crossing, int side, float place) {
  return crossing.down ? point_in(crossing.point, side, 0.0f, place) : point_in(crossing.point, side, place, 0.0f);
}

std::vector<int> even_cells(std::span<const uint8_t> hidden, int side) {
  std::vector<int> corners;
  for (int row = 0; row + 1 < side; ++row) {
    for (int column = 0; column + 1 < side; ++column) {
      const size_t first = size_t(row * side + column), below = first + size_t(side);
      const int dark = hidden[first] + hidden[first + 1] + hidden[below] + hidden[below + 1];
      if (dark % 4 == 0) corners.push_back(int(first));
    }
  }
  return corners;
}

bool find_crossings(std::span<const uint8_t> hidden, int side, uint32_t owner, std::vector<EdgeCrossing>& crossings) {
  int changes = 0;
  along_rim(side, [&](int a, int b) { changes += hidden[size_t(a)] != hidden[size_t(b)]; });
  if (changes != 2) return false;
  const int dark = int(std::count(hidden.begin(), hidden.end(), uint8_t(1)));
  if (reached(hidden, side, 1) != dark || reached(hidden, side, 0) != int(hidden.size()) - dark) return false;
  for (int i = 0; i < side * side; ++i) {
    const bool is_hidden = hidden[size_t(i)] != 0;
    const auto line_to = [&](bool inside, int next, bool down) {
      if (inside && (hidden[size_t(next)] != 0) != is_hidden)
        crossings.push_back({owner, uint16_t(i), down, is_hidden});
    };
    line_to(i % side + 1 < side, i + 1, false);
    line_to(i / side + 1 < side, i + side, true);
  }
  return true;
}

SquarePoint CellSeen::beside_middle(float away) const {
  const float length = std::sqrt(along.x * along.x + along.y * along.y);
  const float scale = away / length;  // not 0: crossings lie strictly within their lines
  return {begin.x + 0.5f * along.x - scale * along.y, begin.y + 0.5f * along.y + scale * along.x};
}

void measure_cells(std::span<const uint8_t> hidden, int side, std::span<const EdgeCrossing> crossings,
                   std::span<CellSeen> cells) {
  const int columns = side - 1;
  const float width = 2.0f / float(columns);
  // The crossing on each line, by 2 * point + down.
  std::vector<int> on_line(2 * hidden.size(), -1);
  for (size_t i = 0; i < crossings.size(); ++i) on_line[2u * crossings[i].point + crossings[i].down] = int(i);
  std::vector<Piece> pieces;
  std::vector<int> begins(crossings.size(), -1), ends(crossings.size(), -1);  // pieces by crossing
  for (int row = 0; row < columns; ++row) {
    for (int column = 0; column < columns; ++column) {
      const int first = row * side + column;
      const int corners[4] = {first, first + 1, first + side + 1, first + side};
      int dark = 0;
      for (const int corner : corners) dark += hidden[size_t(corner)];
      CellSeen& cell = cells[size_t(row * columns + column)];
      const auto in_square = [&](float x, float y) {
        return SquarePoint{(float(column) + x) * width - 1.0f, (float(row) + y) * width - 1.0f};
      };
      cell = CellSeen();
      cell.share = dark == 0 ? 1.0f : 0.0f;
      cell.middle = in_square(0.5f, 0.5f);
      if (dark == 0 || dark == 4) continue;
      // The hidden part is a polygon of hidden corners and crossings, in the order of the corners.
      constexpr SquarePoint k_at[4] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
      SquarePoint outline[6];
      int n = 0;
      Piece piece = {row * columns + column};
      for (int i = 0; i < 4; ++i) {
        const int next = (i + 1) % 4;
        const bool here = hidden[size_t(corners[i])] != 0, there = hidden[size_t(corners[next])] != 0;
        if (here) outline[n++] = k_at[i];
        if (here == there) continue;
        const bool down = i % 2 == 1, is_forward = i < 2;
        const int crossing = on_line[size_t(2 * corners[is_forward ? i : next] + down)];
        const float middle = crossings[size_t(crossing)].middle();
        const float place = is_forward ? middle : 1.0f - middle;
        const SquarePoint at = {k_at[i].x + place * (k_at[next].x - k_at[i].x),
                                k_at[i].y + place * (k_at[next].y - k_at[i].y)};
        outline[n++] = at;
        (here ? piece.begin : piece.end) = crossing;
        if (here) cell.begin = at;
        piece.dx += here ? -at.x : at.x;
        piece.dy += here ? -at.y : at.y;
      }
      float area = 0.0f, moment_x = 0.0f, moment_y = 0.0f;
      for (int i = 0; i < n; ++i) {
        const SquarePoint &a = outline[i], &b = outline[(i + 1) % n];
        const float cross = a.x * b.y - b.x * a.y;
        area += cross / 2.0f;
        moment_x += cross * (a.x + b.x) / 6.0f;
        moment_y += cross * (a.y + b.y) / 6.0f;
      }
      cell.share = 1.0f - area;
      if (cell.share > k_least_share) {
        cell.middle = in_square(std::clamp((0.5f - moment_x) / cell.share, 0.0f, 1.0f),
                                std::clamp((0.5f - moment_y) / cell.share, 0.0f, 1.0f));
      }
      cell.is_crossed = true;
      cell.along = {piece.dx, piece.dy};
      begins[size_t(piece.begin)] = ends[size_t(piece.end)] = int(pieces.size());
      pieces.push_back(piece);
    }
  }
  for (const Piece& piece : pieces) {
    const int before = ends[size_t(piece.begin)], after = begins[size_t(piece.end)];
    float turns = 0.0f;
    if (before >= 0) turns += turn(pieces[size_t(before)], piece);
    if (after >= 0) turns += turn(piece, pieces[size_t(after)]);
    if (before >= 0 && after >= 0) turns *= 0.5f;
    float& share = cells[size_t(piece.cell)].share;
    share = std::clamp(share - turns * (piece.dx * piece.dx + piece.dy * piece.dy) / 12.0f, 0.0f, 1.0f);
  }
}

int edge_bisection_steps(int side, int light_samples) {
  const double spacing = std::sqrt(double(light_samples)) / double(side - 1);
  return std::max(int(std::lround(1.5 * std::log2(spacing))), 0) + 1;
}

}  // namespace fieldtrace
