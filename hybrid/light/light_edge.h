// Follows one edge across a light: the part of the light that a shading point sees, from a lattice of probed points and
// from where the edge crosses the lattice's lines (docs/decisions/020-edges.md).
//
// The lattice has side x side points, row by row, from border to border of the square [-1, 1]^2 that the light is
// sampled from; its cells are the (side - 1)^2 squares between them.
// Thread-safety: pure functions.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace fieldtrace {

// Where an edge crosses a line between two neighbouring points of a lattice, as far as it is known.
struct EdgeCrossing {
  uint32_t owner = 0;              // the caller's number for the lattice
  uint16_t point = 0;              // the line's first point
  bool down = false;               // the line leads to the next row, else to the next column
  bool hidden = false;             // whether the first point is
  float begin = 0.0f, end = 1.0f;  // the edge lies between these shares of the line

  float middle() const { return 0.5f * (begin + end); }
  // Halves the interval by what was found at `place`, between begin and end.
  void narrow(float place, bool is_hidden) { (is_hidden == hidden ? begin : end) = place; }
};

struct SquarePoint {
  float x = 0, y = 0;
};
// A place in the square: of lattice point number `point`; of a share `place` of a crossing's line; or of shares x, y of
// the cell whose first point is `corner`.
SquarePoint lattice_point(int point, int side);
SquarePoint point_in(int corner, int side, float x, float y);
SquarePoint point_on(const EdgeCrossing& crossing, int side, float place);

// If one edge from rim to rim separates seen from hidden points, appends its crossings and returns true. Otherwise (all
// points alike, islands, bands, several edges) appends nothing. hidden: side * side numbers, 0 or 1; side >= 2.
bool find_crossings(std::span<const uint8_t> hidden, int side, uint32_t owner, std::vector<EdgeCrossing>& crossings);

// The first points of the cells whose corners are all alike.
std::vector<int> even_cells(std::span<const uint8_t> hidden, int side);

// What is seen of a cell: its share, [0, 1], and the centroid of that part, in the square.
struct CellSeen {
  float share = 0.0f;
  SquarePoint middle;
  bool is_crossed = false;
  SquarePoint begin, along;  // the straight piece of edge in a crossed cell, in cells; the hidden part is on its left

  // For a crossed cell: the place at a distance of `away`, in cells, from the piece's middle, perpendicular to it;
  // positive on the hidden side.
  SquarePoint beside_middle(float away) const;
};
// Measures each cell, row by row, with the crossings that find_crossings() made of these points. Between two crossings
// the edge is taken for an arc that turns as much as its neighbouring straight pieces do; centroids are those of the
// straight pieces.
void measure_cells(std::span<const uint8_t> hidden, int side, std::span<const EdgeCrossing> crossings,
                   std::span<CellSeen> cells);

// The number of bisection steps for each crossing. An edge crosses about 1.6 (side - 1) lines and errs by h^2 /
// (2^steps sqrt 12) at each, where h is a cell's width as a share of the square's: that equals the error of
// `light_samples` samples, .42 M^-.75 (docs/decisions/009-cones.md), if 2^steps is (h sqrt M)^1.5. One step more costs
// one ray for every line, and halves the noise.
int edge_bisection_steps(int side, int light_samples);

}  // namespace fieldtrace
