// `fieldtrace thesis` run as a user would, and its page as rendered by a browser.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "core/image/image.h"
#include "tests/support/browser.h"
#include "tests/support/field_checks.h"
#include "tests/support/program.h"

namespace fieldtrace::test {
namespace {

namespace fs = std::filesystem;

std::set<std::string> files_of(const fs::path& folder) {
  std::set<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder)) names.insert(entry.path().filename().string());
  return names;
}

std::string from_base64(const std::string& text) {
  static const std::string letters = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string bytes;
  uint32_t word = 0, bits = 0;
  for (const char c : text) {
    const size_t value = letters.find(c);
    if (value == std::string::npos) break;
    word = word << 6 | uint32_t(value);
    bits += 6;
    if (bits < 8) continue;
    bits -= 8;
    bytes += char(word >> bits & 0xffu);
  }
  return bytes;
}

// A picture of a case's section of the page, as it is stored, by way of a file in `folder`. `caption`: its beginning.
Image picture_of(const std::string& page, const std::string& name, const std::string& caption,
                 const TemporaryFolder& folder) {
  const size_t section = page.find("<h3 id=\"" + name + "\">"), end = page.find("alt=\"" + caption, section);
  const std::string prefix = "data:image/png;base64,";
  const size_t begin = page.rfind(prefix, end) + prefix.size();
  EXPECT_TRUE(section < begin && begin < end && end != std::string::npos) << name << ": " << caption;
  std::ofstream(folder / "picture.png", std::ios::binary) << from_base64(page.substr(begin, end - begin));
  return read_image(folder / "picture.png", {.linearise = false});
}

// Root of the mean squared difference of the bytes.
double rms_of_bytes(const Image& a, const Image& b) {
  EXPECT_EQ(a.data.size(), b.data.size());
  double sum = 0.0;
  for (size_t i = 0; i < std::min(a.data.size(), b.data.size()); ++i) {
    const double d = 255.0 * (double(a.data[i]) - double(b.data[i]));
    sum += d * d;
  }
  return std::sqrt(sum / double(a.data.size()));
}

TEST(CommandThesis, QuickRunWritesThePageAndTheTables) {
  const TemporaryFolder folder;
  const Outcome o = Program(folder.path(), {"thesis", "-o", "out", "--quick"}).wait();
  ASSERT_EQ(o.code, 0) << o.err;
  // No scratch file remains.
  EXPECT_EQ(files_of(folder / "out"),
            (std::set<std::string>{"thesis.html", "thesis.csv", "growth.csv", "charts.csv", "hybrid.csv"}));
  const std::string page = read_text(folder / "out/thesis.html");
  std::istringstream csv(read_text(folder / "out/thesis.csv"));
  std::string line;
  std::getline(csv, line);
  int compared = 0;
  for (const char* name : {"supershape_1", "hyperboloid", "bunny", "bunny_two_lights", "supershape_2", "reflection_1",
                           "reflection_2", "shadow"}) {
    EXPECT_NE(page.find("<h3 id=\"" + std::string(name) + "\">"), std::string::npos) << name;
    ASSERT_TRUE(std::getline(csv, line));
    EXPECT_EQ(line.substr(0, line.find(',')), name);
    std::istringstream fields(line);
    std::vector<std::string> values;
    for (std::string value; std::getline(fields, value, ',');) values.push_back(value);
    ASSERT_GT(values.size(), 17u);
    EXPECT_EQ(values[4], "32");
    // The row's RMS is that of the page's pictures; a byte may be rounded otherwise on its way through the file.
    const double rms = std::stod(values[5]);
    EXPECT_NEAR(
        rms_of_bytes(picture_of(page, name, "exact rays", folder), picture_of(page, name, "fields, M = 32", folder)),
        rms, 0.01 * rms)
        << name;
    EXPECT_GT(rms, 0.0);
    // No worse than in the thesis, where it tells.
    if (const std::string& thesis = values[17]; !thesis.empty()) {
      ++compared;
      EXPECT_LE(rms, std::stod(thesis)) << name;
    }
    EXPECT_GT(std::stod(values[15]), 1e5);  // the OpenVDB file
  }
  EXPECT_EQ(compared, 2);  // hyperboloid and bunny
  size_t images = 0;
  for (size_t at = page.find("<img"); at != std::string::npos; at = page.find("<img", at + 1)) {
    ++images;
    const std::string prefix = "<img src=\"data:image/png;base64,iVBORw0KGgo";
    EXPECT_EQ(page.substr(at, prefix.size()), prefix);
  }
  EXPECT_EQ(images, 8u * 3u + 1u);
  EXPECT_EQ(page.find("src=\"http"), std::string::npos);
  EXPECT_NE(page.find("</html>"), std::string::npos);
}

