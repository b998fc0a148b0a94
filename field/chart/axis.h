// One axis of a chart as the constants that look-ups use. Shared by every instruction set and the GPU, hence outside
// the lane namespaces. Thread-safety: values.
#pragma once

namespace fieldtrace {

// [-1, 1] cut into n cells; every constant is exact, n being a power of two.
struct ChartAxis {
  float cells = 0.0f;  // n
  float half = 0.0f;   // n / 2
  float last = 0.0f;   // n - 1
  float step = 0.0f;   // 2 / n
  float start = 0.0f;  // centre of the first cell, 1 / n - 1
};

constexpr ChartAxis make_axis(int n) {
  return {float(n), 0.5f * float(n), float(n) - 1.0f, 2.0f / float(n), 1.0f / float(n) - 1.0f};
}

}  // namespace fieldtrace
