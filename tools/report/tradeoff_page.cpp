#include "tools/report/tradeoff_page.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <map>
#include <sstream>
#include <thread>

#include "tools/report/compared_pictures.h"
#include "tools/report/embedded_picture.h"
#include "tools/report/html.h"
#include "tools/report/plots.h"

namespace fieldtrace {
namespace {

using Rows = std::vector<std::vector<std::string>>;

constexpr double k_mb = 1e-6;

constexpr const char* k_begin = R"(<h1>Speed against accuracy</h1>
<p>Scene {}, {} x {} pixels, {} triangles in {} instances, {} lights. Measured on {}, with {} threads, {}, version {}, by
<code>{}</code></p>
<p>Error is the root of the mean squared difference (rmse) of linear radiance over R, G and B to a reference: Monte Carlo
with {} samples a pixel and other seeds. Times are wall seconds of one render each, without loading the scene and writing
the picture; they were not repeated, so differences of a few per cent mean nothing. Cold: with an empty field cache, the
bake is counted. Warm: a second render with the cache of the first.</p>
)";

constexpr const char* k_time_begin = R"(<h2>Error against time</h2>
<p>Both axes are logarithmic. Lower and further to the left is better. Full lines: over samples a pixel; dashed: pictures
to an error that was asked for (<code>--target-error</code>). Grey: the slope of independent samples, whose error falls
with the square root of the time, through Monte Carlo's last point. Monte Carlo is the same in both plots.</p>
)";

constexpr const char* k_equal_begin = R"(<h2>Monte Carlo's time to the same error</h2>
<p>Between two measured errors of Monte Carlo, linear in logarithms; beyond them it is only known that it takes more or
less. Rows over samples are compared with Monte Carlo over samples (with <code>--light-estimator adaptive</code>, its
best), rows to an error with Monte Carlo to an error. The last column: from which frame on the hybrid with a cache, its
bake counted, has taken less time than Monte Carlo.</p>
)";

constexpr const char* k_target_begin = R"(<h2>Pictures to an error</h2>
<p>Each picture takes samples where they lower its error most, until it holds its error to be at most the target. Its
estimate and the error that was measured, which has the reference's own noise in it, should agree.</p>
)";

constexpr const char* k_memory_begin = R"(<h2>Error against memory</h2>
<p>Fields of several resolutions, D x D directions and planes of N x N cells, with the same samples. Only what rays ask
for is baked and kept.</p>
)";

constexpr const char* k_parts_begin = R"(<h2>Bias and variance</h2>
<p>Pictures of {} seeds each. A picture's mean squared error is the square of its bias, which more samples do not lower,
and its variance, which they do. Both estimates have no bias of their own, and the reference's noise (a standard
deviation of {:.3g}) is not in them; the square of a small bias may then come out below 0. &plusmn;: its standard error,
rather too large. A bias whose square is less than two of these from 0 is not told from none.</p>
)";

constexpr const char* k_nearer_begin = R"(<h2>Which method is nearer to the reference</h2>
<p>Of the two pictures in equal time, pixel by pixel, by the sum of squared differences of R, G and B. {}hybrid,
{}Monte Carlo, {}both as near. Single pixels are chance; areas are not.</p>
)";

constexpr const char* k_rows_begin = R"(<h2>All measurements</h2>
<p>The table tradeoff.csv; its columns are explained in docs/command_line.md.</p>
<details><summary>show</summary>
)";

std::string number(double v) { return fmt::format("{:.6g}", v); }
std::string seconds(double v) { return fmt::format("{:.3g} s", v); }

std::string tolerance_of(const TradeoffRow& row) {
  return fmt::format("{:g}", row.options.tolerance.value_or(row.cold.tolerance));
}

std::string name_of(const TradeoffRow& row) {
  const std::string method = is_hybrid(row.options) ? "hybrid" : "Monte Carlo";
  if (row.ladder == Ladder::target) return fmt::format("{}, to an error of {:g}", method, row.options.target_error);
  if (row.ladder == Ladder::time) return fmt::format("{}, in {}", method, seconds(row.options.time_limit));
  const std::string samples = fmt::format("{}, {} samples", method, row.cold.spp);
  return is_hybrid(row.options) ? samples + ", tolerance " + tolerance_of(row) : samples;
}

