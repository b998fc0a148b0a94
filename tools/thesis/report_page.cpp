#include <fmt/format.h>

#include "tools/report/html.h"
#include "tools/report/plots.h"
#include "tools/thesis/claims.h"
#include "tools/thesis/report.h"

namespace fieldtrace {
namespace {

constexpr double k_mb = 1.0 / (1024.0 * 1024.0);

constexpr const char* k_style = "img{width:270px;height:270px;image-rendering:auto;background:#000}\n";

constexpr const char* k_page_begin = R"(<h1>The thesis' section 4 on today's machine</h1>
<p>A. Andreadis, <i>Ray Tracing Acceleration using Displacement Fields on GPU</i>, MSc thesis, Athens University of
Economics and Business, 2008: its chart, its field and its pipeline, rebuilt, beside exact rays by Embree. What was
changed and why: docs/thesis.md.</p>
<p>{} x {} pixels, {} threads, {}, version {}{}. Made by <code>{}</code></p>
)";

constexpr const char* k_main_begin = R"(<h2>Test cases</h2>
<p>Grey in brackets: the thesis' own figures, of its views, lights and 2008's GPU. RMS on 0 ... 255 against exact rays,
plain and with the field's picture blurred (5 x 5 Gaussian, 1 pixel). ms: least of several, one picture, baking not
counted. MB: 2<sup>20</sup> bytes, all objects of the case.</p>
<table><tr><th class="l">case</th><th>triangles</th><th>lights</th><th>M</th><th>RMS</th><th>blurred</th>
<th>RMS, polished</th><th>blurred</th><th>fields ms</th><th>Embree ms</th><th>Embree, polished ms</th><th>bake s</th>
<th>distances MB</th><th>normals MB</th><th>OpenVDB MB</th></tr>
)";

constexpr const char* k_main_end = R"(</table>
<p>Exact rays of reflection scene 2 on the thesis' CPU: 5,097 ms, polished 92,192 ms. Its memory of one object:
4.16 + 12.38, 16.05 + 49.5 and 66 + 198 MB for M = 32, 64, 128; 4,226 M<sup>2</sup> samples are 4.13 + 12.38,
16.51 + 49.52 and 66.03 + 198.09.</p>
)";

constexpr const char* k_charts_begin = R"(<h2>Both charts at no more bytes</h2>
<p>Visibility of a light of 7 degrees past one object, 64 rays a shading point, against Embree's answers to the same rays:
RMSE of the share that arrives, in [0, 1]. Shading points lie behind the object or on it. Bytes are those of a complete field,
of what these rays read: distances alone by the thesis' chart; by the orthographic one visibility cells, and depth cells
where shading points lie on the object. The orthographic field is the finest of N = D or 2 D that takes no more bytes; where there is
none, the coarsest takes more. Exact: the share of the rays meeting the object's ball that is left to exact rays; at tolerance 1
no ray is. ns: one thread, the instruction set above.</p>
<table><tr><th class="l">object</th><th class="l">shading points</th><th class="l">chart</th><th>MB</th><th>tolerance</th>
<th>RMSE</th><th>exact</th><th>look-ups a ray</th><th>ns a look-up</th></tr>
)";

constexpr const char* k_hybrid_begin = R"(<h2>The same geometry by this program's renderers</h2>
<p>Diffuse surfaces, point lights that fall off, direct light; RMS on 0 ... 255 against Monte Carlo with many samples a
pixel, so within this table only. ms: whole renders, the building of Embree's structures included; warm: with the field
cache that the cold render left.</p>
<table><tr><th class="l">scene</th><th class="l">method</th><th>samples a pixel</th><th>tolerance</th><th>RMS</th>
<th>cold ms</th><th>warm ms</th><th>fields MB</th></tr>
)";

