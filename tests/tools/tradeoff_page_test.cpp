// The page of a trade-off from made-up measurements, and the plots and maps on it.
#include "tools/report/tradeoff_page.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>

#include "tools/report/embedded_picture.h"
#include "tools/report/html.h"
#include "tools/report/plots.h"

namespace fieldtrace {
namespace {

namespace fs = std::filesystem;

size_t occurrences(const std::string& text, const std::string& part) {
  size_t count = 0;
  for (size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) ++count;
  return count;
}

Image filled(int width, int height, const Rgb& value) {
  Image image{width, height, {"R", "G", "B"}, {}};
  for (int i = 0; i < width * height; ++i) image.data.insert(image.data.end(), {value[0], value[1], value[2]});
  return image;
}

TradeoffRow row_of(Method method, Ladder ladder, double rmse, double cold, double warm) {
  TradeoffRow row;
  row.options.method = method;
  row.ladder = ladder;
  row.difference.rmse = rmse;
  row.seconds_cold = cold, row.seconds_warm = warm;
  row.cold.bake_rays = 1;
  if (ladder == Ladder::target) row.options.target_error = float(rmse);
  if (ladder == Ladder::time) row.options.time_limit = float(cold);
  if (ladder == Ladder::samples) row.options.tolerance = k_default_tolerance;
  return row;
}

class TradeoffPage : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("fieldtrace_tradeoff_page_" + std::to_string(getpid()));
    fs::remove_all(folder_);
    fs::create_directory(folder_);
    report_.scene = "a<b.xml", report_.machine = "a processor", report_.version = "1";
    report_.reference = filled(4, 3, Rgb(0.5f));
  }
  void TearDown() override {
    EXPECT_TRUE(fs::is_empty(folder_));
    fs::remove_all(folder_);
  }
  void add(const TradeoffRow& row) { report_.add(row, filled(4, 3, Rgb(0.25f)), 1); }
  std::string page() const { return tradeoff_page(report_, folder_.string()); }

  fs::path folder_;
  TradeoffReport report_;
};

TEST_F(TradeoffPage, SaysMoreThanWhereMonteCarloEnds) {
  add(row_of(Method::monte_carlo, Ladder::samples, 0.1, 1.0, 1.0));
  add(row_of(Method::monte_carlo, Ladder::samples, 0.05, 4.0, 4.0));
  add(row_of(Method::hybrid, Ladder::samples, 0.05, 3.0, 2.0));
  add(row_of(Method::hybrid, Ladder::samples, 0.01, 3.0, 2.0));
  add(row_of(Method::hybrid, Ladder::samples, 0.5, 0.5, 0.1));
  const std::string html = page();
  EXPECT_NE(html.find("<td>4 s</td><td>1.33</td><td>2.00</td><td>1</td>"), std::string::npos);
  EXPECT_NE(html.find("<td>more than 4 s</td><td>more than 1.33</td><td>more than 2.00</td><td>1 at most</td>"),
            std::string::npos);
  EXPECT_NE(html.find("<td>less than 1 s</td><td>less than 2.00</td><td>less than 10.00</td><td>1 at least</td>"),
            std::string::npos);
  // Marks are those of measured points alone: in two plots five each.
  EXPECT_EQ(occurrences(html, "<circle"), 10u);
  EXPECT_EQ(occurrences(html, "a<b.xml"), 0u);
}

TEST_F(TradeoffPage, SaysWhereNothingWasBaked) {
  add(row_of(Method::monte_carlo, Ladder::samples, 0.1, 1.0, 1.0));
  TradeoffRow row = row_of(Method::hybrid, Ladder::samples, 0.1, 0.9, 0.9);
  row.cold.bake_rays = 0;
  add(row);
  EXPECT_EQ(occurrences(page(), "<td>nothing baked</td>"), 1u);
  EXPECT_NE(report_.lines.back().find(",,,equals,1"), std::string::npos) << report_.lines.back();
}

TEST_F(TradeoffPage, ShowsPairsOfWhatWasMeasured) {
  for (const Method method : {Method::monte_carlo, Method::hybrid}) {
    for (const double target : {0.04, 0.02, 0.01}) add(row_of(method, Ladder::target, target, 1.0, 0.5));
  }
  EXPECT_EQ(report_.equal_error.monte_carlo, 1);  // the second of each
  EXPECT_EQ(report_.equal_error.hybrid, 4);
  EXPECT_EQ(occurrences(page(), "<img "), 9u);
  add(row_of(Method::monte_carlo, Ladder::time, 0.02, 1.0, 1.0));
  EXPECT_EQ(occurrences(page(), "<img "), 9u) << "one alone is no pair";
  add(row_of(Method::hybrid, Ladder::time, 0.02, 1.0, 1.0));
  EXPECT_EQ(occurrences(page(), "<img "), 19u);
}

