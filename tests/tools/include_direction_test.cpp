// Fails if an include violates the layering of folders and components.
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

// Top-level folders -> those that each may include besides itself. No folder may include gpu: it registers itself.
const std::map<std::string, std::set<std::string>> k_allowed = {
    {"fieldtrace", {}},
    {"core", {}},
    {"field", {"core"}},
    {"hybrid", {"core", "field", "fieldtrace"}},
    {"gpu", {"core", "field", "hybrid"}},
    {"tools", {"core", "field", "hybrid"}},
    {"tests", {"core", "field", "hybrid", "gpu", "tools", "fieldtrace"}},
};

// For each component (core/mesh, ...) the components that its CMakeLists.txt allows it to include.
using Components = std::map<std::string, std::set<std::string>>;

// The words after MAY_INCLUDE in the text of a component's CMakeLists.txt, up to the next keyword.
std::set<std::string> may_include(const std::string& text) {
  std::set<std::string> folders;
  const size_t begin = text.find("MAY_INCLUDE");
  if (begin == std::string::npos) return folders;
  std::istringstream words(text.substr(begin + std::string("MAY_INCLUDE").size()));
  std::string word;
  while (words >> word) {
    const bool last = word.back() == ')';
    if (last) word.pop_back();
    if (word.find('/') == std::string::npos) break;
    folders.insert(word);
    if (last) break;
  }
  return folders;
}

std::string text_of(const fs::path& file) {
  std::ostringstream text;
  text << std::ifstream(file).rdbuf();
  return text.str();
}

Components read_components() {
  Components components;
  const fs::path root = FIELDTRACE_SOURCE_DIR;
  for (const char* library : {"core", "field", "hybrid"}) {
    for (const fs::directory_entry& entry : fs::directory_iterator(root / library)) {
      if (!entry.is_directory()) continue;
      components[fs::relative(entry.path(), root).string()] = may_include(text_of(entry.path() / "CMakeLists.txt"));
    }
  }
  return components;
}

std::string folder_of(const std::string& path) {
  const size_t slash = path.rfind('/');
  return slash == std::string::npos ? std::string() : path.substr(0, slash);
}