// The page of a quick run, then the same page broken in each way that the browser has to detect.
TEST(CommandThesis, ABrowserFindsNothingMissingOnThePage) {
  if (!has_browser()) GTEST_SKIP() << "chromium is not installed";
  const TemporaryFolder folder;
  const Outcome o = Program(folder.path(), {"thesis", "-o", "out", "--quick"}).wait();
  ASSERT_EQ(o.code, 0) << o.err;
  const std::string page = read_text(folder / "out/thesis.html");
  const PageFindings whole = open_page(page, folder.path());
  EXPECT_EQ(whole.images, 8 * 3 + 1);
  EXPECT_EQ(whole.missing_images, std::vector<std::string>());
  EXPECT_EQ(whole.errors, std::vector<std::string>());

  const auto with = [&](const std::string& before, const std::string& text) {
    std::string broken = page;
    broken.insert(broken.find(before), text);
    return open_page(broken, folder.path());
  };
  const PageFindings absent = with("</body>", "<img src=\"absent.png\" alt=\"absent\">");
  EXPECT_EQ(absent.images, whole.images + 1);
  EXPECT_EQ(absent.missing_images, std::vector<std::string>({"absent"}));
  EXPECT_EQ(absent.errors.size(), 1u);
  std::string damaged = page;
  const std::string signature = "base64,iVBORw0KGgo";
  damaged.replace(damaged.find(signature), signature.size(), "base64,AAAAAAAAAAA");
  EXPECT_EQ(open_page(damaged, folder.path()).missing_images.size(), 1u);
  EXPECT_EQ(with("</body>", "<script>absent();</script>").errors.size(), 1u);
  EXPECT_EQ(with("</body>", "<script>console.error('no');</script>").errors, std::vector<std::string>({"no"}));
  EXPECT_EQ(with("</head>", "<link rel=\"stylesheet\" href=\"absent.css\">").errors.size(), 1u);
}

// What has no rows yet leaves that of an earlier run in its place.
TEST(CommandThesis, InterruptedRunKeepsWhatIsFinished) {
  const TemporaryFolder folder;
  fs::create_directory(folder / "out");
  const std::vector<std::string> tables = {"thesis.csv", "growth.csv", "charts.csv", "hybrid.csv"};
  const auto text = [&](const std::string& name) { return read_text(folder / ("out/" + name)); };
  for (const std::string& name : tables) std::ofstream(folder / ("out/" + name)) << "older";
  std::ofstream(folder / "out/thesis.html") << "older";
  // Later and later, until something is finished.
  int attempts = 0;
  for (double seconds = 0.0; text("thesis.html") == "older"; seconds = std::max(2.0 * seconds, 0.125)) {
    ASSERT_LT(++attempts, 15);
    Program program(folder.path(), {"thesis", "-o", "out", "--quick"});
    std::this_thread::sleep_for(std::chrono::duration<double>(seconds));
    ASSERT_TRUE(program.interrupt());
    const Outcome o = program.wait();
    EXPECT_EQ(o.code, 130) << o.err;
    const bool is_written = text("thesis.html") != "older";
    EXPECT_NE(o.err.find(is_written ? "what was finished is in" : "interrupted; nothing was written"),
              std::string::npos)
        << o.err;
    for (const std::string& name : tables) {
      if (!is_written || name == "hybrid.csv") {
        EXPECT_EQ(text(name), "older") << name;
      }
    }
  }
  EXPECT_GT(attempts, 1);
  EXPECT_NE(text("thesis.html").find("</html>"), std::string::npos);
  const std::string finished = text("thesis.csv");
  EXPECT_EQ(finished.rfind("case,", 0), 0u);
  EXPECT_GE(std::count(finished.begin(), finished.end(), '\n'), 2);
}

TEST(CommandThesis, AFolderThatCannotBeMadeIsNamed) {
  const TemporaryFolder folder;
  std::ofstream(folder / "file") << "x";
  const Outcome o = Program(folder.path(), {"thesis", "-o", "file/out", "--quick"}).wait();
  EXPECT_EQ(o.code, 1);
  EXPECT_NE(o.err.find("file/out"), std::string::npos) << o.err;
}

}  // namespace
}  // namespace fieldtrace::test
