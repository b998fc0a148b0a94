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
