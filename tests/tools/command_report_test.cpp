// The pages that `compare --report` and `tradeoff` write: whole, alone, and in agreement with what is printed.
#include <cmath>
#include <nlohmann/json.hpp>

#include "core/image/image.h"
#include "tests/support/browser.h"
#include "tests/support/command_files.h"

namespace fieldtrace::test {
namespace {

namespace fs = std::filesystem;

size_t occurrences(const std::string& text, const std::string& part) {
  size_t count = 0;
  for (size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) ++count;
  return count;
}

// A page that refers to nothing outside itself, runs nothing and ends.
void expect_alone(const std::string& page) {
  EXPECT_EQ(page.rfind("<!DOCTYPE html>", 0), 0u);
  EXPECT_NE(page.find("</body></html>"), std::string::npos);
  EXPECT_GT(occurrences(page, "<img "), 0u);
  EXPECT_EQ(occurrences(page, "src="), occurrences(page, "<img src=\"data:image/png;base64,iVBORw0KGgo"));
  for (const char* part : {"http", "href=", "<script", "<link", "<iframe", "@import", "url(http", "nan", "inf,"}) {
    // Base64 may hold any letters, but none of these parts with their punctuation; the words are looked for outside.
    std::string outside;
    for (size_t at = 0; at < page.size();) {
      const size_t data = page.find("base64,", at);
      outside += page.substr(at, data == std::string::npos ? data : data - at);
      at = data == std::string::npos ? page.size() : page.find('"', data);
    }
    EXPECT_EQ(outside.find(part), std::string::npos) << part;
  }
}

// The text of the cell that ends the table's row which begins with `name`.
std::string last_cell(const std::string& page, const std::string& name) {
  const size_t row = page.find("<tr><td class=\"l\">" + name + "</td>");
  if (row == std::string::npos) return "no row";
  const size_t end = page.find("</td></tr>", row), begin = page.rfind("<td>", end) + 4;
  return page.substr(begin, end - begin);
}

class CommandReport : public CommandFiles {
 protected:
  void SetUp() override {
    CommandFiles::SetUp();
    ASSERT_EQ(run({"render", "scene.xml", "-o", "a.exr", "--method", "montecarlo", "--quiet"}).code, 0);
    ASSERT_EQ(run({"render", "scene.xml", "-o", "b.exr", "--method", "montecarlo", "--quiet", "--seed", "5"}).code, 0);
  }
};

TEST_F(CommandReport, ThePageOfACompareSaysWhatIsPrinted) {
  for (const std::vector<std::string>& crop : {std::vector<std::string>{}, {"--crop", "3,5,20,9"}}) {
    std::vector<std::string> arguments = {"compare", "a.exr", "b.exr", "--json", "--report", "page.html"};
    arguments.insert(arguments.end(), crop.begin(), crop.end());
    const Outcome o = run(arguments);
    ASSERT_EQ(o.code, 0) << o.err;
    const auto j = nlohmann::json::parse(o.out);
    const std::string page = read_text(folder_ / "page.html");
    expect_alone(page);
    EXPECT_EQ(occurrences(page, "<img "), 5u);  // both, their difference, FLIP and HDR-FLIP
    for (const auto& [name, key] : std::map<std::string, std::string>{{"rmse", "rmse"},
                                                                      {"relmse", "relmse"},
                                                                      {"mean relative", "mean_relative"},
                                                                      {"bias", "bias"},
                                                                      {"flip", "flip"},
                                                                      {"hdr flip", "hdr_flip"}}) {
      const double value = j[key];
      EXPECT_NEAR(std::stod(last_cell(page, name)), value, 1e-5 * std::abs(value)) << name;  // six digits
    }
    EXPECT_EQ(std::stod(last_cell(page, "worst block").substr(last_cell(page, "worst block").find("at ") + 3)),
              j["worst_block"]["x"]);
  }
  EXPECT_EQ(files(), (std::set<std::string>{"a.exr", "b.exr", "ball.ply", "page.html", "scene.xml"}));
}

std::vector<std::string> split(const std::string& line, char separator) {
  std::vector<std::string> parts;
  std::istringstream in(line + separator);
  for (std::string part; std::getline(in, part, separator);) parts.push_back(part);
  return parts;
}

using Table = std::vector<std::map<std::string, std::string>>;

// Rows of a table, by the names of its columns.
Table read_csv(const fs::path& path) {
  std::istringstream in(read_text(path));
  std::string line;
  std::getline(in, line);
  const std::vector<std::string> names = split(line, ',');
  Table rows;
  while (std::getline(in, line)) {
    const std::vector<std::string> values = split(line, ',');
    EXPECT_EQ(values.size(), names.size()) << line;
    rows.emplace_back();
    for (size_t i = 0; i < std::min(names.size(), values.size()); ++i) rows.back()[names[i]] = values[i];
  }
  return rows;
}

// The cells of all rows of the table behind a heading, without its head. Markup within cells stays.
std::vector<std::vector<std::string>> table_behind(const std::string& page, const std::string& heading) {
  std::vector<std::vector<std::string>> rows;
  const size_t begin = page.find("<h2>" + heading + "</h2>"), end = page.find("</table>", begin);
  EXPECT_NE(begin, std::string::npos) << heading;
  for (size_t row = page.find("<tr><td", begin); row < end; row = page.find("<tr><td", row + 1)) {
    const size_t row_end = page.find("</tr>", row);
    rows.emplace_back();
    for (size_t cell = page.find("<td", row); cell < row_end; cell = page.find("<td", cell + 1)) {
      const size_t text = page.find('>', cell) + 1;
      rows.back().push_back(page.substr(text, page.find("</td>", text) - text));
    }
  }
  return rows;
}

TEST_F(CommandReport, ThePageOfATradeoffSaysWhatItsTablesSay) {
  const Outcome o = run({"tradeoff", "scene.xml", "-o", "out", "--quick", "--quiet"});
  ASSERT_EQ(o.code, 0) << o.err;
  std::set<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder_ / "out")) names.insert(entry.path().filename().string());
  EXPECT_EQ(names, (std::set<std::string>{"bias.csv", "reference.exr", "tradeoff.csv", "tradeoff.html"}));
  const std::string page = read_text(folder_ / "out/tradeoff.html");
  expect_alone(page);
  // Two pairs: pictures, reference, differences and two maps each; and the map of the nearer method.
  EXPECT_EQ(occurrences(page, "<img "), 2u * (2 + 1 + 2 + 2 + 2) + 1u);
  EXPECT_EQ(occurrences(page, "<polyline"),
            2u * (2 + 3 + 1 + 1) + 2u);  // both methods, three tolerances, slope; memory
  for (const char* heading : {"Error against time", "Pictures at equal error", "Pictures at equal time",
                              "Which method is nearer to the reference"}) {
    EXPECT_EQ(occurrences(page, std::string("<h2>") + heading + "</h2>"), 1u) << heading;
  }

