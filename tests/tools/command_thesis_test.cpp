// `fieldtrace thesis` run as a user would, and its page as rendered by a browser.
#include <gtest/gtest.h>

#include <filesystem>
#include <set>
#include <sstream>
#include <string>
#include <vector>

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
  for (const char* name : {"supershape_1", "hyperboloid", "bunny", "bunny_two_lights", "supershape_2", "reflection_1",
                           "reflection_2", "shadow"}) {
    EXPECT_NE(page.find("<h3 id=\"" + std::string(name) + "\">"), std::string::npos) << name;
    ASSERT_TRUE(std::getline(csv, line));
    EXPECT_EQ(line.substr(0, line.find(',')), name);
    std::istringstream fields(line);
    std::vector<std::string> values;
    for (std::string value; std::getline(fields, value, ',');) values.push_back(value);
    ASSERT_GT(values.size(), 16u);
    EXPECT_EQ(values[4], "32");
    // RMS of a field against exact rays: neither identical nor unrelated.
    EXPECT_GT(std::stod(values[5]), 0.5);
    EXPECT_LT(std::stod(values[5]), 40.0);
    EXPECT_GT(std::stod(values[15]), 1e5);  // the OpenVDB file
  }
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

TEST(CommandThesis, InterruptedRunKeepsWhatIsFinished) {
  const TemporaryFolder folder;
  Program program(folder.path(), {"thesis", "-o", "out"});
  ASSERT_TRUE(program.interrupt());
  const Outcome o = program.wait();
  EXPECT_EQ(o.code, 130) << o.err;
  EXPECT_NE(o.err.find("interrupted"), std::string::npos) << o.err;
  EXPECT_NE(read_text(folder / "out/thesis.html").find("</html>"), std::string::npos);
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
