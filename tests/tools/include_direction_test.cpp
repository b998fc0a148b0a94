// Fails when an include points against the layout: which folder may include which.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <sstream>
#include <string>
#include <vector>

namespace fieldtrace {
namespace {

namespace fs = std::filesystem;

// folder -> folders that it may include beside itself. No folder may include gpu: it registers itself.
const std::map<std::string, std::set<std::string>> k_allowed = {
    {"core", {}},
    {"field", {"core"}},
    {"hybrid", {"core", "field"}},
    {"gpu", {"core", "field", "hybrid"}},
    {"tools", {"core", "field", "hybrid"}},
    {"tests", {"core", "field", "hybrid", "gpu", "tools"}},
};

// Complaints about the includes in `text`, the contents of a file of `folder`.
std::vector<std::string> wrong_includes(const std::string& folder, const std::string& file, const std::string& text) {
  // Highway includes the file that HWY_TARGET_INCLUDE names once per instruction set.
  static const std::regex quoted(R"re(^\s*#\s*(?:include|define\s+HWY_TARGET_INCLUDE)\s+"([^"]+)")re");
  static const std::regex cuda(R"re(^\s*#\s*include\s+<(cuda|cub/|thrust/|cooperative_groups)[^>]*>)re");
  std::vector<std::string> complaints;
  std::istringstream lines(text);
  std::string line;
  for (int number = 1; std::getline(lines, line); ++number) {
    const std::string where = file + ":" + std::to_string(number) + ": ";
    std::smatch match;
    if (std::regex_search(line, match, quoted)) {
      const std::string path = match[1];
      const std::string target = path.substr(0, path.find('/'));
      // A bare name is a file of the same folder, which only tests use.
      if (path.find('/') == std::string::npos && folder == "tests") continue;
      if (path.find('/') == std::string::npos || !k_allowed.count(target)) {
        complaints.push_back(where + "\"" + path + "\" does not start with a folder of the project");
      } else if (target != folder && !k_allowed.at(folder).count(target)) {
        complaints.push_back(where + folder + " must not include " + target + " (\"" + path + "\")");
      }
    } else if (folder != "gpu" && folder != "tests" && std::regex_search(line, match, cuda)) {
      complaints.push_back(where + "only gpu may include CUDA's headers");
    }
  }
  return complaints;
}

bool is_source(const fs::path& path) {
  static const std::set<std::string> endings = {".h", ".cpp", ".cu", ".cuh", ".c", ".inl"};
  return endings.count(path.extension().string()) > 0;
}

TEST(IncludeDirection, EveryIncludeFollowsTheLayout) {
  const fs::path root = FIELDTRACE_SOURCE_DIR;
  size_t files = 0;
  for (const auto& [folder, allowed] : k_allowed) {
    ASSERT_TRUE(fs::is_directory(root / folder)) << folder;
    for (const fs::directory_entry& entry : fs::recursive_directory_iterator(root / folder)) {
      if (!entry.is_regular_file() || !is_source(entry.path())) continue;
      ++files;
      std::ostringstream text;
      text << std::ifstream(entry.path()).rdbuf();
      for (const std::string& c : wrong_includes(folder, fs::relative(entry.path(), root).string(), text.str())) {
        ADD_FAILURE() << c;
      }
    }
  }
  EXPECT_GT(files, 20u);  // else the test looked in the wrong place
}

TEST(IncludeDirection, TheScenesFolderHoldsNoCode) {
  for (const fs::directory_entry& entry :
       fs::recursive_directory_iterator(fs::path(FIELDTRACE_SOURCE_DIR) / "scenes")) {
    EXPECT_FALSE(is_source(entry.path())) << entry.path();
  }
}

TEST(IncludeDirection, FindsWhatIsWrong) {
  const auto count = [](const char* folder, const char* text) { return wrong_includes(folder, "f", text).size(); };
  EXPECT_EQ(count("core", "#include \"hybrid/render/render.h\"\n"), 1u);
  EXPECT_EQ(count("core", "  #  include \"field/chart/chart.hd.h\"\n"), 1u);
  EXPECT_EQ(count("field", "#include \"hybrid/render/render.h\"\n"), 1u);
  EXPECT_EQ(count("hybrid", "#include \"gpu/device.h\"\n"), 1u);
  EXPECT_EQ(count("tools", "#include \"gpu/device.h\"\n"), 1u);
  EXPECT_EQ(count("hybrid", "#include \"tools/cli/options.h\"\n"), 1u);
  EXPECT_EQ(count("core", "#define HWY_TARGET_INCLUDE \"field/query.cpp\"\n"), 1u);
  EXPECT_EQ(count("core", "#include \"mesh.h\"\n"), 1u);
  EXPECT_EQ(count("core", "#include \"../field/chart.h\"\n"), 1u);
  EXPECT_EQ(count("field", "#include <cuda_runtime.h>\n"), 1u);
  const auto complaints = wrong_includes("core", "core/a.cpp", "\n#include \"field/b.h\"\n");
  ASSERT_EQ(complaints.size(), 1u);
  EXPECT_EQ(complaints[0].rfind("core/a.cpp:2: core must not include field", 0), 0u) << complaints[0];
}

TEST(IncludeDirection, AcceptsWhatIsRight) {
  const auto count = [](const char* folder, const char* text) { return wrong_includes(folder, "f", text).size(); };
  EXPECT_EQ(count("core", "#include \"core/mesh/mesh.h\"\n#include <vector>\n"), 0u);
  EXPECT_EQ(count("hybrid", "#include \"core/mesh/mesh.h\"\n#include \"field/bake/bake.h\"\n"), 0u);
  EXPECT_EQ(count("gpu", "#include \"hybrid/render/render.h\"\n#include <cuda_runtime.h>\n"), 0u);
  EXPECT_EQ(count("tests", "#include \"gpu/device.h\"\n#include \"mesh_checks.h\"\n"), 0u);
  EXPECT_EQ(count("core", "// #include \"hybrid/render/render.h\" would be wrong\n"), 0u);
}

}  // namespace
}  // namespace fieldtrace
