// The lines that certify a cell: sample points in the cell's four dimensions, and the lines that they stand for.
//
// Space: unit space. Thread-safety: pure functions.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "core/math/math.h"
#include "field/store/field.h"

namespace fieldtrace {

// A line through the unit ball: its foot (the point nearest to the centre) and unit direction.
struct Line {
  Vec3 foot;
  Vec3 direction;
};

// The frame of a direction cell.
struct CellFrame {
  Vec3 c, s, t;
};
CellFrame cell_frame(int u, int v, int directions);
// A line along a frame's c: its foot, and half its length within the ball.
struct BallLine {
  Vec3 foot;
  float half;
};
// Of the middle of texel (x, y) of the plane [-1, 1]^2 of s and t; none outside the ball.
std::optional<BallLine> line_of_texel(const CellFrame& frame, int x, int y, int texels);
// The direction at (x, y) of a cell, x and y in [0, 1].
Vec3 direction_in_cell(int u, int v, float x, float y, int directions);
// The number u D + v of the cell of a unit direction.
int direction_cell(const Vec3& direction, int directions);
// The number of the cell whose directions are opposite to those of cell `cell`. Its frame has the same s, and opposite
// t and c. `directions` is even.
int opposite_cell(int cell, int directions);

// Point k of a low-discrepancy sequence in [0, 1)^4 (Roberts' R4: additive recurrence with the powers of 1 / phi_4,
// phi_4 the root of x^5 = x + 1), shifted modulo 1 by a hash of `cell`.
std::array<float, 4> cell_point(uint32_t cell, int k);

// The point `x` of direction cell (u, v), spread about the cell's middle to `width` (>= 1) cells in all four
// dimensions; directions are clamped to the map's square, beyond whose edge there are none.
std::array<float, 4> widened(std::array<float, 4> x, int u, int v, int directions, float width);

// The line of the visibility cell (u, v, a, b) at point x of the cell: direction within the direction cell, foot within
// the plane cell.
Line foot_line(const CellFrame& frame, int u, int v, int a, int b, const std::array<float, 4>& x,
               const FieldParameters& parameters);

// The line through the plane cell's point x[2], x[3] at `depth` along the cell's direction, in direction x[0], x[1].
Line depth_line(const CellFrame& frame, int u, int v, int a, int b, float depth, const std::array<float, 4>& x,
                const FieldParameters& parameters);

}  // namespace fieldtrace
