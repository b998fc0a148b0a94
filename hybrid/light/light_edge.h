// One edge across a light: the part of it that a shading point sees, from a lattice of points seen or hidden and from
// where the edge crosses the lattice's lines.
//
// The lattice has side x side points, row by row, from edge to edge of the square [-1, 1]^2 that the light is sampled
// from; its cells are the (side - 1)^2 squares between. docs/decisions/020-edges.md.
// Thread-safety: pure functions.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace fieldtrace {

// Where an edge crosses a line between two neighbouring points of a lattice, as far as it is known.
struct EdgeCrossing {
  uint32_t owner = 0;              // the caller's number of the lattice
  uint16_t point = 0;              // the line's first point
  bool down = false;               // the line leads to the next row, else to the next column
  bool hidden = false;             // whether the first point is
  float begin = 0.0f, end = 1.0f;  // the edge lies between these, as shares of the line

  float middle() const { return 0.5f * (begin + end); }
  // What was found at `place`, between begin and end.
  void narrow(float place, bool is_hidden) { (is_hidden == hidden ? begin : end) = place; }
};

struct SquarePoint {
  float x = 0, y = 0;
};
// Of a lattice: point number `point`; `place`: share of the crossing's line; x, y: shares of the cell whose first point
// is `corner`.
SquarePoint lattice_point(int point, int side);
SquarePoint point_in(int corner, int side, float x, float y);
SquarePoint point_on(const EdgeCrossing& crossing, int side, float place);

// If the points can be told apart by one edge that runs from rim to rim: appends its crossings, true. Else (all points
// alike; islands; bands; several edges) appends nothing. hidden: side * side numbers, 0 or 1; side >= 2.
bool find_crossings(std::span<const uint8_t> hidden, int side, uint32_t owner, std::vector<EdgeCrossing>& crossings);

// The first points of the cells whose corners are alike.
std::vector<int> even_cells(std::span<const uint8_t> hidden, int side);

// What is seen of a cell: its share, [0, 1], and the middle (centroid) of that part, in the square.
struct CellSeen {
  float share = 0.0f;
  SquarePoint middle;
  bool is_crossed = false;
  SquarePoint begin, along;  // of a crossed cell's edge, a straight piece, in cells; the hidden part is on its left

  // The place of a crossed cell, in cells, so far off the edge's middle, at a right angle: above 0: on the hidden side.
  SquarePoint beside_middle(float away) const;
};
// Of each cell, row by row, for the crossings that find_crossings() made of these points. Between two crossings the
// edge is an arc that turns as much as the straight pieces before and after it say; middles are those of straight
// pieces.
void measure_cells(std::span<const uint8_t> hidden, int side, std::span<const EdgeCrossing> crossings,
                   std::span<CellSeen> cells);

// How often each crossing is to be narrowed down by halves. An edge crosses about 1.6 (side - 1) lines and errs by
// h^2 / (2^bisection steps sqrt 12) at each, where h is a cell's width: as much as `light_samples` samples of the
// light, .42 M^-.75 (docs/decisions/009-cones.md), if 2^bisection steps is (h sqrt M)^1.5. One bisection step more: it
// costs one point of every line, and halves the noise.
int edge_bisection_steps(int side, int light_samples);

}  // namespace fieldtrace
