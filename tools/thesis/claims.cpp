#include "tools/thesis/claims.h"

#include <fmt/format.h>

#include <algorithm>

namespace fieldtrace {
namespace {

// Times within this factor count as equal: repeated renders on a busy machine differ by less.
constexpr double k_same_time = 1.3;

const ThesisCaseResult* find_case(const ThesisReport& report, const std::string& name) {
  for (const ThesisCaseResult& c : report.cases) {
    if (c.name == name) return &c;
  }
  return nullptr;
}

// The row at M = 64, which the thesis examines most closely, or else the last.
const ThesisRow* usual_row(const ThesisCaseResult* c) {
  if (!c || c->rows.empty()) return nullptr;
  for (const ThesisRow& r : c->rows) {
    if (r.m == 64) return &r;
  }
  return &c->rows.back();
}

}  // namespace

std::vector<ThesisClaim> thesis_claims(const ThesisReport& report) {
  std::vector<ThesisClaim> claims;
  if (report.growth.size() >= 2) {
    const ThesisGrowth &a = report.growth.front(), &b = report.growth.back();
    claims.push_back({"The time does not depend on the number of triangles.",
                      fmt::format("{} to {} triangles (M = {}): {:.1f} ms to {:.1f} ms by fields, a factor of {:.2f}; "
                                  "Embree {:.1f} ms to {:.1f} ms, a factor of {:.2f}.",
                                  a.triangles, b.triangles, a.m, a.field_ms, b.field_ms, b.field_ms / a.field_ms,
                                  a.exact_ms, b.exact_ms, b.exact_ms / a.exact_ms),
                      b.field_ms < k_same_time * a.field_ms});
  }
  const ThesisCaseResult *one = find_case(report, "bunny"), *two = find_case(report, "bunny_two_lights");
  if (usual_row(one) && usual_row(two)) {
    const double a = usual_row(one)->milliseconds, b = usual_row(two)->milliseconds;
    claims.push_back({"A second light is nearly free.",
                      fmt::format("Bunny, one to two lights (M = {}): {:.1f} ms to {:.1f} ms by fields ({:+.0f} %); "
                                  "Embree {:.1f} ms to {:.1f} ms ({:+.0f} %).",
                                  usual_row(one)->m, a, b, 100.0 * (b / a - 1.0), one->exact_ms, two->exact_ms,
                                  100.0 * (two->exact_ms / one->exact_ms - 1.0)),
                      b < k_same_time * a});
  }
  size_t compared = 0, better = 0;
  for (const ThesisCaseResult& c : report.cases) {
    for (size_t i = 1; i < c.rows.size(); ++i) {
      ++compared;
      better += c.rows[i].rms < c.rows[i - 1].rms;
    }
  }
  if (compared > 0) {
    claims.push_back({"A finer M is better.",
                      fmt::format("The RMS falls in {} of {} steps from one M to twice that.", better, compared),
                      better == compared});
  }
  const ThesisCaseResult* mirrors = find_case(report, "reflection_2");
  if (usual_row(mirrors)) {
    const ThesisRow& r = *usual_row(mirrors);
    claims.push_back(
        {"Polished reflection comes at no extra cost.",
         fmt::format("The one picture by fields (M = {}, {:.1f} ms) differs from mirrors by {:.2f} and from polished "
                     "reflection by {:.2f}; by Embree mirrors take {:.1f} ms and polish {:.1f} ms.",
                     r.m, r.milliseconds, r.rms, r.rms_polished, mirrors->exact_ms, mirrors->polished_ms),
         r.rms_polished <= r.rms});
  }
  return claims;
}

}  // namespace fieldtrace