// Our figure, followed by the thesis' in grey.
std::string beside(double ours, double thesis, const char* format) {
  if (ours < 0) return "";
  std::string text = fmt::format(fmt::runtime(format), ours);
  if (thesis >= 0) text += fmt::format(" <span class=\"t\">({:g})</span>", thesis);
  return text;
}

std::string claims_table(const ThesisReport& report) {
  std::string html =
      "<h2>Claims</h2>\n<table><tr><th class=\"l\">thesis</th><th class=\"l\">here</th><th>holds</th></tr>\n";
  for (const ThesisClaim& c : thesis_claims(report)) {
    html += fmt::format("<tr><td class=\"l\">{}</td><td class=\"l\">{}</td><td>{}</td></tr>\n", html_text(c.claim),
                        html_text(c.measured), c.holds ? "yes" : "no");
  }
  return html + "</table>\n";
}

std::string main_table(const ThesisReport& report) {
  std::string html = k_main_begin;
  for (const ThesisCaseResult& c : report.cases) {
    const ThesisCase& d = c.description;
    for (const ThesisRow& r : c.rows) {
      const ThesisFigures f = figures_at(d.figures, r.m), p = figures_at(d.polished_figures, r.m);
      html += fmt::format(
          "<tr><td class=\"l\">{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td>"
          "<td>{}</td><td>{}</td><td>{}</td><td>{:.1f}</td><td>{:.2f}</td><td>{:.2f}</td><td>{:.2f}</td></tr>\n",
          html_text(c.title), c.triangles, c.lights, r.m, beside(r.rms, f.rms, "{:.2f}"),
          beside(r.rms_blurred, f.rms_blurred, "{:.2f}"), beside(r.rms_polished, p.rms, "{:.2f}"),
          beside(r.rms_polished_blurred, p.rms_blurred, "{:.2f}"), beside(r.milliseconds, f.milliseconds, "{:.1f}"),
          beside(c.exact_ms, d.thesis_gpu_ms, "{:.1f}"), beside(c.polished_ms, d.polished_gpu_ms, "{:.1f}"),
          r.bake_seconds, double(r.bytes_distance) * k_mb, double(r.bytes_normal) * k_mb, double(r.bytes_vdb) * k_mb);
    }
  }
  return html + k_main_end;
}

std::string charts_table(const ThesisReport& report) {
  if (report.charts.empty()) return "";
  std::string html = k_charts_begin;
  for (const ThesisChartRow& r : report.charts) {
    html += fmt::format(
        "<tr><td class=\"l\">{}</td><td class=\"l\">{}</td><td class=\"l\">{}</td><td>{:.2f}</td><td>{}</td>"
        "<td>{:.4f}</td><td>{:.1f} %</td><td>{:.2f}</td><td>{:.1f}</td></tr>\n",
        html_text(r.object), r.shading_points, r.chart, double(r.bytes) * k_mb,
        r.tolerance >= 0 ? fmt::format("{:g}", r.tolerance) : "", r.rmse, 100.0 * r.exact_share, r.look_ups_per_ray,
        r.ns_per_look_up);
  }
  return html + "</table>\n";
}

std::string hybrid_table(const ThesisReport& report) {
  if (report.hybrid.empty()) return "";
  std::string html = k_hybrid_begin;
  for (const ThesisHybridRow& r : report.hybrid) {
    const bool fields = r.method == "hybrid";
    html += fmt::format(
        "<tr><td class=\"l\">{}</td><td class=\"l\">{}</td><td>{}</td><td>{}</td><td>{:.2f}</td><td>{:.0f}</td>"
        "<td>{:.0f}</td><td>{}</td></tr>\n",
        html_text(r.scene), r.method, r.spp, fields ? fmt::format("{:g}", r.tolerance) : "", r.rms, r.cold_milliseconds,
        r.milliseconds, fields ? fmt::format("{:.1f}", double(r.bytes) * k_mb) : "");
  }
  return html + "</table>\n";
}