  const Table csv = read_csv(folder_ / "out/tradeoff.csv");
  ASSERT_EQ(csv.size(), 3u + 3u + 9u + 2u + 3u + 2u);
  const auto all = table_behind(page, "All measurements");
  ASSERT_EQ(all.size(), csv.size());
  const std::vector<std::string> columns = split(read_text(folder_ / "out/tradeoff.csv").substr(0, 2000), '\n');
  const std::vector<std::string> column_names = split(columns[0], ',');
  for (size_t i = 0; i < all.size(); ++i) {
    for (size_t c = 0; c < column_names.size(); ++c) EXPECT_EQ(all[i][c], csv[i].at(column_names[c])) << i << " " << c;
  }

  const auto select = [&](const std::string& method, const std::string& ladder, const std::string& tolerance) {
    Table rows;
    for (const auto& row : csv) {
      const bool is_wanted = (method.empty() || row.at("method") == method) && row.at("ladder") == ladder;
      if (is_wanted && (tolerance.empty() || row.at("tolerance") == tolerance)) rows.push_back(row);
    }
    return rows;
  };
  const auto expect_seconds = [](const std::string& text, const std::string& value) {
    EXPECT_NEAR(std::stod(text), std::stod(value), 0.006 * std::stod(value)) << text;  // three digits
  };
  const auto words = [](const std::string& relation) {
    return relation == "more_than" ? "more than " : relation == "less_than" ? "less than " : "";
  };
  // What Monte Carlo takes: never a figure of its own where the measured ones end.
  Table usual = select("hybrid", "samples", "0.1");
  for (const auto& row : select("hybrid", "target", "")) usual.push_back(row);
  const auto times = table_behind(page, "Monte Carlo's time to the same error");
  ASSERT_EQ(times.size(), 6u);
  for (size_t i = 0; i < times.size(); ++i) {
    const auto& row = usual[i];
    EXPECT_EQ(times[i][1], row.at("rmse"));
    expect_seconds(times[i][3], row.at("seconds_cold"));
    expect_seconds(times[i][4], row.at("seconds_warm"));
    const std::string word = words(row.at("montecarlo_relation"));
    for (const size_t c : {5u, 6u, 7u}) EXPECT_EQ(times[i][c].rfind(word, 0), 0u) << times[i][c];
    expect_seconds(times[i][5].substr(word.size()), row.at("montecarlo_seconds"));
    if (row.at("frames_relation") == "equals") {
      EXPECT_EQ(times[i][8], row.at("frames_to_pay"));
    }
  }
  const auto targets = table_behind(page, "Pictures to an error");
  const Table target_rows = select("", "target", "");
  ASSERT_EQ(targets.size(), 6u);
  for (size_t i = 0; i < targets.size(); ++i) {
    EXPECT_EQ(targets[i][1], target_rows[i].at("target_error"));
    EXPECT_EQ(targets[i][2], target_rows[i].at("error_estimate"));
    EXPECT_EQ(targets[i][3], target_rows[i].at("rmse"));
    EXPECT_EQ(targets[i][4], target_rows[i].at("spp"));
  }
  const auto memory = table_behind(page, "Error against memory");
  const Table resolutions = select("hybrid", "resolution", "");
  ASSERT_EQ(memory.size(), 2u);
  for (size_t i = 0; i < memory.size(); ++i) {
    EXPECT_EQ(memory[i][0], resolutions[i].at("directions"));
    EXPECT_EQ(memory[i][1], resolutions[i].at("plane"));
    EXPECT_NEAR(std::stod(memory[i][2]), 1e-6 * std::stod(resolutions[i].at("bytes_memory")), 0.0051);
    EXPECT_EQ(memory[i].back(), resolutions[i].at("rmse"));
  }
  const auto parts = table_behind(page, "Bias and variance");
  const Table bias = read_csv(folder_ / "out/bias.csv");
  ASSERT_EQ(parts.size(), 3u);
  ASSERT_EQ(bias.size(), 3u);
  for (size_t i = 0; i < parts.size(); ++i) {
    EXPECT_EQ(parts[i][3], bias[i].at("mse"));
    EXPECT_EQ(parts[i][4], bias[i].at("bias_square"));
    EXPECT_EQ(parts[i][6], bias[i].at("variance"));
    const double square = std::stod(bias[i].at("bias_square")), variance = std::stod(bias[i].at("variance"));
    EXPECT_NEAR(std::stod(bias[i].at("mse")), square + variance, 1e-5 * (std::abs(square) + variance));  // six digits
  }

