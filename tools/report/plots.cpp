#include "tools/report/plots.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>

#include "tools/report/html.h"

namespace fieldtrace {
namespace {

constexpr double k_width = 570, k_height = 320, k_left = 70, k_right = 190, k_top = 34, k_bottom = 46;
constexpr const char* k_colours[] = {"#c0392b", "#2471a3", "#1e8449", "#b9770e", "#7d3c98",
                                     "#117a65", "#5d6d7e", "#a04000", "#d35d9e", "#1f3a93"};

// One axis: maps values to [0, 1] and places its ticks.
struct Axis {
  bool log = false;
  double low = 0, high = 1;

  void fit(const std::vector<double>& values) {
    if (values.empty()) return;
    const auto [least, most] = std::minmax_element(values.begin(), values.end());
    if (log) {
      low = std::log10(*least) - 0.05, high = std::log10(*most) + 0.05;
    } else {
      low = 0.0, high = *most > 0.0 ? 1.08 * *most : 1.0;
    }
  }
  double place(double v) const { return ((log ? std::log10(v) : v) - low) / (high - low); }
  // Near `rough`: 1, 2 or 5 times a power of ten.
  static double even_step(double rough) {
    const double decade = std::pow(10.0, std::floor(std::log10(rough)));
    return decade * (rough / decade < 1.5 ? 1 : rough / decade < 3.5 ? 2 : rough / decade < 7.5 ? 5 : 10);
  }
  std::vector<double> ticks() const {
    std::vector<double> all;
    if (log) {
      // Ticks at powers of ten, and at twos and fives if there are few of these.
      const bool few = high - low < 2.5;
      for (int e = int(std::floor(low)); e <= int(std::ceil(high)); ++e) {
        for (const double f : {1.0, 2.0, 5.0}) {
          const double v = f * std::pow(10.0, e);
          if ((f == 1.0 || few) && std::log10(v) >= low && std::log10(v) <= high) all.push_back(v);
        }
      }
      if (all.size() >= 2) return all;
      // Less than a factor of two or so: even steps.
      all.clear();
      const double least = std::pow(10.0, low), most = std::pow(10.0, high), step = even_step((most - least) / 4.0);
      for (double v = std::ceil(least / step) * step; v <= most; v += step) all.push_back(v);
      return all;
    }
    const double step = even_step(high / 5.0);
    for (double v = 0.0; v <= high; v += step) all.push_back(v);
    return all;
  }
};

// An identifier within the page, from the title.
std::string clip_name(const Plot& plot) {
  std::string name = "clip-";
  for (const char c : plot.title) name += std::isalnum(static_cast<unsigned char>(c)) ? c : '-';
  return name;
}

std::string number(double v) {
  if (v >= 1e6) return fmt::format("{:.3g} M", v * 1e-6);
  if (v >= 1e4) return fmt::format("{:.3g} k", v * 1e-3);
  return fmt::format("{:.4g}", v);
}

}  // namespace

std::string svg_plot(const Plot& plot) {
  Axis x{plot.log_x}, y{plot.log_y};
  const auto usable = [&](const std::pair<double, double>& p) {
    return std::isfinite(p.first) && std::isfinite(p.second) && (!plot.log_x || p.first > 0) &&
           (!plot.log_y || p.second > 0);
  };
  std::vector<double> xs, ys;
  for (const PlotSeries& s : plot.series) {
    if (s.guide) continue;
    for (const auto& p : s.points) {
      if (usable(p)) xs.push_back(p.first), ys.push_back(p.second);
    }
  }
  x.fit(xs);
  y.fit(ys);
  const double right = k_width - k_right, bottom = k_height - k_bottom;
  const auto px = [&](double v) { return k_left + x.place(v) * (right - k_left); };
  const auto py = [&](double v) { return bottom - y.place(v) * (bottom - k_top); };
  std::string svg = fmt::format(
      "<svg viewBox=\"0 0 {0} {1}\" width=\"{0}\" height=\"{1}\" role=\"img\" font-family=\"sans-serif\" "
      "font-size=\"11\">\n<text x=\"{2}\" y=\"18\" font-size=\"13\" font-weight=\"bold\">{3}</text>\n",
      k_width, k_height, k_left, html_text(plot.title));
  for (const double v : x.ticks()) {
    svg += fmt::format(
        "<line x1=\"{0:.1f}\" x2=\"{0:.1f}\" y1=\"{1}\" y2=\"{2}\" stroke=\"#ddd\"/>"
        "<text x=\"{0:.1f}\" y=\"{3}\" text-anchor=\"middle\">{4}</text>\n",
        px(v), k_top, bottom, bottom + 15, number(v));
  }
  for (const double v : y.ticks()) {
    svg += fmt::format(
        "<line x1=\"{1}\" x2=\"{2}\" y1=\"{0:.1f}\" y2=\"{0:.1f}\" stroke=\"#ddd\"/>"
        "<text x=\"{3}\" y=\"{4:.1f}\" text-anchor=\"end\">{5}</text>\n",
        py(v), k_left, right, k_left - 5, py(v) + 4, number(v));
  }
  svg += fmt::format("<text x=\"{:.1f}\" y=\"{}\" text-anchor=\"middle\">{}</text>\n", 0.5 * (k_left + right),
                     k_height - 8, html_text(plot.x_label));
  svg += fmt::format("<text transform=\"translate(14 {:.1f}) rotate(-90)\" text-anchor=\"middle\">{}</text>\n",
                     0.5 * (k_top + bottom), html_text(plot.y_label));
  // Guides may leave the axes' range.
  const bool guides = std::any_of(plot.series.begin(), plot.series.end(), [](const PlotSeries& s) { return s.guide; });
  if (guides)
    svg += fmt::format("<clipPath id=\"{0}\"><rect x=\"{1}\" y=\"{2}\" width=\"{3}\" height=\"{4}\"/></clipPath>\n",
                       clip_name(plot), k_left, k_top, right - k_left, bottom - k_top);
  size_t colours = 0;
  for (size_t i = 0; i < plot.series.size(); ++i) {
    const PlotSeries& s = plot.series[i];
    const char* colour = s.guide ? "#888" : k_colours[colours++ % std::size(k_colours)];
    const char* width = s.guide ? "1" : "1.6";
    const char* dash = s.dashed || s.guide ? " stroke-dasharray=\"5 4\"" : "";
    std::string line, marks;
    for (const auto& p : s.points) {
      if (!usable(p)) continue;
      line += fmt::format("{:.1f},{:.1f} ", px(p.first), py(p.second));
      if (s.guide) continue;
      marks +=
          fmt::format("<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"3\" fill=\"{}\"/>", px(p.first), py(p.second), colour);
    }
    svg +=
        fmt::format("<polyline points=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"{}\"{}{}/>{}\n", line, colour,
                    width, dash, s.guide ? fmt::format(" clip-path=\"url(#{})\"", clip_name(plot)) : "", marks);
    const double at = k_top + 8 + 16.0 * double(i);
    svg += fmt::format(
        "<line x1=\"{0}\" x2=\"{1}\" y1=\"{2}\" y2=\"{2}\" stroke=\"{3}\" stroke-width=\"{4}\"{5}/>"
        "<text x=\"{6}\" y=\"{7}\">{8}</text>\n",
        right + 10, right + 32, at, colour, width, dash, right + 37, at + 4, html_text(s.label));
  }
  return svg + "</svg>\n";
}

}  // namespace fieldtrace
