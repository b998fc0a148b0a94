// A field as plain pointers, and which of its cells answer at a tolerance. Shared by every instruction set and the GPU,
// hence outside the lane namespaces.
//
// Thread-safety: values; the pointers are valid while the Field lives. Memory layout: field/store/layout.hd.h.
#pragma once

#include <cstdint>

#include "field/chart/axis.h"

namespace fieldtrace {

// Parallel lines of each direction cell (field/store/coverage.hd.h).
struct CoverageView {
  int tiles = 0;                     // along each side of a plane
  float half_lines = 0.0f;           // L / 2
  const int32_t* tile_of = nullptr;  // direction * tiles^2 + tile
  const int32_t* sums = nullptr;     // tile * k_tile_words
  const float* radiance = nullptr;   // 3 (tile * k_tile_words + corner): sums of red, green, blue; null: not kept
};

struct FieldView {
  ChartAxis directions, plane;     // D and N cells
  int direction_bricks = 0;        // D / 4
  int plane_bricks_b = 0;          // N / 8
  int plane_bricks = 0;            // (N / 4) (N / 8)
  const int32_t* top = nullptr;    // (D / 4)^2
  const int32_t* pages = nullptr;  // page * plane_bricks + plane brick
  const uint8_t* visibility = nullptr;
  const int32_t* depth = nullptr;
  const int32_t* certificate = nullptr;
  const int32_t* primitive = nullptr;
  CoverageView coverage;
};

// A cell answers if its risk class is at most this. max_class < 0: none answers. answer_all: no query stays undecided;
// depth comparisons within the margin are decided by their sign, and what no cell sees is clear. slack: what bundles of
// rays admit of estimated errors, relative to the default tolerance's.
struct QueryPolicy {
  int visibility_max_class = 0;
  int depth_max_class = 0;
  bool answer_all = false;
  float slack = 1.0f;
};

}  // namespace fieldtrace