  if (!has_browser()) return;
  const PageFindings found = open_page(page, folder_.path());
  EXPECT_EQ(found.images, 19);
  EXPECT_EQ(found.missing_images, std::vector<std::string>());
  EXPECT_EQ(found.errors, std::vector<std::string>());
}

TEST_F(CommandReport, ThePageOfACompareReplacesNoInput) {
  expect_failure(2, "--report", {"compare", "a.exr", "b.exr", "--report", "a.exr"});
  expect_failure(1, "nowhere/page.html", {"compare", "a.exr", "b.exr", "--report", "nowhere/page.html"});
  // Without colours there is nothing to show.
  ASSERT_EQ(run({"render", "scene.xml", "-o", "c.exr", "--quiet"}).code, 0);
  Image grey = read_image(folder_ / "a.exr");
  grey.channels = {"X", "Y", "Z"};
  write_image(folder_ / "x.exr", grey);
  expect_failure(1, "R, G and B", {"compare", "x.exr", "x.exr", "--report", "page.html"});
  const auto j = nlohmann::json::parse(run({"compare", "x.exr", "x.exr", "--json"}).out);
  EXPECT_TRUE(j["flip"].is_null() && j["hdr_flip"].is_null());
}

TEST_F(CommandReport, ABrowserFindsNothingMissingOnThePageOfACompare) {
  if (!has_browser()) GTEST_SKIP() << "chromium is not installed";
  ASSERT_EQ(run({"compare", "a.exr", "b.exr", "--report", "page.html"}).code, 0);
  const PageFindings found = open_page(read_text(folder_ / "page.html"), folder_.path());
  EXPECT_EQ(found.images, 5);
  EXPECT_EQ(found.missing_images, std::vector<std::string>());
  EXPECT_EQ(found.errors, std::vector<std::string>());
}

}  // namespace
}  // namespace fieldtrace::test