std::string growth_table(const ThesisReport& report) {
  std::string html =
      "<table><tr><th>triangles</th><th>M</th><th>fields ms</th><th>Embree ms</th><th>bake s</th></tr>\n";
  for (const ThesisGrowth& g : report.growth) {
    html += fmt::format("<tr><td>{}</td><td>{}</td><td>{:.1f}</td><td>{:.1f}</td><td>{:.1f}</td></tr>\n", g.triangles,
                        g.m, g.field_ms, g.exact_ms, g.bake_seconds);
  }
  return html + "</table>\n";
}

std::string plots(const ThesisReport& report) {
  Plot error{"Error against the directions", "M", "RMS, 0 ... 255", true, false, {}};
  Plot memory{"Error against memory", "MB of distances and normals", "RMS, 0 ... 255", true, false, {}};
  for (const ThesisCaseResult& c : report.cases) {
    PlotSeries by_m{c.title, {}}, by_memory{c.title, {}};
    for (const ThesisRow& r : c.rows) {
      by_m.points.emplace_back(r.m, r.rms);
      by_memory.points.emplace_back(double(r.bytes_distance + r.bytes_normal) * k_mb, r.rms);
    }
    error.series.push_back(by_m);
    memory.series.push_back(by_memory);
  }
  for (const ThesisCaseResult& c : report.cases) {
    PlotSeries thesis{c.title + ", thesis", {}, true};
    for (const ThesisFigures& f : c.description.figures) thesis.points.emplace_back(f.m, f.rms);
    if (!thesis.points.empty()) error.series.push_back(thesis);
  }
  Plot time{"Time against triangles", "triangles", "milliseconds", true, false, {{"fields", {}}, {"Embree", {}}}};
  for (const ThesisGrowth& g : report.growth) {
    time.series[0].points.emplace_back(double(g.triangles), g.field_ms);
    time.series[1].points.emplace_back(double(g.triangles), g.exact_ms);
  }
  Plot renderers{"This program's renderers", "milliseconds, warm", "RMS, 0 ... 255", true, true, {}};
  for (const ThesisHybridRow& r : report.hybrid) {
    const std::string label = r.scene + ", " + r.method;
    if (renderers.series.empty() || renderers.series.back().label != label)
      renderers.series.push_back({label, {}, r.method == "hybrid"});
    renderers.series.back().points.emplace_back(r.milliseconds, r.rms);
  }
  std::string html = "<h2>Plots</h2>\n" + svg_plot(error) + svg_plot(memory) + svg_plot(time);
  if (!report.hybrid.empty()) html += svg_plot(renderers);
  return html + growth_table(report);
}

std::string pictures(const ThesisReport& report) {
  std::string html = "<h2>Pictures</h2>\n<p>Differences are shown four times as strong.</p>\n";
  for (const ThesisCaseResult& c : report.cases) {
    html += fmt::format("<h3 id=\"{}\">{}</h3>\n", c.name, html_text(c.title));
    html += html_figure(c.reference_picture, "exact rays");
    html += html_figure(c.polished_picture, "exact rays, polished");
    for (const ThesisRow& r : c.rows)
      html += html_figure(r.picture, fmt::format("fields, M = {}, RMS {:.2f}", r.m, r.rms));
    html += "<br>\n";
    for (const ThesisRow& r : c.rows) html += html_figure(r.difference_picture, fmt::format("difference, M = {}", r.m));
  }
  return html;
}

}  // namespace

std::string thesis_page(const ThesisReport& report, const std::string& command, const std::string& version) {
  std::string html = fmt::format(k_page_begin, report.size, report.size, report.threads, report.isa, version,
                                 report.quick ? ", quick" : "", html_text(command));
  html += claims_table(report) + main_table(report) + charts_table(report) + hybrid_table(report) + plots(report) +
          pictures(report);
  return html_page("Displacement fields of 2008, today", html, k_style);
}

}  // namespace fieldtrace
