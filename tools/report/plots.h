// Line plots as inline SVG.
//
// Thread-safety: pure functions.
#pragma once

#include <string>
#include <utility>
#include <vector>

namespace fieldtrace {

struct PlotSeries {
  std::string label;
  std::vector<std::pair<double, double>> points;
  bool dashed = false;
  bool guide = false;  // a thin grey line without marks, beside which the axes need not reach
};

struct Plot {
  std::string title, x_label, y_label;
  bool log_x = false, log_y = false;  // logarithmic axes omit points that are not positive
  std::vector<PlotSeries> series;
};

// An <svg> element with markers and a legend per series. Axes start at 0 unless logarithmic.
std::string svg_plot(const Plot& plot);

}  // namespace fieldtrace
