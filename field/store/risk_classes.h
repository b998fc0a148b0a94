// Risk classes: how likely a cell's answer is wrong, and which classes answer at a tolerance.
//
// A cell whose lines disagree has class 2 ... k_worst_class by the share of the minority. Where all K lines agree, the
// neighbours in the slice count too: a visibility cell has class 0 if they agree with it, else class 1; a depth cell
// has class 0 if none of their lines hits well in front of its plane (for a miss: hits at all), else class 2. The share
// of wrong answers in each class was measured on held-out lines: docs/decisions/003-certificates.md. Thread-safety:
// pure functions.
#pragma once

#include <algorithm>

#include "field/store/view.h"

namespace fieldtrace {

// The error bound stored with a plane fit is this multiple of the largest residual seen: at 2, 99.3 to 99.7 % of fresh
// lines lie within it (docs/decisions/003-certificates.md).
inline constexpr float k_residual_factor = 2.0f;

// The user's dial, unless it is set: errors of about .001 of a picture's white.
inline constexpr float k_default_tolerance = 0.1f;

inline constexpr int k_worst_class = 15;

// Class of a depth cell beside an edge, where its own lines agree.
inline constexpr int k_edge_class = 2;

// Class of a cell whose lines disagree: `minority` of `lines` lines, each class spanning 1/28 of minority share.
inline int disagreeing_class(int minority, int lines) {
  const float share = float(minority) / float(std::max(lines, 1));
  return std::clamp(2 + int(share * 28.0f), 2, k_worst_class);
}

// The largest class that answers at `tolerance` in [0, 1]; -1: none. Up to the default, 0.1, only cells answer whose
// lines and neighbours all agree; above it the admitted minority share grows to one half at 1.
inline int max_class_at(float tolerance) {
  if (tolerance <= 0.0f) return -1;
  if (tolerance <= k_default_tolerance) return 0;
  return 1 + int((tolerance - k_default_tolerance) / (1.0f - k_default_tolerance) * float(k_worst_class - 1) + 0.5f);
}

// Which cells of a field answer at `tolerance` in [0, 1].
inline QueryPolicy query_policy(float tolerance) {
  const int max_class = max_class_at(tolerance);
  return {.visibility_max_class = max_class,
          .depth_max_class = max_class,
          .answer_all = tolerance >= 1.0f,
          .slack = tolerance / k_default_tolerance};
}

}  // namespace fieldtrace
