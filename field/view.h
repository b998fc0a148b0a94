// A field as plain pointers, and what a tolerance means to its cells. Shared by every instruction set and the GPU,
// which is why these two types live outside the lane namespaces.
//
// Thread-safety: values; the pointers are valid while the Field lives. Memory layout: field/layout.hd.h.
#pragma once

#include <cstdint>

namespace fieldtrace {

struct FieldView {
  float directions = 0.0f, plane = 0.0f;  // D and N as floats: they only enter float arithmetic
  int direction_bricks = 0;               // D / 4
  int plane_bricks_b = 0;                 // N / 8
  int plane_bricks = 0;                   // (N / 4) (N / 8)
  const int32_t* top = nullptr;           // (D / 4)^2
  const int32_t* pages = nullptr;         // page * plane_bricks + plane brick
  const uint8_t* visibility = nullptr;
  const int32_t* depth = nullptr;
  const int32_t* certificate = nullptr;
  const int32_t* primitive = nullptr;
};

// A cell answers if its risk class is at most this. max_class < 0: none answers. answer_all: depth comparisons that are
// too near to tell are decided by their sign.
struct QueryPolicy {
  int visibility_max_class = 0;
  int depth_max_class = 0;
  bool answer_all = false;
};

}  // namespace fieldtrace