TEST_F(TradeoffPage, SaysWhereBiasIsNotToldFromNone) {
  TradeoffParts parts;
  parts.seeds = 3;
  parts.parts.variance = 1e-4;
  parts.parts.bias_square = 4e-4, parts.parts.bias_square_error = 1e-5;
  report_.parts.push_back(parts);
  parts.parts.bias_square = -1e-6;
  report_.parts.push_back(parts);
  parts.parts.bias_square = 1e-5;
  report_.parts.push_back(parts);
  const std::string html = page();
  EXPECT_EQ(occurrences(html, "<td>0.02</td><td>0.01</td>"), 1u);
  EXPECT_EQ(occurrences(html, "<td>less than 0.0045</td><td>0.01</td>"), 1u);
  EXPECT_EQ(occurrences(html, "<td>less than 0.0055</td><td>0.01</td>"), 1u);
}

TEST_F(TradeoffPage, OfNothingIsWhole) {
  const std::string html = page();
  EXPECT_NE(html.find("</html>"), std::string::npos);
  EXPECT_EQ(occurrences(html, "nan"), 0u);
}

TEST(Plots, GuidesHaveNoMarksAndDoNotMoveTheAxes) {
  Plot plot{"t", "x", "y", true, true, {{"s", {{1, 2}, {10, 3}}}}};
  const std::string before = svg_plot(plot);
  plot.series.push_back({"ideal", {{1e-9, 1e9}, {1e9, 1e-9}}, true, true});
  const std::string after = svg_plot(plot);
  EXPECT_EQ(occurrences(after, "<circle"), 2u);
  EXPECT_EQ(occurrences(after, "clip-path"), 1u);
  EXPECT_EQ(occurrences(before, "clip-path"), 0u);
  // The measured line lies where it lay.
  const size_t line = before.find("<polyline points="), end = before.find('>', line);
  EXPECT_NE(after.find(before.substr(line, end - line)), std::string::npos);
}

TEST(Plots, NarrowLogarithmicAxesHaveTicks) {
  const std::string svg = svg_plot({"t", "x", "y", true, true, {{"s", {{3, 0.0061}, {3.3, 0.0062}}}}});
  EXPECT_GE(occurrences(svg, "text-anchor=\"end\""), 2u);
}

TEST(ErrorColours, GetLighterWithTheError) {
  float last = -1.0f;
  for (int i = 0; i <= 100; ++i) {
    const Rgb c = error_colour(float(i) / 100.0f);
    const float grey = 0.2126f * srgb_decode(c[0]) + 0.7152f * srgb_decode(c[1]) + 0.0722f * srgb_decode(c[2]);
    EXPECT_GT(grey, last) << i;
    last = grey;
  }
  EXPECT_EQ(error_colour(-1.0f), error_colour(0.0f));
  EXPECT_EQ(error_colour(2.0f), error_colour(1.0f));
}

TEST(DifferenceGain, BringsDifferencesIntoView) {
  const Image zero = filled(10, 10, Rgb(0.0f));
  for (const double d : {0.3, 0.01, 0.004, 1e-5}) {
    const Image image = filled(10, 10, Rgb(float(d)));
    const double gain = difference_gain({&image}, zero);
    EXPECT_LE(gain * d, 1.0 + 1e-6) << d;
    EXPECT_GT(gain * d, 0.5 - 1e-6) << d;
    EXPECT_EQ(gain, std::exp2(std::round(std::log2(gain)))) << d;
  }
  for (const double d : {0.0, 5.0, 1e-9}) {
    const Image image = filled(10, 10, Rgb(float(d)));
    EXPECT_EQ(difference_gain({&image}, zero), 1.0) << d;
  }
}

TEST(NearerMap, CountsEachPixelOnce) {
  Image first = filled(10, 1, Rgb(0.5f)), second = first;
  const Image reference = first;
  for (int x = 0; x < 3; ++x) second.pixel(x, 0)[1] += 0.1f;             // the first is nearer
  for (int x = 3; x < 8; ++x) first.pixel(x, 0)[size_t(x % 3)] -= 0.2f;  // the second is
  const NearerMap map = nearer_map(first, second, reference);
  EXPECT_DOUBLE_EQ(map.first, 0.3);
  EXPECT_DOUBLE_EQ(map.second, 0.5);
  EXPECT_DOUBLE_EQ(map.both, 0.2);
  for (int c = 0; c < 3; ++c) {
    EXPECT_NEAR(srgb_encode(map.picture.pixel(0, 0)[c]), nearer_first_colour()[c], 1e-5);
    EXPECT_NEAR(srgb_encode(map.picture.pixel(5, 0)[c]), nearer_second_colour()[c], 1e-5);
  }
}

TEST(Html, TextIsEscaped) {
  EXPECT_EQ(html_text("a<b & \"c\">"), "a&lt;b &amp; &quot;c&quot;&gt;");
  EXPECT_EQ(occurrences(html_page("<t>", ""), "<t>"), 0u);
  EXPECT_EQ(occurrences(html_figure("data:", "a\"b"), "a\"b"), 0u);
}

}  // namespace
}  // namespace fieldtrace