const char* word(TimeAtError::Relation relation) {
  return relation == TimeAtError::Relation::more_than   ? "more than "
         : relation == TimeAtError::Relation::less_than ? "less than "
                                                        : "";
}

std::string time_text(const TimeAtError& time) {
  return std::isfinite(time.seconds) ? word(time.relation) + seconds(time.seconds) : "unknown";
}

// Monte Carlo's time over the row's.
std::string times_text(const TimeAtError& monte_carlo, double own) {
  const double times = monte_carlo.seconds / own;
  return std::isfinite(times) ? fmt::format("{}{:.2f}", word(monte_carlo.relation), times) : "unknown";
}

std::string frames_text(const FramesToPay& frames) {
  switch (frames.relation) {
    case FramesToPay::Relation::equals:
      return fmt::format("{:.0f}", frames.frames);
    case FramesToPay::Relation::at_most:
      return fmt::format("{:.0f} at most", frames.frames);
    case FramesToPay::Relation::at_least:
      return fmt::format("{:.0f} at least", frames.frames);
    case FramesToPay::Relation::never:
      return "never";
    case FramesToPay::Relation::unknown:
      break;
  }
  return "unknown";
}

std::string begin(const TradeoffReport& report) {
  const Stats s = report.rows.empty() ? Stats{} : report.rows.front().cold;
  return fmt::format(k_begin, html_text(report.scene), s.width, s.height, s.triangles, s.instances, s.lights,
                     html_text(report.machine), s.threads, html_text(s.isa), html_text(report.version),
                     html_text(report.command), report.reference_spp);
}

// The ideal of independent samples: the error falls with the square root of the time.
PlotSeries ideal_slope(const std::vector<std::pair<double, double>>& points) {
  PlotSeries guide{"ideal slope, -1/2", {}, true, true};
  if (points.empty()) return guide;
  constexpr double k_far = 1e4;
  const auto [x, y] = points.back();
  guide.points = {{x / (k_far * k_far), y * k_far}, {x * k_far * k_far, y / k_far}};
  return guide;
}

Plot error_against_time(const TradeoffReport& report, bool cold) {
  Plot plot{cold ? "Error against time, cold" : "Error against time, warm", "seconds", "rmse", true, true, {}};
  std::map<std::string, size_t> place;
  for (const TradeoffRow& row : report.rows) {
    if (row.ladder != Ladder::samples && row.ladder != Ladder::target) continue;
    std::string label = is_hybrid(row.options) ? "hybrid" : "Monte Carlo";
    if (row.ladder == Ladder::target)
      label += ", to an error";
    else if (is_hybrid(row.options))
      label += ", tolerance " + tolerance_of(row);
    const auto [at, is_new] = place.emplace(label, plot.series.size());
    if (is_new) plot.series.push_back({label, {}, row.ladder == Ladder::target});
    plot.series[at->second].points.emplace_back(cold ? row.seconds_cold : row.seconds_warm, row.difference.rmse);
  }
  plot.series.push_back(plot.series.empty() ? ideal_slope({}) : ideal_slope(plot.series.front().points));
  return plot;
}

std::string time_section(const TradeoffReport& report) {
  std::string html = k_time_begin;
  html += svg_plot(error_against_time(report, true)) + svg_plot(error_against_time(report, false));
  html += k_equal_begin;
  Rows rows;
  for (const TradeoffRow& row : report.rows) {
    const bool is_usual = row.options.base_tolerance() == k_default_tolerance || row.ladder == Ladder::target;
    if (!is_hybrid(row.options) || !is_usual) continue;
    if (row.ladder != Ladder::samples && row.ladder != Ladder::target) continue;
    const TimeAtError time = seconds_at_error(monte_carlo_points(report.rows, row.ladder), row.difference.rmse);
    rows.push_back({html_text(name_of(row)), number(row.difference.rmse), seconds(row.cold.time_bake),
                    seconds(row.seconds_cold), seconds(row.seconds_warm), time_text(time),
                    times_text(time, row.seconds_cold), times_text(time, row.seconds_warm),
                    row.cold.bake_rays == 0 ? "nothing baked"
                                            : frames_text(frames_to_pay(row.seconds_cold, row.seconds_warm, time))});
  }
  return html + html_table({"hybrid", "error", "bake", "cold", "warm", "Monte Carlo", "times as fast, cold",
                            "times as fast, warm", "bake has paid from frame"},
                           rows);
}

