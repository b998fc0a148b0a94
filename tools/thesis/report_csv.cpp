#include <fmt/format.h>

#include "tools/thesis/report.h"

namespace fieldtrace {
namespace {

std::string known(double value) { return value >= 0 ? fmt::format("{:.6g}", value) : std::string(); }

}  // namespace

std::string thesis_csv(const ThesisReport& report) {
  std::string csv =
      "case,triangles,thesis_triangles,lights,m,rms,rms_blurred,rms_polished,rms_polished_blurred,field_ms,embree_ms,"
      "embree_polished_ms,bake_seconds,bytes_distance,bytes_normal,bytes_vdb,bytes_embree,thesis_rms,"
      "thesis_rms_blurred,thesis_rms_polished,thesis_rms_polished_blurred,thesis_field_ms,thesis_gpu_ms,thesis_cpu_ms,"
      "thesis_polished_gpu_ms,thesis_polished_cpu_ms\n";
  for (const ThesisCaseResult& c : report.cases) {
    const ThesisCase& d = c.description;
    for (const ThesisRow& r : c.rows) {
      const ThesisFigures f = figures_at(d.figures, r.m), p = figures_at(d.polished_figures, r.m);
      csv += fmt::format(
          "{},{},{},{},{},{:.6g},{:.6g},{},{},{:.6g},{:.6g},{},{:.6g},{},{},{},{},{},{},{},{},{},{},{},{},{}\n", c.name,
          c.triangles, c.thesis_triangles ? std::to_string(c.thesis_triangles) : "", c.lights, r.m, r.rms,
          r.rms_blurred, known(r.rms_polished), known(r.rms_polished_blurred), r.milliseconds, c.exact_ms,
          known(c.polished_ms), r.bake_seconds, r.bytes_distance, r.bytes_normal, r.bytes_vdb, c.exact_bytes,
          known(f.rms), known(f.rms_blurred), known(p.rms), known(p.rms_blurred), known(f.milliseconds),
          known(d.thesis_gpu_ms), known(d.thesis_cpu_ms), known(d.polished_gpu_ms), known(d.polished_cpu_ms));
    }
  }
  return csv;
}

std::string thesis_growth_csv(const ThesisReport& report) {
  std::string csv = "triangles,m,field_ms,embree_ms,bake_seconds\n";
  for (const ThesisGrowth& g : report.growth) {
    csv += fmt::format("{},{},{:.6g},{:.6g},{:.6g}\n", g.triangles, g.m, g.field_ms, g.exact_ms, g.bake_seconds);
  }
  return csv;
}

std::string thesis_charts_csv(const ThesisReport& report) {
  std::string csv = "object,shading_points,chart,bytes,tolerance,rmse,exact_share,look_ups_per_ray,ns_per_look_up\n";
  for (const ThesisChartRow& r : report.charts) {
    csv += fmt::format("\"{}\",{},\"{}\",{},{},{:.6g},{:.6g},{:.6g},{:.6g}\n", r.object, r.shading_points, r.chart,
                       r.bytes, known(r.tolerance), r.rmse, r.exact_share, r.look_ups_per_ray, r.ns_per_look_up);
  }
  return csv;
}

std::string thesis_hybrid_csv(const ThesisReport& report) {
  std::string csv = "scene,method,spp,tolerance,rms,cold_ms,warm_ms,bytes\n";
  for (const ThesisHybridRow& r : report.hybrid) {
    csv += fmt::format("\"{}\",{},{},{:.6g},{:.6g},{:.6g},{:.6g},{}\n", r.scene, r.method, r.spp, r.tolerance, r.rms,
                       r.cold_milliseconds, r.milliseconds, r.bytes);
  }
  return csv;
}

}  // namespace fieldtrace
