// A folder with a small scene, and the program run in it, for tests of the files that commands read and write.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "tests/support/field_checks.h"
#include "tests/support/program.h"

namespace fieldtrace::test {

// A ball on a floor under a small lamp.
inline constexpr const char* k_small_scene = R"(<scene version="3.0.0">
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
  <shape type="ply"><string name="filename" value="ball.ply"/>
    <transform name="to_world"><translate z="1"/></transform></shape>
  <shape type="sphere"><point name="center" x="1" y="1" z="4"/><float name="radius" value="0.2"/>
    <emitter type="area"><rgb name="radiance" value="40"/></emitter></shape>
</scene>
)";

class CommandFiles : public testing::Test {
 protected:
  void SetUp() override {
    write("scene.xml", k_small_scene);
    ASSERT_EQ(run({"mesh", "sphere", "-o", "ball.ply", "--around", "32", "--along", "16"}).code, 0);
  }

  using Prepare = std::function<void()>;
  Outcome run(const std::vector<std::string>& arguments, const Prepare& prepare = {}) const {
    return Program(folder_.path(), arguments, FIELDTRACE_PROGRAM, prepare).wait();
  }

  void write(const std::string& name, const std::string& text) const {
    std::ofstream(folder_ / name, std::ios::binary) << text;
  }

  // Runs the program and expects a failure: this exit code, one line "fieldtrace: ..." that contains `part`, and no
  // file added or removed.
  void expect_failure(int code, const std::string& part, const std::vector<std::string>& arguments,
                      const Prepare& prepare = {}) const {
    std::string typed;
    for (const std::string& a : arguments) typed += a + " ";
    SCOPED_TRACE(typed);
    const std::set<std::string> before = files();
    const Outcome o = run(arguments, prepare);
    EXPECT_EQ(o.code, code) << o.err;
    EXPECT_EQ(o.err.rfind("fieldtrace: ", 0), 0u) << o.err;
    EXPECT_NE(o.err.find(part), std::string::npos) << o.err;
    EXPECT_EQ(std::count(o.err.begin(), o.err.end(), '\n'), 1) << o.err;
    EXPECT_EQ(files(), before);
  }

  // Names of the files and folders, except those that hold the program's output.
  std::set<std::string> files() const {
    std::set<std::string> names;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(folder_.path())) {
      const std::string name = std::filesystem::relative(entry.path(), folder_.path()).string();
      if (name != ".out" && name != ".err") names.insert(name);
    }
    return names;
  }

  const TemporaryFolder folder_;
};

}  // namespace fieldtrace::test
