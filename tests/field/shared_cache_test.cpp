// Renders of several processes that share one field cache at the same time.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "core/image/image.h"
#include "tests/support/field_checks.h"
#include "tests/support/program.h"

namespace fieldtrace::test {
namespace {

namespace fs = std::filesystem;

// Two meshes on a floor under a lamp at a given place: another place demands other cells.
const char* const k_scene = R"(<scene version="3.0.0">
  <default name="lamp" value="1"/>
  <integrator type="path"><integer name="max_depth" value="2"/></integrator>
  <sensor type="perspective">
    <transform name="to_world"><lookat origin="0, 5, 4" target="0, 0, 0.5" up="0, 0, 1"/></transform>
    <sampler type="independent"><integer name="sample_count" value="1"/></sampler>
    <film type="hdrfilm">
      <integer name="width" value="48"/><integer name="height" value="32"/><rfilter type="box"/>
    </film>
  </sensor>
  <shape type="rectangle"><transform name="to_world"><scale value="5"/></transform></shape>
  <shape type="ply"><string name="filename" value="ball.ply"/>
    <transform name="to_world"><translate x="-0.9" z="1"/></transform></shape>
  <shape type="ply"><string name="filename" value="knot.ply"/>
    <transform name="to_world"><translate x="1" z="1"/></transform></shape>
  <shape type="sphere"><point name="center" x="$lamp" y="1" z="4"/><float name="radius" value="0.3"/>
    <emitter type="area"><rgb name="radiance" value="40"/></emitter></shape>
</scene>
)";

class SharedCache : public testing::Test {
 protected:
  void SetUp() override {
    for (const char* name : {"a", "b"}) fs::create_directories(folder_ / name);
    std::ofstream(folder_ / "scene.xml") << k_scene;
    ASSERT_EQ(in("a", {"mesh", "sphere", "-o", "../ball.ply", "--around", "32", "--along", "16"}).wait().code, 0);
    ASSERT_EQ(in("a", {"mesh", "knot", "-o", "../knot.ply", "--along", "128", "--around", "16"}).wait().code, 0);
  }
  // Processes that run at once need separate folders for their output.
  Program in(const std::string& folder, const std::vector<std::string>& arguments) {
    return Program(folder_ / folder, arguments);
  }
  Program render_in(const std::string& folder, const std::string& crop, int lamp,
                    const std::vector<std::string>& more = {}) {
    std::vector<std::string> arguments = {"render",
                                          "../scene.xml",
                                          "-o",
                                          "out.exr",
                                          "--quiet",
                                          "--stats",
                                          "stats.json",
                                          "--crop",
                                          crop,
                                          "-D",
                                          "lamp=" + std::to_string(lamp),
                                          "--light-samples",
                                          "4",
                                          "--directions",
                                          "32",
                                          "--plane",
                                          "64",
                                          "--threads",
                                          "2"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return in(folder, arguments);
  }
  static std::vector<std::string> cached(const std::vector<std::string>& more = {}) {
    std::vector<std::string> arguments = {"--field-cache", "../cache"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
  }
  uint64_t rays_baked(const std::string& folder) const {
    return nlohmann::json::parse(read_text(folder_ / (folder + "/stats.json")))["bake"]["rays"];
  }
  std::vector<float> picture(const std::string& folder) const {
    return read_image(folder_ / (folder + "/out.exr")).data;
  }
  static void expect_success(Program& program) {
    const Outcome o = program.wait();
    EXPECT_EQ(o.code, 0) << o.err;
    EXPECT_EQ(o.err, "");  // nor a warning of a damaged file
  }
  std::vector<fs::path> files(const std::string& ending) const {
    std::vector<fs::path> found;
    for (const auto& entry : fs::directory_iterator(folder_ / "cache")) {
      if (entry.path().extension() == ending) found.push_back(entry.path());
    }
    return found;
  }

  static constexpr const char* k_left = "0,0,28,32";
  static constexpr const char* k_right = "20,0,28,32";
  const TemporaryFolder folder_;
};

TEST_F(SharedCache, TwoRendersAtOnceLoseNothing) {
  for (int lamp = -1; lamp <= 1; ++lamp) {
    Program left = render_in("a", k_left, lamp, cached());
    Program right = render_in("b", k_right, lamp, cached());
    expect_success(left);
    expect_success(right);
    EXPECT_GT(rays_baked("a") + rays_baked("b"), 0u) << "the rounds demand nothing new";
    const std::vector<float> left_picture = picture("a"), right_picture = picture("b");
    // The cells that both baked are there, and give the same pictures.
    Program left_again = render_in("a", k_left, lamp, cached());
    Program right_again = render_in("b", k_right, lamp, cached());
    expect_success(left_again);
    expect_success(right_again);
    EXPECT_EQ(rays_baked("a"), 0u);
    EXPECT_EQ(rays_baked("b"), 0u);
    EXPECT_EQ(picture("a"), left_picture);
    EXPECT_EQ(picture("b"), right_picture);
  }
  // Earlier rounds' cells are still there.
  Program first = render_in("a", k_left, -1, cached());
  expect_success(first);
  EXPECT_EQ(rays_baked("a"), 0u);
  EXPECT_EQ(files(".vdb").size(), 2u);
  EXPECT_TRUE(files(".tmp").empty());
}

TEST_F(SharedCache, AKilledRenderHarmsNobody) {
  Program alone = render_in("b", k_right, 0);
  expect_success(alone);
  const std::vector<float> expected = picture("b");
  for (int round = 0; round < 4; ++round) {
    Program killed = render_in("a", k_left, round, cached());
    Program other = render_in("b", k_right, 0, cached());
    // Killed at various stages of its work.
    std::this_thread::sleep_for(std::chrono::milliseconds(20 + 60 * round));
    killed.kill_now();
    killed.wait();
    expect_success(other);
    EXPECT_EQ(picture("b"), expected);
  }
  Program last = render_in("b", k_right, 0, cached());
  expect_success(last);
  EXPECT_EQ(rays_baked("b"), 0u);
}

// A limit that is far too small: each process removes what the other has just written, and both finish their pictures.
TEST_F(SharedCache, TwoRendersWithALimitMakeTheirPictures) {
  Program alone_left = render_in("a", k_left, 0), alone_right = render_in("b", k_right, 0);
  expect_success(alone_left);
  expect_success(alone_right);
  const std::vector<float> left_picture = picture("a"), right_picture = picture("b");
  for (int round = 0; round < 2; ++round) {
    Program left = render_in("a", k_left, 0, cached({"--field-cache-limit", "1"}));
    Program right = render_in("b", k_right, 0, cached({"--field-cache-limit", "1"}));
    EXPECT_EQ(left.wait().code, 0);
    EXPECT_EQ(right.wait().code, 0);
    EXPECT_EQ(picture("a"), left_picture);
    EXPECT_EQ(picture("b"), right_picture);
  }
  EXPECT_TRUE(files(".tmp").empty());
}

}  // namespace
}  // namespace fieldtrace::test
