// The commands bake and info on fields, run as a user would.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <thread>

#include "field/file/field_file.h"
#include "field/file/field_info.h"
#include "field/file/maps_file.h"
#include "tests/support/field_checks.h"
#include "tests/support/program.h"

namespace fieldtrace::test {
namespace {

namespace fs = std::filesystem;

class CommandBake : public testing::Test {
 protected:
  void SetUp() override {
    ASSERT_EQ(run({"mesh", "sphere", "-o", "ball.ply", "--around", "16", "--along", "10"}).code, 0);
  }
  Outcome run(const std::vector<std::string>& arguments) { return Program(folder_.path(), arguments).wait(); }
  bool exists(const std::string& name) const { return fs::exists(folder_ / name); }

  TemporaryFolder folder_;
};

TEST_F(CommandBake, AnInterruptedFullBakeKeepsWhatIsFinished) {
  // Baking 64 x 256 cells takes minutes. What is finished before the first cell is nothing: later, then.
  Outcome o;
  for (int seconds_64ths = 1; seconds_64ths < 4096 && !exists("f.vdb"); seconds_64ths *= 2) {
    Program program(folder_.path(), {"bake", "ball.ply", "-o", "f.vdb", "--full", "--plane", "256"});
    std::this_thread::sleep_for(std::chrono::seconds(seconds_64ths) / 64);
    ASSERT_TRUE(program.interrupt());
    o = program.wait();
    EXPECT_EQ(o.code, 130) << o.err;
    EXPECT_NE(o.err.find(exists("f.vdb") ? "the finished cells were written" : "nothing was written"),
              std::string::npos)
        << o.err;
  }
  EXPECT_NE(o.out.find("f.vdb: ball.ply, 64 x 256 cells"), std::string::npos) << o.out;
  const Outcome info = run({"info", "f.vdb"});
  EXPECT_EQ(info.code, 0) << info.err;
  for (const char* part :
       {"orthographic", "D 64, N 256, K 16", "visibility", "depth", "on disk", "undecided", "cache name"}) {
    EXPECT_NE(info.out.find(part), std::string::npos) << part << " in\n" << info.out;
  }
}

TEST_F(CommandBake, InfoTellsAllOfAFieldAsTextAndAsJson) {
  constexpr FieldParameters p = {32, 64, 8};
  Field field(test_ball(), p);
  fill_random_slices(field, 1, 300);
  ASSERT_TRUE(field.coverage().claim(7) && field.coverage().claim(900));
  TileLines lines(CoverageTiles::k_lines_per_tile, 0);
  ASSERT_TRUE(field.coverage().finish(7, lines));
  std::fill_n(lines.begin(), 256, uint16_t(5));
  ASSERT_TRUE(field.coverage().finish(900, lines));
  save_field(field, test_identity(p), folder_ / "f.vdb");
  const LayerInfo visibility = layer_info(field, FieldLayer::visibility), depth = layer_info(field, FieldLayer::depth);

  const Outcome text = run({"info", "f.vdb"}), o = run({"info", "f.vdb", "--json"});
  ASSERT_EQ(o.code, 0) << o.err;
  const nlohmann::json j = nlohmann::json::parse(o.out);
  EXPECT_EQ(j["directions"], 32);
  EXPECT_EQ(j["plane"], 64);
  EXPECT_EQ(j["lines"], 8);
  const auto number = [&](const char* group, const char* key) { return j[group][key].get<uint64_t>(); };
  EXPECT_EQ(number("visibility", "cells_baked"), visibility.cells_baked);
  EXPECT_EQ(number("visibility", "cells_full"), 32u * 32u * 64u * 64u);
  EXPECT_EQ(number("visibility", "clear"), visibility.clear);
  EXPECT_EQ(number("visibility", "blocked"), visibility.blocked);
  EXPECT_EQ(number("visibility", "undecided"), visibility.undecided);
  EXPECT_EQ(number("depth", "cells_baked"), depth.cells_baked);
  EXPECT_EQ(number("depth", "miss") + number("depth", "plane_fit") + number("depth", "undecided"), depth.cells_baked);
  EXPECT_GT(number("depth", "plane_fit"), 0u);
  EXPECT_EQ(number("depth", "one_sided_bound"), 0u);
  EXPECT_EQ(number("coverage", "tiles_baked"), 2u);
  EXPECT_EQ(number("coverage", "tiles_empty"), 1u);
  EXPECT_EQ(number("coverage", "tiles_full"), 32u * 32u * 4u * 4u);
  EXPECT_EQ(number("coverage", "lines_baked"), 2048u);
  EXPECT_EQ(number("coverage", "lines_hit"), 256u);
  EXPECT_EQ(number("bytes", "disk"), fs::file_size(folder_ / "f.vdb"));
  EXPECT_EQ(number("bytes", "memory"), field.bytes());
  EXPECT_GT(j["primitives_baked"], 0u);
  EXPECT_EQ(number("bytes", "cells"),
            visibility.cells_baked + 8 * depth.cells_baked + 4 * j["primitives_baked"].get<uint64_t>());
  EXPECT_EQ(number("bytes", "coverage"), CoverageTiles::k_tile_bytes);
  EXPECT_NEAR(j["compression"].get<double>(),
              double(number("bytes", "cells") + number("bytes", "coverage")) / double(number("bytes", "disk")), 1e-9);
  for (const char* part : {"one-sided bound 0.0 %", "coverage   2 of 16384 tiles", "128 x 128 lines a direction",
                           "2048 lines, 12.5 % hit, 1 tiles empty", "to 1 on disk"}) {
    EXPECT_NE(text.out.find(part), std::string::npos) << part << " in\n" << text.out;
  }
  const Outcome mesh = run({"info", "ball.ply", "--json"});
  EXPECT_EQ(mesh.code, 2);
  EXPECT_NE(mesh.err.find("--json"), std::string::npos) << mesh.err;
}

TEST_F(CommandBake, FieldsOfTheThesisChartAreWhole) {
  // The ball fills its bounding sphere, so no ray misses it: a hyperboloid is used instead.
  ASSERT_EQ(run({"mesh", "hyperboloid", "-o", "h.ply", "--around", "16", "--along", "8"}).code, 0);
  const Outcome o = run({"bake", "h.ply", "-o", "f.vdb", "--chart", "thesis", "--directions", "32"});
  ASSERT_EQ(o.code, 0) << o.err;
  EXPECT_NE(o.out.find("f.vdb: h.ply, M = 32, 4327424 samples"), std::string::npos) << o.out;
  const Outcome text = run({"info", "f.vdb"}), json = run({"info", "f.vdb", "--json"});
  for (const char* part : {"thesis", "M 32", "4327424", "% miss", "cache name", "on disk"}) {
    EXPECT_NE(text.out.find(part), std::string::npos) << part << " in\n" << text.out;
  }
  const nlohmann::json j = nlohmann::json::parse(json.out);
  EXPECT_EQ(j["chart"], "thesis");
  EXPECT_EQ(j["directions"], 32);
  EXPECT_EQ(j["samples"], 4327424);
  EXPECT_GT(j["misses"], 0);
  EXPECT_LT(j["misses"], j["samples"]);
  EXPECT_EQ(j["bytes"]["disk"], fs::file_size(folder_ / "f.vdb"));
  EXPECT_EQ(j["bytes"]["memory"], 4327424);
}

TEST_F(CommandBake, InfoTellsOfDirectionMaps) {
  constexpr MapSize size = {8, 16};
  DirectionMaps maps(test_ball(), size);
  std::fill_n(maps.depths(5), 256, uint16_t(1234));
  FieldIdentity identity = test_identity({.directions = size.directions, .plane = size.texels, .lines = 0});
  identity.chart = k_chart_maps;
  save_direction_maps(maps, identity, folder_ / "m.vdb");
  const Outcome text = run({"info", "m.vdb"}), json = run({"info", "m.vdb", "--json"});
  ASSERT_EQ(text.code, 0) << text.err;
  for (const char* part : {"chart      maps", "D 8, T 16", "16384, 1.6 % hit", "on disk"}) {
    EXPECT_NE(text.out.find(part), std::string::npos) << part << " in\n" << text.out;
  }
  const nlohmann::json j = nlohmann::json::parse(json.out);
  EXPECT_EQ(j["chart"], "maps");
  EXPECT_EQ(j["directions"], 8);
  EXPECT_EQ(j["texels_across"], 16);
  EXPECT_EQ(j["texels"], 16384);
  EXPECT_EQ(j["hits"], 256);
  EXPECT_EQ(j["mesh_hash"], identity.geometry.hex());
  EXPECT_EQ(j["cache_name"], identity.file_name());
  EXPECT_EQ(j["bytes"]["disk"], fs::file_size(folder_ / "m.vdb"));
  EXPECT_EQ(j["bytes"]["memory"], maps.bytes());
}

TEST_F(CommandBake, RefusesWhatItCannotBake) {
  const auto expect = [&](int code, const char* part, const std::vector<std::string>& arguments) {
    const Outcome o = run(arguments);
    EXPECT_EQ(o.code, code) << o.err;
    EXPECT_NE(o.err.find(part), std::string::npos) << o.err;
  };
  expect(2, "--full", {"bake", "ball.ply", "-o", "f.vdb"});
  expect(2, ".vdb", {"bake", "ball.ply", "--full", "-o", "f.ply"});
  // Of scenes, which `ball.ply` is not; nor is the field that `info` would look for.
  expect(2, "-D: only of scenes", {"bake", "ball.ply", "--full", "-o", "f.vdb", "-D", "a=b"});
  expect(2, "--strict: only of scenes", {"bake", "ball.ply", "--full", "-o", "f.vdb", "--strict"});
  expect(2, "-D: only of scenes", {"info", "ball.ply", "-D", "a=b"});
  expect(2, "--strict: only of scenes", {"info", "missing.vdb", "--strict"});
  expect(2, "--plane", {"bake", "ball.ply", "-o", "f.vdb", "--chart", "thesis", "--plane", "64"});
  expect(2, "--directions 256", {"bake", "ball.ply", "-o", "f.vdb", "--chart", "thesis", "--directions", "256"});
  expect(1, "--field-memory", {"bake", "ball.ply", "-o", "f.vdb", "--chart", "thesis", "--field-memory", "1"});
  expect(2, "--field-cache-limit", {"bake", "ball.ply", "--full", "-o", "f.vdb", "--field-cache-limit", "10"});
  expect(1, "--field-memory", {"bake", "ball.ply", "--full", "-o", "f.vdb", "--field-memory", "1"});
  expect(1, "no/f.vdb", {"bake", "ball.ply", "--full", "-o", "no/f.vdb"});
  expect(1, "missing.ply", {"bake", "missing.ply", "--full", "-o", "f.vdb"});
  expect(1, "missing.vdb", {"info", "missing.vdb"});
  fs::copy_file(folder_ / "ball.ply", folder_ / "foreign.vdb");
  expect(1, "foreign.vdb: is cut short, or no field file", {"info", "foreign.vdb"});
  // Too small and too large for single precision; at least 256 triangles, so that --full bakes them.
  for (const char* unit : {"1e-12", "1e15"}) {
    std::ofstream mesh(folder_ / "extreme.obj");
    for (int i = 0; i < 300; ++i)
      mesh << "v " << i << unit + 1 << " 0 0\nv 0 " << i + 1 << unit + 1 << " " << unit << "\n";
    for (int i = 1; i < 598; ++i) mesh << "f " << i << " " << i + 1 << " " << i + 2 << "\n";
    mesh.close();
    expect(1, "extreme.obj: the shape ", {"bake", "extreme.obj", "--full", "-o", "f.vdb", "--directions", "32"});
  }
  EXPECT_FALSE(exists("f.vdb"));
}

}  // namespace
}  // namespace fieldtrace::test
