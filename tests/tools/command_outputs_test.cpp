// What commands write: all of it or nothing, never over one another or over their inputs.
#include <fcntl.h>
#include <linux/capability.h>
#include <sched.h>
#include <sys/mount.h>
#include <sys/prctl.h>

#include "core/image/image.h"
#include "field/file/field_file.h"
#include "tests/support/command_files.h"

namespace fieldtrace::test {
namespace {

namespace fs = std::filesystem;

using CommandOutputs = CommandFiles;

// Too few bytes for any output, but enough for a message.
void limit_files() {
  const rlimit limit = {512, 512};
  setrlimit(RLIMIT_FSIZE, &limit);
}

void print_to_full_device() { dup2(open("/dev/full", O_WRONLY), STDOUT_FILENO); }

TEST_F(CommandOutputs, WhatCannotBeWrittenWholeLeavesNothing) {
  const std::vector<std::string> render = {"render", "scene.xml", "--quiet"};
  const auto with = [&](const std::vector<std::string>& more) {
    std::vector<std::string> all = render;
    all.insert(all.end(), more.begin(), more.end());
    return all;
  };
  expect_failure(1, "a.png: cannot be written: File too large", with({"-o", "a.png"}), limit_files);
  expect_failure(1, "a.exr: cannot be written: File too large", with({"-o", "a.exr"}), limit_files);
  expect_failure(1, "a.exr: cannot be written: File too large", with({"-o", "a.exr", "--float32"}), limit_files);
  expect_failure(1, "a.ply: cannot be written: File too large", {"mesh", "cube", "-o", "a.ply"}, limit_files);
  expect_failure(1, "a.vdb: cannot be written: File too large",
                 {"bake", "ball.ply", "-o", "a.vdb", "--chart", "thesis", "--directions", "32"}, limit_files);
  // An existing file is left as it was.
  write("a.png", "older");
  expect_failure(1, "a.png: cannot be written: File too large", with({"-o", "a.png"}), limit_files);
  EXPECT_EQ(read_text(folder_ / "a.png"), "older");
}

template <rlim_t Bytes>
void limit_files_to() {
  const rlimit limit = {Bytes, Bytes};
  setrlimit(RLIMIT_FSIZE, &limit);
}

// What renders demand goes through files beside the output. Whether none or only some of it can be kept, there is no
// field, and the reason is told.
TEST_F(CommandOutputs, ABakeOfASceneThatCannotBeKeptIsAnError) {
  fs::create_directory(folder_ / "cache");
  for (const char* output : {"a.vdb", "cache"}) {
    const std::vector<std::string> bake = {"bake", "scene.xml", "-o", output};
    const std::string reason = output + std::string(": cannot be written: File too large");
    expect_failure(1, reason, bake, limit_files);
    // The first render's field is smaller than this, the second's larger.
    expect_failure(1, reason, bake, limit_files_to<200 << 10>);
  }
}

TEST_F(CommandOutputs, LittleAddressSpaceIsEnoughToBakeAScene) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "sanitizers reserve terabytes";
#endif
  const auto limit_addresses = [] {
    const rlimit limit = {2'000'000 << 10, 2'000'000 << 10};
    setrlimit(RLIMIT_AS, &limit);
  };
  const auto bake = [&](const std::string& output, const Prepare& prepare) {
    const Outcome o = run({"bake", "scene.xml", "-o", output}, prepare);
    EXPECT_EQ(o.code, 0) << o.err;
    EXPECT_EQ(o.err, "");
    EXPECT_EQ(o.out.rfind(output + ": ball.ply, ", 0), 0u) << o.out;
  };
  bake("free.vdb", {});
  bake("limited.vdb", limit_addresses);
  EXPECT_EQ(FieldFile(folder_ / "limited.vdb").slices(), FieldFile(folder_ / "free.vdb").slices());
  EXPECT_EQ(run({"info", "limited.vdb"}, limit_addresses).code, 0);
}

// The EXR of so many pixels is too large, the PNG and the statistics are not.
TEST_F(CommandOutputs, OneThatCannotBeWrittenDoesNotLoseTheOthers) {
  const auto between = [] {
    const rlimit limit = {8192, 8192};
    setrlimit(RLIMIT_FSIZE, &limit);
  };
  const Outcome o = run({"render", "scene.xml", "-o", "a.exr", "-o", "a.png", "--float32", "-D", "size=256", "--quiet",
                         "--stats", "s.json"},
                        between);
  EXPECT_EQ(o.code, 1);
  EXPECT_EQ(o.err, "fieldtrace: a.exr: cannot be written: File too large\n");
  EXPECT_EQ(files(), (std::set<std::string>{"a.png", "ball.ply", "s.json", "scene.xml"}));
}

TEST_F(CommandOutputs, TheResumedCheckpointSurvives) {
  ASSERT_EQ(run({"render", "scene.xml", "-o", "a.png", "--quiet", "--checkpoint", "c"}).code, 0);
  const std::string before = read_text(folder_ / "c");
  expect_failure(2, "--stats c: would overwrite the input c",
                 {"render", "scene.xml", "-o", "a.png", "--quiet", "--resume", "c", "--stats", "c"});
  EXPECT_EQ(read_text(folder_ / "c"), before);
  EXPECT_EQ(run({"render", "scene.xml", "-o", "a.png", "--quiet", "--resume", "c", "--checkpoint", "c"}).code, 0);
}

TEST_F(CommandOutputs, StatisticsThatCannotBeWrittenLeaveNothing) {
  // An image of a few pixels is smaller than its statistics.
  const auto between = [] {
    const rlimit limit = {1024, 1024};
    setrlimit(RLIMIT_FSIZE, &limit);
  };
  const Outcome o =
      run({"render", "scene.xml", "-o", "a.png", "--crop", "0,0,4,4", "--quiet", "--stats", "s.json"}, between);
  EXPECT_EQ(o.code, 1);
  EXPECT_EQ(o.err, "fieldtrace: s.json: cannot be written: File too large\n");
  EXPECT_EQ(files(), (std::set<std::string>{"a.png", "ball.ply", "scene.xml"}));
}

TEST_F(CommandOutputs, ATableThatCannotBeWrittenIsToldBeforeTheWork) {
  fs::create_directory(folder_ / "out");
  fs::create_symlink("/dev/full", folder_ / "out/tradeoff.csv.partial");
  const Outcome o = run({"tradeoff", "scene.xml", "-o", "out", "--quick", "--quiet"});
  EXPECT_EQ(o.code, 1);
  EXPECT_EQ(o.err, "fieldtrace: out/tradeoff.csv.partial: cannot be written: it is not a regular file; name one\n");
  EXPECT_FALSE(fs::exists(folder_ / "out/reference.exr"));
}

TEST_F(CommandOutputs, AFullDiskLeavesNothing) {
  fs::create_directory(folder_ / "disk");
  // The mount is private to this process and its children, and disappears with them.
  if (unshare(CLONE_NEWNS) != 0 || mount("none", "/", nullptr, MS_REC | MS_PRIVATE, nullptr) != 0 ||
      mount("none", (folder_ / "disk").c_str(), "tmpfs", 0, "size=64k") != 0) {
    GTEST_SKIP() << "file systems cannot be mounted here";
  }
  write("disk/filler", std::string(64 << 10, 'x'));
  for (const char* name : {"disk/a.png", "disk/a.exr"}) {
    expect_failure(1, std::string(name) + ": cannot be written: No space left on device",
                   {"render", "scene.xml", "-o", name, "-D", "size=512", "--quiet"});
  }
  expect_failure(1, "disk/a.ply: cannot be written: No space left on device", {"mesh", "knot", "-o", "disk/a.ply"});
  expect_failure(1, "disk/a.vdb: cannot be written: No space left on device",
                 {"bake", "ball.ply", "-o", "disk/a.vdb", "--chart", "thesis", "--directions", "32"});
  umount((folder_ / "disk").c_str());
}

TEST_F(CommandOutputs, WhatCannotBePrintedIsAnError) {
  ASSERT_EQ(run({"render", "scene.xml", "-o", "a.png", "-o", "a.exr", "--quiet"}).code, 0);
  constexpr FieldParameters p = {32, 64, 8};
  Field field(test_ball(), p);
  fill_random_slices(field, 1, 10);
  save_field(field, test_identity(p), folder_ / "f.vdb");
  const std::vector<std::vector<std::string>> commands = {{"--version"},
                                                          {"--help"},
                                                          {"render", "--help"},
                                                          {"info", "scene.xml"},
                                                          {"info", "ball.ply"},
                                                          {"info", "a.png"},
                                                          {"info", "f.vdb"},
                                                          {"info", "f.vdb", "--json"},
                                                          {"compare", "a.exr", "a.exr"},
                                                          {"compare", "a.exr", "a.exr", "--json", "--fail-above", "1"}};
  for (const std::vector<std::string>& command : commands) {
    EXPECT_EQ(run(command).code, 0) << command[0];
    expect_failure(1, "standard output: cannot be written: No space left on device", command, print_to_full_device);
  }
  const Outcome bake =
      run({"bake", "ball.ply", "-o", "b.vdb", "--chart", "thesis", "--directions", "32"}, print_to_full_device);
  EXPECT_EQ(bake.code, 1);
  EXPECT_EQ(bake.err, "fieldtrace: standard output: cannot be written: No space left on device\n");
}

TEST_F(CommandOutputs, AClosedStandardOutputReachesNoFile) {
  const auto close_output = [] { close(STDOUT_FILENO); };
  expect_failure(1, "standard output: cannot be written: Bad file descriptor", {"info", "scene.xml"}, close_output);
  EXPECT_EQ(run({"render", "scene.xml", "-o", "a.png", "--quiet"}, close_output).code, 0);
  EXPECT_EQ(read_image(folder_ / "a.png").width, 32);
}

TEST_F(CommandOutputs, NoOutputReplacesAnother) {
  const auto render = [](const std::vector<std::string>& more) {
    std::vector<std::string> all = {"render", "scene.xml", "-o", "a.png", "--quiet"};
    all.insert(all.end(), more.begin(), more.end());
    return all;
  };
  expect_failure(2, "--stats a.png: the same file as -o a.png", render({"--stats", "a.png"}));
  expect_failure(2, "-o ./a.png: the same file as -o a.png", render({"-o", "./a.png"}));
  write("a.png", "");
  fs::create_symlink("a.png", folder_ / "link.json");
  fs::create_hard_link(folder_ / "a.png", folder_ / "hard.json");
  expect_failure(2, "--stats link.json: the same file", render({"--stats", "link.json"}));
  expect_failure(2, "--stats hard.json: the same file", render({"--stats", "hard.json"}));
  fs::create_symlink("later.png", folder_ / "dangling.json");
  expect_failure(2, "--stats dangling.json: the same file as -o later.png",
                 render({"-o", "later.png", "--stats", "dangling.json"}));
  EXPECT_EQ(run(render({"-o", "a.exr", "--stats", "s.json"})).code, 0);
}

TEST_F(CommandOutputs, NoOutputReplacesAnInput) {
  ASSERT_EQ(run({"render", "scene.xml", "-o", "wood.png", "--quiet"}).code, 0);
  write("more.xml", R"(<scene version="3.0.0"><shape type="cube"><bsdf type="diffuse"><texture type="bitmap"
      name="reflectance"><string name="filename" value="wood.png"/></texture></bsdf></shape></scene>)");
  std::string scene = k_small_scene;
  scene.insert(scene.find("<shape"), "<include filename=\"more.xml\"/>");
  write("all.xml", scene);
  // Four balls of enough triangles for fields.
  std::string many = k_small_scene;
  const size_t ball = many.find("<shape type=\"ply\"");
  const std::string more_balls = many.substr(ball, many.find("</shape>", ball) + 8 - ball);
  for (int i = 2; i <= 4; ++i) {
    const std::string name = "ball" + std::to_string(i) + ".ply";
    fs::copy_file(folder_ / "ball.ply", folder_ / name);
    std::string other = more_balls;
    other.replace(other.find("ball.ply"), 8, name);
    many.insert(ball, other);
  }
  write("many.xml", many);
  ASSERT_EQ(run({"mesh", "sphere", "-o", "bunny.ply"}).code, 0);

  // The output `link` is a link to the input, or the input itself under another name.
  struct Case {
    std::string output, link, input;
    std::vector<std::string> command;
    const char* program = FIELDTRACE_PROGRAM;
    int code = 2;
  };
  const std::vector<std::string> render = {"render", "all.xml", "--quiet"}, render_to = {"-o", "a.exr", "--stats"},
                                 demo = {"all.xml", "-o", "demo", "--reference-spp", "1"},
                                 thesis = {"thesis", "--quick", "--bunny", "bunny.ply", "-o", "thesis"},
                                 small = {"--directions", "32", "--plane", "64"};
  const auto joined = [](std::vector<std::string> a, const std::vector<std::string>& b) {
    a.insert(a.end(), b.begin(), b.end());
    return a;
  };
  std::vector<Case> cases = {
      {"-o wood.png", "", "wood.png", joined(render, {"-o", "wood.png"})},
      {"-o f.vdb", "f.vdb", "scene.xml", joined({"bake", "scene.xml", "-o", "f.vdb"}, small)},
      {"-o f.vdb", "f.vdb", "ball.ply", joined({"bake", "scene.xml", "-o", "f.vdb", "--full"}, small)},
      {"-o f.vdb", "f.vdb", "more.xml", joined({"bake", "all.xml", "-o", "f.vdb"}, small)},
      {"-o f.3.vdb", "f.3.vdb", "many.xml", joined({"bake", "many.xml", "-o", "f.vdb"}, small)},
      {"-o f.4.vdb", "f.4.vdb", "ball3.ply", joined({"bake", "many.xml", "-o", "f.vdb", "--full"}, small)},
      {"-o f.vdb", "f.vdb", "ball.ply", joined({"bake", "ball.ply", "-o", "f.vdb", "--full"}, small)},
      {"-o f.vdb", "f.vdb", "ball.ply", {"bake", "ball.ply", "-o", "f.vdb", "--chart", "thesis", "--directions", "32"}},
      {"-o tradeoff/reference.exr",
       "tradeoff/reference.exr",
       "more.xml",
       {"tradeoff", "all.xml", "--quick", "--quiet", "-o", "tradeoff"}},
      {"-o tradeoff/tradeoff.csv",
       "tradeoff/tradeoff.csv",
       "all.xml",
       {"tradeoff", "all.xml", "--quick", "--quiet", "-o", "tradeoff"}},
  };
  for (const char* name : {"tradeoff.html", "bias.csv", "tradeoff.csv.partial"}) {
    const std::string path = std::string("tradeoff/") + name;
    cases.push_back({"-o " + path, path, "ball.ply", {"tradeoff", "all.xml", "--quick", "--quiet", "-o", "tradeoff"}});
  }
  for (const char* input : {"all.xml", "more.xml", "ball.ply"}) {
    cases.push_back({std::string("--stats ") + input, "", input, joined(joined(render, render_to), {input})});
  }
  for (const char* name : {"thesis.csv", "growth.csv", "charts.csv", "hybrid.csv", "thesis.html"}) {
    const std::string path = std::string("thesis/") + name;
    cases.push_back({"-o " + path, path, "bunny.ply", thesis});
  }
  for (const char* name : {"demo.csv", "reference.png", "montecarlo-4.exr", "hybrid-64.png"}) {
    const std::string path = std::string("demo/") + name;
    cases.push_back({"-o " + path, path, "ball.ply", demo, FIELDTRACE_DEMO, 1});
  }
  for (const char* name : {"tradeoff", "thesis", "demo"}) fs::create_directory(folder_ / name);
  for (const Case& c : cases) {
    for (const bool hard : {false, true}) {
      if (!c.link.empty()) fs::remove(folder_ / c.link);
      if (!c.link.empty() && hard) fs::create_hard_link(folder_ / c.input, folder_ / c.link);
      if (!c.link.empty() && !hard) fs::create_symlink(folder_ / c.input, folder_ / c.link);
      const std::string before = read_text(folder_ / c.input);
      const std::set<std::string> files_before = files();
      const Outcome o = Program(folder_.path(), c.command, c.program).wait();
      EXPECT_EQ(o.code, c.code) << c.command[0] << " " << c.output;
      EXPECT_NE(o.err.find(c.output + ": would overwrite the input"), std::string::npos) << c.output << ": " << o.err;
      EXPECT_TRUE(read_text(folder_ / c.input) == before) << c.command[0] << " " << c.output << ": " << c.input;
      EXPECT_EQ(files(), files_before);
    }
    if (!c.link.empty()) fs::remove(folder_ / c.link);
  }
  // A field is no input, and the fifth of four balls is none either.
  fs::create_symlink("many.xml", folder_ / "f.5.vdb");
  for (int i = 0; i < 2; ++i) {
    EXPECT_EQ(run(joined({"bake", "many.xml", "-o", "f.vdb"}, small)).code, 0);
  }
  EXPECT_EQ(read_text(folder_ / "many.xml"), many);
  EXPECT_EQ(run(joined(render, {"-o", "a.png"})).code, 0);
}

TEST_F(CommandOutputs, NamesMayBeAsLongAsTheFileSystemAllows) {
  for (const size_t length : {size_t(244), size_t(255)}) {
    const auto name = [&](const std::string& ending) { return std::string(length - ending.size(), 'n') + ending; };
    EXPECT_EQ(run({"render", "scene.xml", "-o", name(".png"), "-o", name(".exr"), "--stats", name(".json")}).code, 0);
    EXPECT_EQ(run({"mesh", "cube", "-o", name(".ply")}).code, 0);
    for (const char* ending : {".png", ".exr", ".json", ".ply"}) {
      EXPECT_TRUE(fs::exists(folder_ / name(ending)));
      fs::remove(folder_ / name(ending));
    }
  }
  // Cut in the middle of a two-byte character, the temporary name would not be valid UTF-8.
  std::string umlauts;
  while (umlauts.size() < 250) umlauts += "\u00e4";
  EXPECT_EQ(run({"render", "scene.xml", "-o", umlauts + ".png", "--quiet"}).code, 0);
  fs::remove(folder_ / (umlauts + ".png"));
  // Reported before the scene, which does not exist, is read.
  expect_failure(1, "File name too long", {"render", "missing.xml", "-o", std::string(252, 'n') + ".png"});
}

TEST_F(CommandOutputs, ComparingTwoSizesNamesBothFiles) {
  ASSERT_EQ(run({"render", "scene.xml", "-o", "a.exr", "--quiet"}).code, 0);
  ASSERT_EQ(run({"render", "scene.xml", "-o", "b.exr", "--quiet", "-D", "size=40"}).code, 0);
  expect_failure(1, "a.exr: cannot be compared with b.exr: the image is 32x24", {"compare", "a.exr", "b.exr"});
}

// ---- read-only caches

// Root may write anywhere unless it drops this capability.
void respect_permissions() {
  prctl(PR_CAPBSET_DROP, CAP_DAC_OVERRIDE);
  prctl(PR_CAPBSET_DROP, CAP_DAC_READ_SEARCH);
}

class ReadOnlyCache : public CommandFiles {
 protected:
  void SetUp() override {
    CommandFiles::SetUp();
    ASSERT_EQ(run(render("a.exr")).code, 0);
    fs::permissions(folder_ / "cache", fs::perms::owner_read | fs::perms::owner_exec);
  }
  void TearDown() override { fs::permissions(folder_ / "cache", fs::perms::owner_all); }
  static std::vector<std::string> render(const std::string& output, const std::vector<std::string>& more = {}) {
    std::vector<std::string> all = {"render", "scene.xml",     "-o",   output,    "--quiet", "--light-samples",
                                    "16",     "--directions",  "32",   "--plane", "64",      "--stats",
                                    "s.json", "--field-cache", "cache"};
    all.insert(all.end(), more.begin(), more.end());
    return all;
  }
};

TEST_F(ReadOnlyCache, IsReadWithOneWarning) {
  ASSERT_GE(files().size(), 6u) << "nothing was cached";
  const std::set<std::string> before = files();
  const Outcome o = run(render("a.exr"), respect_permissions);
  EXPECT_EQ(o.code, 0) << o.err;
  EXPECT_EQ(o.err.rfind("fieldtrace: warning: cache: cannot be written: Permission denied", 0), 0u) << o.err;
  EXPECT_NE(o.err.find("none is kept"), std::string::npos) << o.err;
  EXPECT_EQ(std::count(o.err.begin(), o.err.end(), '\n'), 1) << o.err;
  EXPECT_NE(read_text(folder_ / "s.json").find("\"rays\": 0"), std::string::npos) << "fields were baked again";
  EXPECT_EQ(files(), before);
  // Fields that the cache lacks are baked and not kept.
  EXPECT_EQ(run(render("a.exr", {"--lobe-samples", "2"}), respect_permissions).code, 0);
  EXPECT_EQ(files(), before);
}

TEST_F(ReadOnlyCache, IsNoPlaceToBakeInto) {
  expect_failure(1, "cache: cannot be written: Permission denied",
                 {"bake", "ball.ply", "-o", "cache", "--chart", "thesis", "--directions", "32"}, respect_permissions);
}

TEST_F(ReadOnlyCache, IsToldAboutOnceThoughTheRenderBeginsAgain) {
  // One light sample a pixel, and fine cells: single rays want many.
  const Outcome o = run({"render", "scene.xml", "-o", "a.exr", "--quiet", "--directions", "128", "--plane", "512",
                         "--tolerance", "1", "--field-cache", "cache", "--field-memory", "1", "-D", "size=400"},
                        respect_permissions);
  EXPECT_EQ(o.code, 0) << o.err;
  EXPECT_NE(o.err.find("begins again"), std::string::npos) << o.err;
  const size_t first = o.err.find("none is kept");
  ASSERT_NE(first, std::string::npos) << o.err;
  EXPECT_EQ(o.err.find("none is kept", first + 1), std::string::npos) << o.err;
}

}  // namespace
}  // namespace fieldtrace::test
