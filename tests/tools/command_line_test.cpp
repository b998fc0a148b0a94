// Runs the built program: exit codes, messages, files.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>

#include "core/image/image.h"
#include "hybrid/path/aovs.h"
#include "tests/support/program.h"
#include "tests/support/waiting.h"
#include "tools/cli/options.h"

namespace fieldtrace {
namespace {

namespace fs = std::filesystem;
using test::comes_true;
using test::Outcome;
using test::Program;
using test::read_text;

// A ball on a floor under a small light.
const char* const k_scene = R"(<scene version="3.0.0">
  <default name="size" value="32"/>
  <integrator type="path"><integer name="max_depth" value="2"/></integrator>
  <sensor type="perspective">
    <transform name="to_world"><lookat origin="0, 4, 3" target="0, 0, 0" up="0, 0, 1"/></transform>
    <sampler type="independent"><integer name="sample_count" value="2"/></sampler>
    <film type="hdrfilm">
      <integer name="width" value="$size"/><integer name="height" value="24"/><rfilter type="box"/>
    </film>
  </sensor>
  <shape type="rectangle"><transform name="to_world"><scale value="5"/></transform></shape>
  <shape type="sphere"><point name="center" x="0" y="0" z="0.6"/><float name="radius" value="0.5"/></shape>
  <shape type="sphere"><point name="center" x="1" y="1" z="3"/><float name="radius" value="0.2"/>
    <emitter type="area"><rgb name="radiance" value="40"/></emitter></shape>
</scene>
)";

class CommandLine : public testing::Test {
 protected:
  void SetUp() override {
    const auto* info = testing::UnitTest::GetInstance()->current_test_info();
    folder_ = fs::temp_directory_path() /
              (std::string("fieldtrace_command_") + info->name() + "_" + std::to_string(getpid()));
    fs::remove_all(folder_);
    fs::create_directories(folder_);
    std::ofstream(folder_ / "scene.xml") << k_scene;
  }
  void TearDown() override { fs::remove_all(folder_); }

  Outcome run(const std::vector<std::string>& arguments) { return Program(folder_, arguments).wait(); }

  // Runs the program and expects a failure: this exit code, one line "fieldtrace: ..." that contains `part`, and no new
  // file.
  void expect_failure(int code, const std::string& part, const std::vector<std::string>& arguments) {
    std::string typed;
    for (const std::string& a : arguments) typed += a + " ";
    SCOPED_TRACE(typed);
    const std::set<std::string> before = files();
    const Outcome o = run(arguments);
    EXPECT_EQ(o.code, code) << o.err;
    EXPECT_EQ(o.err.rfind("fieldtrace: ", 0), 0u) << o.err;
    EXPECT_NE(o.err.find(part), std::string::npos) << o.err;
    EXPECT_EQ(std::count(o.err.begin(), o.err.end(), '\n'), 1) << o.err;
    if (code == 2) {
      EXPECT_NE(o.err.find("--help`"), std::string::npos) << o.err;
    }
    EXPECT_EQ(files(), before);
  }

  // Names of the files, without those that capture the program's output.
  std::set<std::string> files() const {
    std::set<std::string> names;
    for (const fs::directory_entry& e : fs::recursive_directory_iterator(folder_)) {
      const std::string name = fs::relative(e.path(), folder_).string();
      if (name[0] != '.') names.insert(name);
    }
    return names;
  }

