// The thesis' cases, tables, plots and page, from made-up measurements.
#include "tools/thesis/report.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <sstream>
#include <string>

#include "core/image/image.h"
#include "tools/report/embedded_picture.h"
#include "tools/report/plots.h"
#include "tools/thesis/claims.h"
#include "tools/thesis/picture.h"

namespace fieldtrace {
namespace {

size_t occurrences(const std::string& text, const std::string& part) {
  size_t count = 0;
  for (size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) ++count;
  return count;
}

ThesisReport made_up() {
  ThesisReport report;
  report.size = 512;
  for (const ThesisCase& c : thesis_cases("missing.obj")) {
    ThesisCaseResult r;
    r.name = c.scene.name;
    r.title = c.scene.title;
    r.triangles = c.scene.geometry.triangle_count();
    r.thesis_triangles = c.thesis_triangles;
    r.exact_ms = 50;
    r.description = c;
    r.reference_picture = "data:image/png;base64,AAAA";
    if (c.polished) r.polished_ms = 200;
    for (const int m : {32, 64, 128}) {
      ThesisRow row;
      row.m = m;
      row.rms = 640.0 / m;
      row.milliseconds = 20;
      if (c.polished) row.rms_polished = row.rms - 1;
      row.picture = row.difference_picture = "data:image/png;base64,AAAA";
      r.rows.push_back(row);
    }
    report.cases.push_back(r);
  }
  report.growth = {{16128, 64, 20, 50, 1}, {2000000, 64, 21, 90, 1}};
  report.charts = {{"Bunny", "behind", "thesis, M = 32", 4327424, -1, 0.05, 0.0, 1.0, 20.0},
                   {"Bunny", "behind", "orthographic, 32 x 64", 1000000, 0.1, 0.01, 0.05, 1.0, 10.0}};
  report.hybrid = {{"Bunny", "hybrid", 4, 0.1, 3.5, 100, 200, 1000}};
  return report;
}

TEST(ThesisCases, TrianglesAreThoseOfTheThesis) {
  const std::vector<ThesisCase> cases = thesis_cases("missing.obj");
  ASSERT_EQ(cases.size(), 8u);
  for (const ThesisCase& c : cases) {
    if (c.thesis_triangles) {
      EXPECT_EQ(c.scene.geometry.triangle_count(), c.thesis_triangles) << c.scene.name;
    }
    EXPECT_EQ(c.scene.materials.size(), c.scene.geometry.instances.size());
    // Shadow look-ups require lights outside every ball.
    for (const Instance& i : c.scene.geometry.instances) {
      const Sphere ball = thesis_ball(c.scene.geometry.shapes[i.shape].mesh);
      for (const PhongLight& light : c.scene.lights) {
        EXPECT_GT(glm::length(transform_point(i.to_object, light.position) - ball.centre), ball.radius) << c.scene.name;
      }
    }
  }
  EXPECT_EQ(cases[3].scene.lights.size(), 2u);
  EXPECT_EQ(cases[4].scene.lights.size(), 3u);
  EXPECT_EQ(cases[7].scene.lights.size(), 3u);
  EXPECT_NE(cases[2].scene.title.find("in place of the bunny"), std::string::npos);
  EXPECT_EQ(thesis_growing_scene(16128).geometry.triangle_count(), 16128u);
  EXPECT_GE(thesis_growing_scene(65536).geometry.triangle_count(), 65536u);
}

TEST(ThesisCases, ShapesOfOneNameAreOneMesh) {
  // Fields are shared between cases by the objects' names.
  std::map<std::string, size_t> triangles;
  for (const ThesisCase& c : thesis_cases()) {
    for (const Shape& s : c.scene.geometry.shapes) {
      const auto [at, fresh] = triangles.emplace(s.name, s.triangle_count());
      EXPECT_EQ(at->second, s.triangle_count()) << s.name;
    }
  }
}

TEST(ThesisReport, TablesHaveEveryCaseAndColumn) {
  const ThesisReport report = made_up();
  std::istringstream lines(thesis_csv(report));
  std::string line;
  std::getline(lines, line);
  const auto columns = std::count(line.begin(), line.end(), ',');
  size_t rows = 0;
  while (std::getline(lines, line)) {
    ++rows;
    EXPECT_EQ(std::count(line.begin(), line.end(), ','), columns) << line;
  }
  EXPECT_EQ(rows, 24u);
  // The thesis' figures appear in the rows that they belong to.
  const std::string csv = thesis_csv(report);
  for (const char* part : {"12.38,11.3", "25.82,21.88", "7.15,5.79,6.76,5.19,62,4024,5097,67324,92192"}) {
    EXPECT_NE(csv.find(part), std::string::npos) << part;
  }
  EXPECT_EQ(occurrences(thesis_growth_csv(report), "\n"), 3u);
  EXPECT_EQ(occurrences(thesis_hybrid_csv(report), "\n"), 2u);
  const std::string charts = thesis_charts_csv(report);
  EXPECT_NE(charts.find("\"Bunny\",behind,\"thesis, M = 32\",4327424,,0.05,0,1,20\n"), std::string::npos) << charts;
  EXPECT_NE(charts.find("\"orthographic, 32 x 64\",1000000,0.1,0.01,0.05,1,10\n"), std::string::npos) << charts;
}

TEST(ThesisReport, PageStandsAlone) {
  const ThesisReport report = made_up();
  const std::string page = thesis_page(report, "fieldtrace thesis -o \"a<b\"", "1");
  for (const ThesisCaseResult& c : report.cases) {
    EXPECT_NE(page.find("<h3 id=\"" + c.name + "\">"), std::string::npos) << c.name;
  }
  EXPECT_EQ(occurrences(page, "<img "), occurrences(page, "<img src=\"data:image/png;base64,"));
  EXPECT_EQ(occurrences(page, "<img "), 8u * 7u);
  EXPECT_EQ(occurrences(page, "<svg "), 4u);
  EXPECT_EQ(occurrences(page, "<svg "), occurrences(page, "</svg>"));
  EXPECT_EQ(occurrences(page, "http"), 0u);
  EXPECT_EQ(occurrences(page, "a<b"), 0u);
  EXPECT_EQ(occurrences(page, "nan"), 0u);
}

TEST(ThesisReport, PageOfAnInterruptedRunIsWhole) {
  ThesisReport report;
  EXPECT_NE(thesis_page(report, "c", "1").find("</html>"), std::string::npos);
  report = made_up();
  report.cases.resize(1);
  report.cases[0].rows.clear();
  report.growth.clear();
  report.charts.clear();
  report.hybrid.clear();
  EXPECT_TRUE(thesis_claims(report).empty());
  EXPECT_EQ(occurrences(thesis_page(report, "c", "1"), "nan"), 0u);
}

TEST(ThesisReport, ClaimsFollowTheMeasurements) {
  ThesisReport report = made_up();
  ASSERT_EQ(thesis_claims(report).size(), 4u);
  for (const ThesisClaim& c : thesis_claims(report)) EXPECT_TRUE(c.holds) << c.claim << c.measured;
  report.growth.back().field_ms = 200;
  for (ThesisRow& r : report.cases[3].rows) r.milliseconds = 40;
  report.cases[1].rows[2].rms = 100;
  for (ThesisRow& r : report.cases[6].rows) r.rms_polished = r.rms + 1;
  for (const ThesisClaim& c : thesis_claims(report)) EXPECT_FALSE(c.holds) << c.claim << c.measured;
}

TEST(ThesisReport, PlotsLeaveOutWhatTheyCannotShow) {
  const std::string svg =
      svg_plot({"A & B", "x", "y", true, true, {{"s", {{1, 2}, {10, 3}, {0, 1}, {5, -1}, {2, NAN}}}}});
  EXPECT_EQ(occurrences(svg, "<circle"), 2u);
  EXPECT_NE(svg.find("A &amp; B"), std::string::npos);
  EXPECT_EQ(occurrences(svg, "nan"), 0u);
  EXPECT_EQ(occurrences(svg_plot({"empty", "", "", true, false, {}}), "nan"), 0u);
}

TEST(ThesisPicture, DataUriHoldsThePicture) {
  PhongPicture p;
  p.size = 3;
  for (int i = 0; i < 9; ++i) p.pixels.push_back(Rgb(float(i) / 8.0f, 0.5f, 0.25f));
  const auto folder = std::filesystem::temp_directory_path() / ("fieldtrace_picture_" + std::to_string(getpid()));
  std::filesystem::create_directory(folder);
  const std::string uri = png_data_uri(to_image(p), folder.string());
  const std::string prefix = "data:image/png;base64,iVBORw0KGgo";  // PNG's signature
  EXPECT_EQ(uri.substr(0, prefix.size()), prefix);
  EXPECT_EQ((uri.size() - uri.find(',') - 1) % 4, 0u);
  EXPECT_TRUE(std::filesystem::is_empty(folder));
  std::filesystem::remove(folder);
}

}  // namespace
}  // namespace fieldtrace
