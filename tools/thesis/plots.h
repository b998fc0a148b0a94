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
};

struct Plot {
  std::string title, x_label, y_label;
  bool log_x = false, log_y = false;  // logarithmic axes leave out points that are not positive
  std::vector<PlotSeries> series;
};

// An <svg> element; markers and a legend for each series. The axes begin at 0 unless logarithmic.
std::string svg_plot(const Plot& plot);

// & < > " as entities.
std::string html_text(const std::string& text);

}  // namespace fieldtrace