// Errors for the includes in `text`, the contents of `file` (its path from the root).
std::vector<std::string> wrong_includes(const Components& components, const std::string& file,
                                        const std::string& text) {
  // Highway includes the file named by HWY_TARGET_INCLUDE once per instruction set.
  static const std::regex quoted(R"re(^\s*#\s*(?:include|define\s+HWY_TARGET_INCLUDE)\s+"([^"]+)")re");
  const std::string top = file.substr(0, file.find('/')), from = folder_of(file);
  std::vector<std::string> complaints;
  std::istringstream lines(text);
  std::string line;
  for (int number = 1; std::getline(lines, line); ++number) {
    const std::string where = file + ":" + std::to_string(number) + ": ";
    std::smatch match;
    if (std::regex_search(line, match, quoted)) {
      const std::string path = match[1];
      const std::string target = path.substr(0, path.find('/')), to = folder_of(path);
      if (to.empty() || !k_allowed.count(target)) {
        complaints.push_back(where + "\"" + path + "\" does not start with a folder of the project");
      } else if (target != top && !k_allowed.at(top).count(target)) {
        complaints.push_back(where + top + " must not include " + target + " (\"" + path + "\")");
      } else if (components.count(from) && target != "fieldtrace" && to != from && !components.at(from).count(to)) {
        complaints.push_back(where + from + " must not include " + to + " (\"" + path + "\"): MAY_INCLUDE in " + from +
                             "/CMakeLists.txt does not name it");
      }
    }
  }
  return complaints;
}

bool is_source(const fs::path& path) {
  static const std::set<std::string> endings = {".h", ".cpp", ".cu", ".cuh", ".c", ".inl"};
  return endings.count(path.extension().string()) > 0;
}

// Whether the components can be ordered so that each includes only earlier ones.
bool is_acyclic(const Components& components) {
  std::set<std::string> done;
  for (bool grows = true; grows;) {
    grows = false;
    for (const auto& [folder, includes] : components) {
      if (done.count(folder)) continue;
      if (std::all_of(includes.begin(), includes.end(), [&](const std::string& i) { return done.count(i) > 0; })) {
        grows = done.insert(folder).second;
      }
    }
  }
  return done.size() == components.size();
}

TEST(IncludeDirection, EveryIncludeFollowsTheLayout) {
  const fs::path root = FIELDTRACE_SOURCE_DIR;
  const Components components = read_components();
  ASSERT_GT(components.size(), 20u);  // else the test looked in the wrong place
  size_t files = 0;
  for (const auto& [folder, allowed] : k_allowed) {
    ASSERT_TRUE(fs::is_directory(root / folder)) << folder;
    for (const fs::directory_entry& entry : fs::recursive_directory_iterator(root / folder)) {
      if (!entry.is_regular_file() || !is_source(entry.path())) continue;
      ++files;
      const std::string file = fs::relative(entry.path(), root).string();
      for (const std::string& c : wrong_includes(components, file, text_of(entry.path()))) ADD_FAILURE() << c;
    }
  }
  EXPECT_GT(files, 20u);
}

// The allowed includes form no cycle, and each of them is used.
TEST(IncludeDirection, ComponentsFormNoCyclesAndSayNoMoreThanTheyInclude) {
  const Components components = read_components();
  EXPECT_TRUE(is_acyclic(components));
  for (const auto& [folder, includes] : components) {
    std::string text;
    for (const fs::directory_entry& entry : fs::directory_iterator(fs::path(FIELDTRACE_SOURCE_DIR) / folder)) {
      if (is_source(entry.path())) text += text_of(entry.path());
    }
    for (const std::string& i : includes) {
      EXPECT_TRUE(components.count(i)) << folder << ": there is no " << i;
      EXPECT_NE(text.find("include \"" + i + "/"), std::string::npos) << folder << " includes nothing of " << i;
    }
  }
}

// At most about 25 source files per folder, so that files are found by name.
TEST(IncludeDirection, FoldersStaySmall) {
  std::map<std::string, int> count;
  const fs::path root = FIELDTRACE_SOURCE_DIR;
  for (const auto& [folder, allowed] : k_allowed) {
    for (const fs::directory_entry& entry : fs::recursive_directory_iterator(root / folder)) {
      if (is_source(entry.path())) ++count[fs::relative(entry.path().parent_path(), root).string()];
    }
  }
  for (const auto& [folder, files] : count) EXPECT_LE(files, 28) << folder;
}

TEST(IncludeDirection, TheScenesFolderHoldsNoCode) {
  size_t files = 0;
  for (const fs::directory_entry& entry :
       fs::recursive_directory_iterator(fs::path(FIELDTRACE_SOURCE_DIR) / "scenes")) {
    EXPECT_FALSE(is_source(entry.path())) << entry.path();
    ++files;
  }
  EXPECT_GT(files, 10u);
}

const Components k_example = {{"core/a", {}}, {"core/b", {"core/a"}}, {"field/c", {"core/a"}}};

size_t wrong_count(const char* file, const char* text) { return wrong_includes(k_example, file, text).size(); }

TEST(IncludeDirection, FindsWhatIsWrong) {
  EXPECT_EQ(wrong_count("core/a/x.h", "#include \"hybrid/render/render.h\"\n"), 1u);
  EXPECT_EQ(wrong_count("core/a/x.h", "  #  include \"field/c/chart.hd.h\"\n"), 1u);
  EXPECT_EQ(wrong_count("core/a/x.h", "#include \"core/b/y.h\"\n"), 1u);
  EXPECT_EQ(wrong_count("field/c/x.h", "#include \"core/b/y.h\"\n"), 1u);
  EXPECT_EQ(wrong_count("field/c/x.h", "#include \"hybrid/render/render.h\"\n"), 1u);
  EXPECT_EQ(wrong_count("hybrid/d/x.h", "#include \"gpu/device.h\"\n"), 1u);
  EXPECT_EQ(wrong_count("tools/x.h", "#include \"gpu/device.h\"\n"), 1u);
  EXPECT_EQ(wrong_count("hybrid/d/x.h", "#include \"tools/cli/options.h\"\n"), 1u);
  EXPECT_EQ(wrong_count("core/a/x.cpp", "#define HWY_TARGET_INCLUDE \"core/b/y.cpp\"\n"), 1u);
  EXPECT_EQ(wrong_count("core/a/x.h", "#include \"mesh.h\"\n"), 1u);
  EXPECT_EQ(wrong_count("core/a/x.h", "#include \"../field/chart.h\"\n"), 1u);
  const auto complaints = wrong_includes(k_example, "core/a/a.cpp", "\n#include \"field/c/b.h\"\n");
  ASSERT_EQ(complaints.size(), 1u);
  EXPECT_EQ(complaints[0].rfind("core/a/a.cpp:2: core must not include field", 0), 0u) << complaints[0];
}

TEST(IncludeDirection, AcceptsWhatIsRight) {
  EXPECT_EQ(wrong_count("core/a/x.h", "#include \"core/a/mesh.h\"\n#include <vector>\n"), 0u);
  EXPECT_EQ(wrong_count("core/b/x.h", "#include \"core/a/mesh.h\"\n"), 0u);
  EXPECT_EQ(wrong_count("field/c/x.h", "#include \"core/a/mesh.h\"\n#include \"field/c/bake.h\"\n"), 0u);
  EXPECT_EQ(wrong_count("gpu/x.cu", "#include \"hybrid/d/render.h\"\n#include <vector>\n"), 0u);
  EXPECT_EQ(wrong_count("tests/core/x.cpp", "#include \"gpu/device.h\"\n#include \"tests/support/mesh_checks.h\"\n"),
            0u);
  EXPECT_EQ(wrong_count("core/a/x.h", "// #include \"hybrid/render/render.h\" would be wrong\n"), 0u);
}

TEST(IncludeDirection, ReadsWhatComponentsMayInclude) {
  using Set = std::set<std::string>;
  EXPECT_EQ(may_include("fieldtrace_component()"), Set());
  EXPECT_EQ(may_include("fieldtrace_component(MAY_INCLUDE core/a)"), Set({"core/a"}));
  EXPECT_EQ(may_include("fieldtrace_component(\n  MAY_INCLUDE core/a\n    core/b\n  LIBRARIES embree)"),
            Set({"core/a", "core/b"}));
}

TEST(IncludeDirection, FindsCycles) {
  EXPECT_TRUE(is_acyclic(k_example));
  EXPECT_FALSE(is_acyclic({{"core/a", {"core/b"}}, {"core/b", {"core/a"}}}));
}

}  // namespace
}  // namespace fieldtrace