std::string target_section(const TradeoffReport& report) {
  std::string html = k_target_begin;
  Rows rows;
  for (const TradeoffRow& row : report.rows) {
    if (row.ladder != Ladder::target) continue;
    rows.push_back({is_hybrid(row.options) ? "hybrid" : "Monte Carlo", number(row.options.target_error),
                    number(row.cold.error_estimate), number(row.difference.rmse), fmt::format("{}", row.cold.spp),
                    seconds(row.seconds_cold), seconds(row.seconds_warm)});
  }
  return html + html_table({"method", "target", "its estimate", "error", "samples a pixel", "cold", "warm"}, rows);
}

std::string memory_section(const TradeoffReport& report) {
  Plot plot{"Error against memory", "MB of fields (10^6 bytes)", "rmse", true, true, {}};
  std::map<int, size_t> place;
  Rows rows;
  for (const TradeoffRow& row : report.rows) {
    if (row.ladder != Ladder::resolution) continue;
    const Stats& s = row.cold;
    const auto [at, is_new] = place.emplace(s.field_directions, plot.series.size());
    if (is_new) plot.series.push_back({fmt::format("{0} x {0} directions", s.field_directions), {}});
    const double mb = double(s.field_bytes_memory) * k_mb;
    plot.series[at->second].points.emplace_back(mb, row.difference.rmse);
    rows.push_back({fmt::format("{}", s.field_directions), fmt::format("{}", s.field_plane), fmt::format("{:.2f}", mb),
                    fmt::format("{:.2f}", double(s.field_bytes_disk) * k_mb), seconds(s.time_bake),
                    seconds(row.seconds_cold), seconds(row.seconds_warm), number(row.difference.rmse)});
  }
  return k_memory_begin + svg_plot(plot) +
         html_table({"D", "N", "MB in memory", "MB on disk", "bake", "cold", "warm", "error"}, rows, 0);
}

std::string parts_section(const TradeoffReport& report) {
  if (report.parts.empty()) return "";
  const double noise = std::sqrt(report.parts.front().parts.reference_variance);
  std::string html = fmt::format(k_parts_begin, report.parts.front().seeds, noise);
  Rows rows;
  for (const TradeoffParts& p : report.parts) {
    const ErrorParts& e = p.parts;
    const bool hybrid = is_hybrid(p.options), has_error = !std::isnan(e.bias_square_error);
    std::string bias = "not known";
    if (e.bias_square > 2.0 * e.bias_square_error) {
      bias = fmt::format("{:.3g}", std::sqrt(e.bias_square));
    } else if (has_error) {
      const double most = std::sqrt(std::max(e.bias_square, 0.0) + 2.0 * e.bias_square_error);
      bias = fmt::format("less than {:.2g}", most);
    }
    rows.push_back({hybrid ? "hybrid" : "Monte Carlo", hybrid ? fmt::format("{:g}", p.options.base_tolerance()) : "",
                    fmt::format("{}", p.options.spp), number(e.mean_square), number(e.bias_square),
                    has_error ? fmt::format("{:.2g}", e.bias_square_error) : "", number(e.variance), bias,
                    fmt::format("{:.3g}", std::sqrt(std::max(e.variance, 0.0)))});
  }
  return html + html_table({"method", "tolerance", "samples a pixel", "mean squared error", "bias<sup>2</sup>",
                            "&plusmn;", "variance", "bias", "standard deviation"},
                           rows);
}

std::string pair_facts(const TradeoffReport& report, const TradeoffReport::Pair& pair) {
  std::string html;
  for (const int i : {pair.monte_carlo, pair.hybrid}) {
    const TradeoffRow& row = report.rows[size_t(i)];
    html += fmt::format("<p>{}: error {}, {} samples a pixel, {} cold", html_text(name_of(row)),
                        number(row.difference.rmse), row.cold.spp, seconds(row.seconds_cold));
    if (is_hybrid(row.options) && row.ladder != Ladder::time)
      html += fmt::format(", {} warm", seconds(row.seconds_warm));
    html += fmt::format(", FLIP {:.4f}, HDR-FLIP {:.4f}.</p>\n", row.flip, row.hdr_flip);
  }
  return html;
}

