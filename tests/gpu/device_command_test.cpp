// The command line's devices: listed, refused where the program has no kernels, and left to the CPU, with a message and
// the same picture, where the machine has none that it can use.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>

#include "tests/support/program.h"

namespace fieldtrace {
namespace {

namespace fs = std::filesystem;
using test::Outcome;

const char* const k_scene = R"(<scene version="3.0.0">
  <integrator type="path"><integer name="max_depth" value="2"/></integrator>
  <sensor type="perspective">
    <transform name="to_world"><lookat origin="0, 4, 3" target="0, 0, 0" up="0, 0, 1"/></transform>
    <sampler type="independent"><integer name="sample_count" value="2"/></sampler>
    <film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="16"/></film>
  </sensor>
  <shape type="rectangle"/>
  <shape type="sphere"><point name="center" x="1" y="1" z="3"/><float name="radius" value="0.2"/>
    <emitter type="area"><rgb name="radiance" value="40"/></emitter></shape>
</scene>
)";

bool has(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

class DeviceCommand : public testing::Test {
 protected:
  void SetUp() override {
    const auto* info = testing::UnitTest::GetInstance()->current_test_info();
    folder_ =
        fs::temp_directory_path() / (std::string("fieldtrace_device_") + info->name() + "_" + std::to_string(getpid()));
    fs::remove_all(folder_);
    fs::create_directories(folder_);
    std::ofstream(folder_ / "scene.xml") << k_scene;
  }
  void TearDown() override { fs::remove_all(folder_); }

  Outcome run(const std::vector<std::string>& arguments, const fs::path& libraries = {}) {
    return test::Program(folder_, arguments, FIELDTRACE_PROGRAM,
                         [&] {
                           if (!libraries.empty()) setenv("LD_LIBRARY_PATH", libraries.c_str(), 1);
                         })
        .wait();
  }
  void expect_cpus_picture(const char* file) {
    ASSERT_EQ(run({"render", "scene.xml", "-o", "cpu.exr", "--quiet"}).code, 0);
    EXPECT_EQ(run({"compare", file, "cpu.exr", "--fail-above", "0"}).code, 0);
  }

  const std::vector<std::string> render_ = {"render", "scene.xml", "-o", "device.exr", "--device", "cuda", "--quiet"};
  fs::path folder_;
};

bool has_kernels(const Outcome& devices) { return !has(devices.out, "\ncuda       cannot be used: "); }

// A build without kernels refuses the GPU; one with kernels renders on the CPU where the machine has none.
TEST_F(DeviceCommand, ListsDevicesAndSaysWhatIsMissing) {
  const Outcome devices = run({"info", "--devices"});
  EXPECT_EQ(devices.code, 0) << devices.err;
  EXPECT_EQ(devices.out.rfind("cpu        ", 0), 0u) << devices.out;
  EXPECT_TRUE(has(devices.out, "\ncuda       ")) << devices.out;
  const Outcome o = run(render_);
  if (!has_kernels(devices)) {
    EXPECT_EQ(o.code, 2);
    EXPECT_TRUE(has(o.err, "--device cuda: not available yet: this program was built without kernels for GPUs"));
    EXPECT_FALSE(fs::exists(folder_ / "device.exr"));
    return;
  }
  EXPECT_EQ(o.code, 0) << o.err;
  if (has(devices.out, "\ncuda       none: ")) {
    EXPECT_TRUE(has(o.err, "warning: --device cuda: this machine has no CUDA ")) << o.err;
    EXPECT_TRUE(has(o.err, "; the CPU answers instead")) << o.err;
  }
  expect_cpus_picture("device.exr");
}

TEST_F(DeviceCommand, NamesTheDevicesThereAreWhenGivenAnother) {
  const Outcome o = run({"render", "scene.xml", "-o", "device.exr", "--device", "toaster"});
  EXPECT_EQ(o.code, 2);
  EXPECT_TRUE(has(o.err, "'toaster' is not one of cpu, cuda")) << o.err;
}

#ifdef FIELDTRACE_EMULATED_DRIVER
// A driver that finds no code for its device's architecture among the program's kernels.
TEST_F(DeviceCommand, LeavesADeviceOfAnotherArchitectureToTheCpu) {
  fs::create_symlink(FIELDTRACE_EMULATED_DRIVER, folder_ / "libcuda.so.1");
  const Outcome devices = run({"info", "--devices"}, folder_);
  EXPECT_TRUE(has(devices.out, "\ncuda       0: Driver of a test, compute capability 8.9, 1073 MB\n")) << devices.out;
  if (!has_kernels(devices)) GTEST_SKIP() << "no CUDA compiler";
  const Outcome o = run(render_, folder_);
  EXPECT_EQ(o.code, 0) << o.err;
  EXPECT_TRUE(has(o.err,
                  "warning: --device cuda: opening Driver of a test: other (CUDA error 209); the CPU answers "
                  "instead"))
      << o.err;
  expect_cpus_picture("device.exr");
}
#endif

}  // namespace
}  // namespace fieldtrace