  fs::path folder_;
};

TEST_F(CommandLine, HelpAndVersionSucceed) {
  EXPECT_EQ(run({"--version"}).code, 0);
  EXPECT_EQ(run({"--version"}).out.rfind("fieldtrace ", 0), 0u);
  const Outcome help = run({"--help"});
  EXPECT_EQ(help.code, 0);
  for (const char* command : {"render", "bake", "mesh", "info", "compare", "tradeoff", "thesis"}) {
    EXPECT_NE(help.out.find(command), std::string::npos) << command;
  }
  EXPECT_EQ(run({"mesh", "knot", "--help"}).code, 0);
}

TEST_F(CommandLine, WrongUseExitsWith2AndPointsToHelp) {
  expect_failure(2, "subcommand", {});
  expect_failure(2, "'frobnicate'", {"frobnicate"});
  expect_failure(2, "render --help", {"render"});
  expect_failure(2, "-o", {"render", "scene.xml"});
  expect_failure(2, "--frobnicate", {"render", "scene.xml", "-o", "a.exr", "--frobnicate"});
  expect_failure(2, "'teapot'", {"mesh", "teapot", "-o", "a.ply"});
}

// Parses `arguments` in this process as the render command does; returns the error message, or an empty string.
std::string complaint(const std::vector<std::string>& arguments, RenderOptions& options) {
  CLI::App app;
  add_render_options(app, options);
  try {
    app.parse(std::vector<std::string>(arguments.rbegin(), arguments.rend()));
  } catch (const CLI::ParseError& e) {
    return e.what();
  } catch (const UsageError& e) {
    return e.what();
  }
  return {};
}

TEST(RenderOptionsText, ValuesOutOfRangeNameTheOption) {
  const std::vector<std::pair<std::string, std::vector<std::string>>> bad = {
      {"--spp", {"0", "-1", "1.5", "x", "", "99999999999"}},
      {"--light-samples", {"0", "65537"}},
      {"--lobe-samples", {"0", "4097"}},
      {"--seed", {"-1", "4294967296"}},
      {"--tolerance", {"nan", "-0.1", "1.0001", "inf", "0.1x"}},
      {"--directions", {"0", "48", "512"}},
      {"--plane", {"32", "1024"}},
      {"--threads", {"-1"}},
      {"--isa", {"mmx"}},
      {"--method", {"bidirectional"}},
      {"--device", {"toaster", ""}},
      {"--chart", {"pie"}},
      {"--max-depth", {"-2"}},
      {"--aov", {"beauty", "depth,beauty"}},
      {"--field-hits", {"sometimes"}},
      {"--field-memory", {"0", "-1", "1.5", "1e3", "1000000000001"}},
      {"--device-memory", {"0", "-1", "1.5", "1e3", "1000000000001"}},
      {"--field-cache-limit", {"0", "x"}},
      {"--ao-distance", {"0", "-1", "nan", "1e-60", "1x", ""}},
  };
  for (const auto& [option, values] : bad) {
    for (const std::string& value : values) {
      RenderOptions options;
      EXPECT_NE(complaint({option, value}, options).find(option), std::string::npos) << option << " " << value;
    }
  }
}

TEST(RenderOptionsText, ValuesInRangeArrive) {
  RenderOptions o;
  EXPECT_EQ(complaint({"--spp", "9", "--light-samples", "2", "--lobe-samples", "3", "--seed", "4294967295"}, o), "");
  EXPECT_EQ(o.spp, 9);
  EXPECT_EQ(o.light_samples, 2);
  EXPECT_EQ(o.lobe_samples, 3);
  EXPECT_EQ(o.seed, 4294967295u);
  EXPECT_EQ(complaint({"--tolerance", "0.25", "--directions", "128", "--plane", "512", "--field-cache", "c"}, o), "");
  EXPECT_EQ(o.tolerance, 0.25f);
  EXPECT_EQ(o.directions, 128);
  EXPECT_EQ(o.plane, 512);
  EXPECT_EQ(o.field_cache, "c");
  EXPECT_EQ(o.field_memory, 0u);
  EXPECT_EQ(complaint({"--field-memory", "1500", "--field-cache", "c", "--field-cache-limit", "20"}, o), "");
  EXPECT_EQ(o.field_memory, 1500000000u);
  EXPECT_EQ(o.field_cache_limit, 20000000u);
  RenderOptions no_cache;
  EXPECT_NE(complaint({"--field-cache-limit", "20"}, no_cache).find("--field-cache"), std::string::npos);
  EXPECT_EQ(complaint({"--threads", "3", "--isa", "avx2", "--method", "montecarlo", "--check"}, o), "");
  EXPECT_EQ(o.threads, 3);
  EXPECT_EQ(o.isa, Isa::avx2);
  EXPECT_EQ(o.method, Method::monte_carlo);
  EXPECT_TRUE(o.check);
  EXPECT_EQ(complaint({"--max-depth", "-1", "--device", "cpu", "--chart", "orthographic", "--aov", "depth,normal"}, o),
            "");
  EXPECT_EQ(o.max_depth, -1);
  EXPECT_EQ(o.device, "cpu");
  EXPECT_EQ(o.device_memory, 0u);
  EXPECT_EQ(complaint({"--device-memory", "12"}, o), "");
  EXPECT_EQ(o.device_memory, 12000000u);
  EXPECT_EQ(o.chart, Chart::orthographic);
  EXPECT_EQ(complaint({"--chart", "thesis"}, o), "");
  EXPECT_EQ(o.chart, Chart::thesis);
  EXPECT_EQ(o.aovs, (std::vector<std::string>{"depth", "normal"}));
  EXPECT_EQ(o.ao_distance, k_infinity);
  for (const std::string& name : aov_names()) EXPECT_EQ(complaint({"--aov", name}, o), "");
  EXPECT_EQ(complaint({"--field-hits", "never"}, o), "");
  EXPECT_EQ(o.field_hits, FieldHits::never);
  EXPECT_EQ(complaint({"--aov", "ao", "--ao-distance", "2.5"}, o), "");
  EXPECT_EQ(o.ao_distance, 2.5f);
  EXPECT_EQ(complaint({"--ao-distance", "inf"}, o), "");
  EXPECT_EQ(o.ao_distance, k_infinity);
}

TEST_F(CommandLine, ValuesOutOfRangeExitWith2) {
  const auto render = [](const char* option, const char* value) {
    return std::vector<std::string>{"render", "scene.xml", "-o", "a.exr", option, value};
  };
  expect_failure(2, "--spp", render("--spp", "0"));
  expect_failure(2, "--tolerance", render("--tolerance", "nan"));
  expect_failure(2, "--exposure", render("--exposure", "nan"));
  expect_failure(2, "-D", render("-D", "size"));
  expect_failure(2, "--fail-above", {"compare", "a.exr", "b.exr", "--fail-above", "nan"});
  expect_failure(2, "--chart thesis",
                 {"render", "scene.xml", "-o", "a.exr", "--chart", "thesis", "--light-estimator", "adaptive"});
  expect_failure(2, "--p and --q have a common factor", {"mesh", "knot", "-o", "a.ply", "--p", "2", "--q", "4"});
  expect_failure(2, "--n1-lat is 0", {"mesh", "supershape", "-o", "a.ply", "--n1-lat", "0"});
  expect_failure(2, "--hole-radius is 70", {"mesh", "holes", "-o", "a.ply", "--hole-radius", "70"});
  expect_failure(2, ".ply", {"mesh", "knot", "-o", "a.obj"});
}

TEST_F(CommandLine, ErrorsTimesAndCheckpointsAreChecked) {
  const auto render = [](std::vector<std::string> options) {
    options.insert(options.begin(), {"render", "scene.xml", "-o", "a.exr"});
    return options;
  };
  for (const char* option : {"--time-limit", "--target-error", "--target-error-relative"}) {
    for (const char* value : {"0", "-1", "nan", "x", "1e-60"}) expect_failure(2, option, render({option, value}));
  }
  expect_failure(2, "--target-error", render({"--target-error", "1", "--target-error-relative", "1"}));
  expect_failure(2, "--checkpoint", render({"--checkpoint-every", "5"}));
  expect_failure(2, "--checkpoint-every", render({"--checkpoint", "c", "--checkpoint-every", "-5"}));
  expect_failure(1, "cannot be written", render({"--checkpoint", "none/c"}));
}

TEST_F(CommandLine, DevicesAreListed) {
  const Outcome devices = run({"info", "--devices"});
  EXPECT_EQ(devices.code, 0) << devices.err;
  EXPECT_EQ(devices.out.rfind("cpu        ", 0), 0u) << devices.out;
  expect_failure(2, "file is required", {"info"});
  expect_failure(2, "--devices", {"info", "scene.xml", "--devices"});
  expect_failure(2, "--json", {"info", "--devices", "--json"});
  expect_failure(2, "toaster", {"render", "scene.xml", "-o", "a.exr", "--device", "toaster"});
}

TEST_F(CommandLine, BadInputExitsWith1AndNamesTheFile) {
  expect_failure(1, "missing.xml", {"render", "missing.xml", "-o", "a.exr", "--quiet"});
  std::ofstream(folder_ / "broken.xml") << "<scene version=\"3.0.0\">\n<shape\n";
  expect_failure(1, "broken.xml:", {"render", "broken.xml", "-o", "a.exr", "--quiet"});
  expect_failure(1, "missing.ply", {"info", "missing.ply"});
  expect_failure(1, "missing.exr", {"compare", "missing.exr", "missing.exr"});
}

TEST_F(CommandLine, UnwritableOutputsFailBeforeTheSceneIsRead) {
  // The scene does not exist either; the output is named because it is checked first.
  expect_failure(1, "no/a.exr", {"render", "missing.xml", "-o", "no/a.exr"});
  expect_failure(1, "no/s.json", {"render", "missing.xml", "-o", "a.exr", "--stats", "no/s.json"});
  expect_failure(1, ".exr or .png", {"render", "missing.xml", "-o", "a.jpg"});
  expect_failure(1, "no/a.ply", {"mesh", "cube", "-o", "no/a.ply"});
}

TEST(Crop, LiesInsideTheFilmOrIsRefused) {
  Film film;
  film.width = 32;
  film.height = 24;
  film.crop = {4, 0, 28, 24};
  for (const char* crop : {"4,0,29,24", "5,0,28,24", "3,0,8,8", "4,-1,8,8", "4,0,0,8", "4,0,8", "4,0,8,8,8", "a,0,8,8",
                           "", ",,,", "4,0,8,8x", "2147483647,0,2147483647,8"}) {
    EXPECT_THROW(parse_crop(crop, film.crop, "film"), UsageError) << crop;
  }
  const Rect crop = parse_crop("4,2,28,22", film.crop, "film");
  EXPECT_EQ(crop.x, 4);
  EXPECT_EQ(crop.y, 2);
  EXPECT_EQ(crop.width, 28);
  EXPECT_EQ(crop.height, 22);
}

TEST_F(CommandLine, CropMustLieInsideTheFilm) {
  const auto with_crop = [](const char* crop) {
    return std::vector<std::string>{"render", "scene.xml", "-o", "a.exr", "--crop", crop};
  };
  expect_failure(2, "--crop", with_crop("1,0,32,24"));
  EXPECT_EQ(run(with_crop("4,2,8,6")).code, 0);
  const Image image = read_image((folder_ / "a.exr").string());
  EXPECT_EQ(image.width, 8);
  EXPECT_EQ(image.height, 6);
}

TEST_F(CommandLine, RenderWritesImagesAndStatistics) {
  const Outcome o = run({"render", "scene.xml", "-o", "a.exr", "-o", "a.png", "--stats", "s.json", "--spp", "3",
                         "--seed", "7", "-D", "size=40"});
  ASSERT_EQ(o.code, 0) << o.err;
  EXPECT_EQ(files(), (std::set<std::string>{"a.exr", "a.png", "s.json", "scene.xml"}));
  EXPECT_EQ(o.out, "");
  EXPECT_NE(o.err.find("40x24"), std::string::npos) << o.err;
  EXPECT_EQ(o.err.find('\r'), std::string::npos);  // no progress line without a terminal
  EXPECT_EQ(read_image((folder_ / "a.png").string()).width, 40);
  EXPECT_EQ(read_image((folder_ / "a.exr").string()).width, 40);
  const std::string exr = read_text(folder_ / "a.exr");
  EXPECT_NE(exr.find("fieldtrace render scene.xml -o a.exr"), std::string::npos);
  for (const char* key : {"fieldtrace:seed", "fieldtrace:spp", "fieldtrace:version"}) {
    EXPECT_NE(exr.find(key), std::string::npos) << key;
  }
  const auto stats = nlohmann::json::parse(read_text(folder_ / "s.json"));
  EXPECT_EQ(stats["spp"], 3);
  EXPECT_EQ(stats["seed"], 7);
  EXPECT_EQ(stats["width"], 40);
  EXPECT_GT(stats["time"]["total"].get<double>(), 0.0);
  EXPECT_GT(stats["time"]["load"].get<double>(), 0.0);
  EXPECT_GT(stats["memory"]["peak_bytes"].get<double>(), 1e6);
  EXPECT_NE(stats["version"], "");
}

TEST_F(CommandLine, QuietPrintsNothing) {
  const Outcome o = run({"render", "scene.xml", "-o", "a.exr", "--quiet"});
  EXPECT_EQ(o.code, 0);
  EXPECT_EQ(o.err, "");
  EXPECT_EQ(o.out, "");
}

TEST_F(CommandLine, CompareMeasuresAndJudges) {
  ASSERT_EQ(run({"render", "scene.xml", "-o", "a.exr", "--method", "montecarlo", "--quiet"}).code, 0);
  ASSERT_EQ(run({"render", "scene.xml", "-o", "b.exr", "--method", "montecarlo", "--quiet", "--seed", "5"}).code, 0);
  EXPECT_EQ(run({"compare", "a.exr", "a.exr", "--fail-above", "0"}).code, 0);
  const auto j = nlohmann::json::parse(run({"compare", "b.exr", "a.exr", "--json"}).out);
  EXPECT_GT(j["rmse"].get<double>(), 0.0);
  for (const char* key : {"relmse", "psnr", "mean_relative", "worst_block"}) EXPECT_TRUE(j.contains(key)) << key;
  for (const char* key : {"flip", "hdr_flip"}) {
    EXPECT_GT(j[key].get<double>(), 0.0) << key;
    EXPECT_LT(j[key].get<double>(), 1.0) << key;
  }
  EXPECT_NE(run({"compare", "a.exr", "a.exr"}).out.find("\nflip           0\nhdr flip       0\n"), std::string::npos);
  expect_failure(1, "above the limit", {"compare", "b.exr", "a.exr", "--fail-above", "0"});
  ASSERT_EQ(run({"render", "scene.xml", "-o", "c.exr", "--quiet", "--crop", "0,0,8,8"}).code, 0);
  expect_failure(1, "one size", {"compare", "c.exr", "a.exr"});
  const auto part = nlohmann::json::parse(run({"compare", "b.exr", "a.exr", "--json", "--crop", "3,5,8,9"}).out);
  EXPECT_NE(part["rmse"], j["rmse"]);
  EXPECT_EQ(part["worst_block"]["x"], 3);
  EXPECT_EQ(part["worst_block"]["y"], 5);
  const auto same = nlohmann::json::parse(run({"compare", "a.exr", "a.exr", "--json", "--crop", "3,5,8,9"}).out);
  EXPECT_EQ(same["worst_block"]["rmse"], 0.0);
  EXPECT_EQ(same["worst_block"]["x"], 3);
  EXPECT_EQ(same["worst_block"]["y"], 5);
  expect_failure(2, "not inside the image", {"compare", "b.exr", "a.exr", "--crop", "0,0,1000,1"});
  expect_failure(2, "four whole numbers", {"compare", "b.exr", "a.exr", "--crop", ""});
}

TEST_F(CommandLine, CompareLooksAtOneLayer) {
  for (const char* seed : {"0", "5"}) {
    const std::string file = std::string("layers") + seed + ".exr";
    ASSERT_EQ(run({"render", "scene.xml", "-o", file, "--aov", "ao,depth", "--seed", seed, "--quiet"}).code, 0);
  }
  const auto difference = [&](const char* layer) {
    return nlohmann::json::parse(run({"compare", "layers0.exr", "layers5.exr", "--json", "--layer", layer}).out);
  };
  EXPECT_GT(difference("ao")["rmse"].get<double>(), 0.0);
  EXPECT_NE(difference("ao")["rmse"], difference("depth")["rmse"]);
  EXPECT_TRUE(difference("ao")["flip"].is_null());
  expect_failure(1, "has no layer a", {"compare", "layers0.exr", "layers5.exr", "--layer", "a"});
  // At once: the images need not be there.
  for (const char* named : {"--layer", "--report"})
    expect_failure(2, named, {"compare", "missing.exr", "missing.exr", "--layer", "ao", "--report", "page.html"});
}

TEST_F(CommandLine, MeshesAreWrittenAndDescribed) {
  for (const char* kind : {"supershape", "hyperboloid", "knot", "plane", "cube"}) {
    EXPECT_EQ(run({"mesh", kind, "-o", std::string(kind) + ".ply"}).code, 0) << kind;
  }
  EXPECT_NE(run({"info", "supershape.ply"}).out.find("triangles  16128"), std::string::npos);
  ASSERT_EQ(run({"mesh", "sphere", "--around", "8", "--along", "4", "-o", "s.ply"}).code, 0);
  EXPECT_NE(run({"info", "s.ply"}).out.find("triangles  48"), std::string::npos);
  EXPECT_NE(run({"info", "scene.xml"}).out.find("32x24"), std::string::npos);
}

// Also with leading zeros, which CLI11 would read as octal.
TEST_F(CommandLine, WholeNumbersAreDecimal) {
  const Outcome o = run({"render", "scene.xml", "-o", "a.exr", "--spp", "010", "--seed", "0019", "--threads", "02",
                         "--stats", "s.json", "--quiet"});
  ASSERT_EQ(o.code, 0) << o.err;
  const auto stats = nlohmann::json::parse(read_text(folder_ / "s.json"));
  EXPECT_EQ(stats["spp"], 10);
  EXPECT_EQ(stats["seed"], 19);
  EXPECT_EQ(stats["threads"], 2);
  ASSERT_EQ(run({"mesh", "sphere", "--around", "010", "--along", "08", "-o", "s.ply"}).code, 0);
  EXPECT_NE(run({"info", "s.ply"}).out.find("triangles  140"), std::string::npos);
  expect_failure(2, "'0x10' is not a whole number", {"mesh", "sphere", "--around", "0x10", "-o", "t.ply"});
}

TEST_F(CommandLine, EmptyValuesAreRefused) {
  for (const char* option : {"--resume", "--checkpoint", "--stats", "--crop", "--field-cache"})
    expect_failure(2, "it is empty", {"render", "scene.xml", "-o", "a.exr", option, ""});
  for (const char* option : {"--target-error", "--target-error-relative", "--time-limit"}) {
    for (const char* value : {"inf", "1e10", "nan", "0"})
      expect_failure(2, "not a number greater than 0", {"render", "scene.xml", "-o", "a.exr", option, value});
  }
}

TEST_F(CommandLine, StatisticsTellTheLimitThatWasGiven) {
  ASSERT_EQ(run({"render", "scene.xml", "-o", "a.exr", "--time-limit", "60", "--spp", "2", "--stats", "s.json"}).code,
            0);
  EXPECT_EQ(nlohmann::json::parse(read_text(folder_ / "s.json"))["time_limit"], 60);
}

// A viewer that is not there makes a warning, which goes nowhere: neither to a full disk nor to a reader that has gone.
TEST_F(CommandLine, APictureDoesNotFailForItsMessages) {
  const std::vector<std::string> render = {"render", "scene.xml", "-o", "a.exr", "--tev", "127.0.0.1:1"};
  const auto to_full_device = [] { dup2(open("/dev/full", O_WRONLY), STDERR_FILENO); };
  const auto to_nobody = [] {
    int ends[2];
    if (pipe(ends) != 0) return;
    close(ends[0]);
    dup2(ends[1], STDERR_FILENO);
  };
  for (const std::function<void()>& prepare :
       {std::function<void()>(to_full_device), std::function<void()>(to_nobody)}) {
    EXPECT_EQ(Program(folder_, render, FIELDTRACE_PROGRAM, prepare).wait().code, 0);
    EXPECT_EQ(read_image((folder_ / "a.exr").string()).width, 32);
    fs::remove(folder_ / "a.exr");
  }
}

TEST_F(CommandLine, InterruptWritesTheFinishedTiles) {
  // Many tiles, each well under a second but many seconds in total: the render stops after the tiles in progress.
  Program program(folder_, {"render", "scene.xml", "-o", "a.exr", "--spp", "8192", "-D", "size=512", "--quiet",
                            "--checkpoint", "kept", "--checkpoint-every", "0"});
  ASSERT_TRUE(comes_true([&] { return fs::exists(folder_ / "kept"); }));
  ASSERT_TRUE(program.interrupt());
  const Outcome o = program.wait();
  EXPECT_EQ(o.code, 130) << o.err;
  EXPECT_NE(o.err.find("interrupted"), std::string::npos) << o.err;
  EXPECT_EQ(files(), (std::set<std::string>{"a.exr", "kept", "scene.xml"}));
  EXPECT_EQ(read_image((folder_ / "a.exr").string()).width, 512);
}

TEST_F(CommandLine, AnInterruptedMeshIsNotWritten) {
  Program program(folder_, {"mesh", "knot", "--along", "20000", "--around", "250", "-o", "a.ply"});
  ASSERT_TRUE(program.interrupt());
  const Outcome o = program.wait();
  EXPECT_EQ(o.code, 130) << o.err;
  EXPECT_EQ(o.err, "fieldtrace: interrupted; a.ply was not written\n");
  EXPECT_EQ(files(), std::set<std::string>{"scene.xml"});
}

TEST_F(CommandLine, ATradeoffInterruptedBeforeItsReferenceLeavesThingsAsTheyWere) {
  const auto interrupted = [&] {
    // 512 x 24 pixels with a reference of 4096 samples: long enough to be interrupted.
    Program program(folder_, {"tradeoff", "scene.xml", "-o", "out", "-D", "size=512", "--quiet"});
    ASSERT_TRUE(program.interrupt());
    const Outcome o = program.wait();
    EXPECT_EQ(o.code, 130) << o.err;
    EXPECT_EQ(o.err, "fieldtrace: interrupted; nothing was written: the reference was not finished\n");
  };
  interrupted();
  EXPECT_EQ(files(), (std::set<std::string>{"out", "scene.xml"}));
  EXPECT_TRUE(fs::is_empty(folder_ / "out"));
  // Rows of an earlier run, too.
  std::ofstream(folder_ / "out/tradeoff.csv.partial") << "older\n";
  interrupted();
  EXPECT_EQ(files(), (std::set<std::string>{"out", "out/tradeoff.csv.partial", "scene.xml"}));
  EXPECT_EQ(read_text(folder_ / "out/tradeoff.csv.partial"), "older\n");
}

// Whether a trade-off's table has a row.
bool has_row(const fs::path& table) {
  const std::string text = read_text(table);
  return std::count(text.begin(), text.end(), '\n') >= 2;
}

TEST_F(CommandLine, ATradeoffThatEndsEarlyKeepsItsReferenceAndItsRows) {
  const fs::path out = folder_ / "out";
  for (const bool killed : {false, true}) {
    fs::remove_all(out);
    fs::create_directory(out);
    std::ofstream(out / "tradeoff.csv.partial") << "older";
    Program program(folder_, {"tradeoff", "scene.xml", "-o", "out", "-D", "size=2048", "--quick", "--quiet"});
    ASSERT_TRUE(comes_true([&] { return has_row(out / "tradeoff.csv.partial"); }, /*seconds=*/60));
    if (killed) {
      program.kill_now();
    } else {
      ASSERT_TRUE(program.interrupt());
    }
    const Outcome o = program.wait();
    EXPECT_EQ(o.code, killed ? 128 + SIGKILL : 130) << o.err;
    if (!killed) {
      EXPECT_EQ(o.err, "fieldtrace: interrupted; the rows so far are in out/tradeoff.csv.partial\n");
    }
    EXPECT_FALSE(fs::exists(out / "tradeoff.csv"));
    EXPECT_EQ(read_text(out / "tradeoff.csv.partial").rfind("method,spp,", 0), 0u);
    ASSERT_TRUE(fs::exists(out / "reference.exr"));
    EXPECT_EQ(read_image((out / "reference.exr").string()).width, 2048);
  }
}

}  // namespace
}  // namespace fieldtrace