std::string pair_section(const TradeoffReport& report, const TradeoffReport::Pair& pair, const std::string& title,
                         const std::string& scratch_folder) {
  if (pair.monte_carlo < 0 || pair.hybrid < 0) return "";
  const auto compared = [&](int row, const Image& image) {
    return compare_picture(name_of(report.rows[size_t(row)]), image, report.reference);
  };
  return "<h2>" + title + "</h2>\n" + pair_facts(report, pair) +
         picture_figures({compared(pair.monte_carlo, pair.monte_carlo_image), compared(pair.hybrid, pair.hybrid_image)},
                         "reference", report.reference, scratch_folder);
}

std::string square(const Rgb& colour) {
  const Rgb c = 255.0f * colour;
  return fmt::format("<span style=\"color:#{:02x}{:02x}{:02x}\">&#9632;</span> ", int(c[0] + 0.5f), int(c[1] + 0.5f),
                     int(c[2] + 0.5f));
}

std::string nearer_section(const TradeoffReport& report, const std::string& scratch_folder) {
  const TradeoffReport::Pair& pair = report.equal_time;
  if (pair.monte_carlo < 0 || pair.hybrid < 0) return "";
  const NearerMap map = nearer_map(pair.hybrid_image, pair.monte_carlo_image, report.reference);
  const std::string shares =
      fmt::format("hybrid nearer at {:.1f} % of the pixels, Monte Carlo at {:.1f} %, both as near at {:.1f} %",
                  100.0 * map.first, 100.0 * map.second, 100.0 * map.both);
  return fmt::format(k_nearer_begin, square(nearer_first_colour()), square(nearer_second_colour()), square(Rgb(0.8f))) +
         "<div class=\"g\">" + html_figure(png_data_uri(map.picture, scratch_folder), shares) + "</div>\n";
}

std::string all_rows(const TradeoffReport& report) {
  const auto cells = [](const std::string& line) {
    std::vector<std::string> all;
    std::istringstream in(line + ",");
    for (std::string cell; std::getline(in, cell, ',');) all.push_back(html_text(cell));
    return all;
  };
  Rows rows;
  for (const std::string& line : report.lines) rows.push_back(cells(line));
  return k_rows_begin + html_table(cells(tradeoff_csv_header()), rows) + "</details>\n";
}

}  // namespace

void TradeoffReport::add(const TradeoffRow& row, const Image& image, size_t shown_target) {
  const bool hybrid = is_hybrid(row.options);
  const auto before = std::count_if(rows.begin(), rows.end(), [&](const TradeoffRow& r) {
    return r.ladder == Ladder::target && is_hybrid(r.options) == hybrid;
  });
  rows.push_back(row);
  lines.push_back(tradeoff_csv_row(row, monte_carlo_points(rows, row.ladder)));
  const auto keep = [&](Pair& pair) {
    (hybrid ? pair.hybrid : pair.monte_carlo) = int(rows.size()) - 1;
    (hybrid ? pair.hybrid_image : pair.monte_carlo_image) = image;
  };
  if (row.ladder == Ladder::time) keep(equal_time);
  if (row.ladder == Ladder::target && size_t(before) == shown_target) keep(equal_error);
}

std::string machine_text() {
  std::ifstream in("/proc/cpuinfo");
  std::string name = "an unnamed processor";
  for (std::string line; std::getline(in, line);) {
    const size_t colon = line.find(": ");
    if (line.rfind("model name", 0) == 0 && colon != std::string::npos) {
      name = line.substr(colon + 2);
      break;
    }
  }
  return fmt::format("{}, {} hardware threads", name, std::thread::hardware_concurrency());
}

std::string tradeoff_page(const TradeoffReport& report, const std::string& scratch_folder) {
  return html_page("Speed against accuracy: " + report.scene,
                   begin(report) + time_section(report) + target_section(report) + memory_section(report) +
                       parts_section(report) +
                       pair_section(report, report.equal_error, "Pictures at equal error", scratch_folder) +
                       pair_section(report, report.equal_time, "Pictures at equal time", scratch_folder) +
                       nearer_section(report, scratch_folder) + all_rows(report));
}

}  // namespace fieldtrace
