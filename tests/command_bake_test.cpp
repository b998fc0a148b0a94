// The commands bake and info as a user runs them on fields.
#include <gtest/gtest.h>

#include <filesystem>

#include "field_checks.h"
#include "program.h"

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
  // 64 x 256 cells take minutes.
  Program program(folder_.path(), {"bake", "ball.ply", "-o", "f.vdb", "--full", "--plane", "256"});
  ASSERT_TRUE(program.interrupt());
  const Outcome o = program.wait();
  EXPECT_EQ(o.code, 130) << o.err;
  EXPECT_NE(o.err.find("interrupted"), std::string::npos) << o.err;
  EXPECT_NE(o.out.find("f.vdb: ball.ply, 64 x 256 cells"), std::string::npos) << o.out;
  const Outcome info = run({"info", "f.vdb"});
  EXPECT_EQ(info.code, 0) << info.err;
  for (const char* part :
       {"orthographic", "D 64, N 256, K 16", "visibility", "depth", "on disk", "ask", "cache name"}) {
    EXPECT_NE(info.out.find(part), std::string::npos) << part << " in\n" << info.out;
  }
}

TEST_F(CommandBake, RefusesWhatItCannotBake) {
  const auto expect = [&](int code, const char* part, const std::vector<std::string>& arguments) {
    const Outcome o = run(arguments);
    EXPECT_EQ(o.code, code) << o.err;
    EXPECT_NE(o.err.find(part), std::string::npos) << o.err;
  };
  expect(2, "--full", {"bake", "ball.ply", "-o", "f.vdb"});
  expect(2, ".vdb", {"bake", "ball.ply", "--full", "-o", "f.ply"});
  expect(2, "not available yet", {"bake", "ball.ply", "--full", "-o", "f.vdb", "--chart", "thesis"});
  expect(1, "no/f.vdb", {"bake", "ball.ply", "--full", "-o", "no/f.vdb"});
  expect(1, "missing.ply", {"bake", "missing.ply", "--full", "-o", "f.vdb"});
  expect(1, "missing.vdb", {"info", "missing.vdb"});
  fs::copy_file(folder_ / "ball.ply", folder_ / "foreign.vdb");
  expect(1, "foreign.vdb: is cut short, or no field file", {"info", "foreign.vdb"});
  EXPECT_FALSE(exists("f.vdb"));
}

}  // namespace
}  // namespace fieldtrace::test
