// Which shared libraries the program loads, and when: every start pays for those that it need not load.
#include <cstdlib>
#include <nlohmann/json.hpp>

#include "tests/support/command_files.h"

namespace fieldtrace::test {
namespace {

namespace fs = std::filesystem;

class StartUp : public CommandFiles {
 protected:
  // File names of the libraries that the program initialises, as the loader (ld.so, LD_DEBUG=files) logs them: those
  // that it is linked with, and those that it opens.
  std::set<std::string> libraries_of(const std::vector<std::string>& arguments) const {
    const std::string log = folder_ / ".libraries";
    const Outcome o = run(arguments, [&] {
      setenv("LD_DEBUG", "files", 1);
      setenv("LD_DEBUG_OUTPUT", log.c_str(), 1);  // a dot and the process are added
    });
    EXPECT_EQ(o.code, 0) << o.err;
    std::set<std::string> names;
    for (const auto& entry : fs::directory_iterator(folder_.path())) {
      if (entry.path().stem() != ".libraries") continue;
      std::ifstream lines(entry.path());
      const std::string start = "calling init: ";
      for (std::string line; std::getline(lines, line);) {
        const size_t at = line.find(start);
        if (at != std::string::npos) names.insert(fs::path(line.substr(at + start.size())).filename().string());
      }
      fs::remove(entry.path());
    }
    return names;
  }

  static bool holds(const std::set<std::string>& names, const std::string& part) {
    return std::any_of(names.begin(), names.end(),
                       [&](const std::string& name) { return name.find(part) != std::string::npos; });
  }

  // 18 with the packages of Debian 12; sanitizers add some. OpenVDB makes it 28, OpenImageIO 260.
  static void expect_few(const std::set<std::string>& names) {
    EXPECT_TRUE(holds(names, "libc.so"));  // the log was read
    EXPECT_LE(names.size(), 24u);
    for (const char* part : {"OpenImageIO", "openvdb", "fieldtrace_"}) EXPECT_FALSE(holds(names, part)) << part;
  }
};

TEST_F(StartUp, VersionAndHelpLoadFewLibraries) {
  expect_few(libraries_of({"--version"}));
  expect_few(libraries_of({"--help"}));
  expect_few(libraries_of({"render", "--help"}));
}

TEST_F(StartUp, ARenderWithoutBitmapsLoadsFewLibraries) {
  expect_few(libraries_of({"render", "scene.xml", "-o", "a.exr", "-o", "a.png", "--quiet"}));
}

TEST_F(StartUp, ModulesAreOpenedWhenNeeded) {
  ASSERT_EQ(run({"render", "scene.xml", "-o", "a.exr", "--quiet"}).code, 0);
  expect_few(libraries_of({"info", "a.exr"}));
  ASSERT_EQ(run({"render", "scene.xml", "-o", "layers.exr", "--aov", "depth", "--quiet"}).code, 0);
  const auto image = libraries_of({"info", "layers.exr"});
  EXPECT_TRUE(holds(image, "libfieldtrace_image_formats.so"));
  EXPECT_TRUE(holds(image, "OpenImageIO"));
  EXPECT_FALSE(holds(image, "libfieldtrace_vdb.so"));
  const auto cache =
      libraries_of({"render", "scene.xml", "-o", "a.exr", "--field-cache", "cache", "--directions", "32", "--quiet"});
  EXPECT_TRUE(holds(cache, "libfieldtrace_vdb.so"));
  EXPECT_FALSE(holds(cache, "OpenImageIO"));
}

// OpenVDB writes field files, but these are read without it.
TEST_F(StartUp, WarmRendersDoNotOpenOpenVdb) {
  std::string sky = k_small_scene;
  sky.insert(sky.rfind("</scene>"), "<emitter type=\"constant\"/>");
  write("sky.xml", sky);
  for (const char* const scene : {"scene.xml", "sky.xml"}) {
    const std::vector<std::string> render = {"render",          scene,  "-o",      "a.exr",  "--field-cache", "cache",
                                             "--light-samples", "4096", "--stats", "a.json", "--quiet"};
    fs::remove_all(folder_ / "cache");
    EXPECT_TRUE(holds(libraries_of(render), "libfieldtrace_vdb.so"));
    const auto baked = [&] {
      return nlohmann::json::parse(std::ifstream(folder_ / "a.json"))["bake"]["rays"].get<uint64_t>();
    };
    EXPECT_GT(baked(), 0u);
    expect_few(libraries_of(render));
    EXPECT_EQ(baked(), 0u);
  }
  fs::remove_all(folder_ / "cache");
  expect_few(libraries_of(
      {"render", "scene.xml", "-o", "a.exr", "--field-cache", "cache", "--method", "montecarlo", "--quiet"}));
}

// The program alone, as one that was copied elsewhere.
TEST_F(StartUp, AMissingModuleIsNamedBeforeWorkStarts) {
  ASSERT_EQ(run({"render", "scene.xml", "-o", "layers.exr", "--aov", "depth", "--quiet"}).code, 0);
  fs::create_directory(folder_ / "bin");
  const std::string program = folder_ / "bin/fieldtrace";
  fs::copy_file(FIELDTRACE_PROGRAM, program);
  const auto run_copy = [&](const std::vector<std::string>& arguments) {
    return Program(folder_.path(), arguments, program).wait();
  };
  EXPECT_EQ(run_copy({"--version"}).code, 0);
  EXPECT_EQ(run_copy({"render", "scene.xml", "-o", "b.exr", "--quiet"}).code, 0);
  const std::set<std::string> before = files();
  const struct {
    const char* module;
    std::vector<std::string> arguments;
  } cases[] = {
      {"image_formats", {"info", "layers.exr"}},
      {"vdb", {"bake", "ball.ply", "-o", "ball.vdb", "--full"}},
      {"vdb", {"render", "scene.xml", "-o", "c.exr", "--field-cache", "cache", "--directions", "32", "--quiet"}}};
  for (const auto& [module, arguments] : cases) {
    SCOPED_TRACE(arguments[0]);
    const Outcome o = run_copy(arguments);
    EXPECT_EQ(o.code, 1);
    EXPECT_EQ(o.err.rfind("fieldtrace: /", 0), 0u) << o.err;
    const std::string part = std::string("/lib/fieldtrace/libfieldtrace_") + module + ".so: a part of this program";
    EXPECT_NE(o.err.find(part), std::string::npos) << o.err;
    EXPECT_NE(o.err.find("build or install the program again"), std::string::npos) << o.err;
    EXPECT_EQ(std::count(o.err.begin(), o.err.end(), '\n'), 1) << o.err;
    EXPECT_EQ(files(), before);
  }
}

}  // namespace
}  // namespace fieldtrace::test
