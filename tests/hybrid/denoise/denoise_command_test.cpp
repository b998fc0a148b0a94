// `fieldtrace render --denoise`: what is written with the library, without it, and where it fails.

#include "core/image/image.h"
#include "hybrid/denoise/denoise.h"
#include "tests/support/command_files.h"

namespace fieldtrace::test {
namespace {

namespace fs = std::filesystem;

class DenoiseCommand : public CommandFiles {
 protected:
  static bool has_denoiser() {
    try {
      require_denoiser();
      return true;
    } catch (const UsageError&) {
      return false;
    }
  }
  Image image(const std::string& name) const { return read_image(folder_ / name); }
};

#define SKIP_WITHOUT_DENOISER() \
  if (!has_denoiser()) GTEST_SKIP() << "built without Open Image Denoise (tools/install_packages.sh --with-oidn)"

TEST_F(DenoiseCommand, WithoutTheLibraryIsWrongUse) {
  if (has_denoiser()) GTEST_SKIP() << "built with Open Image Denoise";
  expect_failure(2, "install_packages.sh --with-oidn", {"render", "scene.xml", "-o", "a.exr", "--denoise"});
}

TEST_F(DenoiseCommand, WritesTheDenoisedPictureAndNoOtherLayers) {
  SKIP_WITHOUT_DENOISER();
  const std::vector<std::string> render = {"render", "scene.xml", "--quiet", "--float32", "-o"};
  const auto with = [&](const std::vector<std::string>& more) {
    std::vector<std::string> all = render;
    all.insert(all.end(), more.begin(), more.end());
    return run(all);
  };
  ASSERT_EQ(with({"noisy.exr", "--aov", "denoise_albedo,depth,denoise_normal"}).code, 0);
  ASSERT_EQ(with({"a.exr", "-o", "a.png", "--denoise", "--stats", "a.json"}).code, 0);
  ASSERT_EQ(with({"b.exr", "--denoise", "--aov", "depth,denoise_normal"}).code, 0);
  Image expected = image("noisy.exr");
  denoise(expected, {.threads = 0});
  const Image plain = image("a.exr"), layered = image("b.exr"), shown = image("a.png");
  EXPECT_EQ(plain.channel_count(), 3u);
  Image kept = expected;
  drop_denoise_layers(kept, {"denoise_normal"});
  EXPECT_EQ(std::set<std::string>(layered.channels.begin(), layered.channels.end()),
            std::set<std::string>(kept.channels.begin(), kept.channels.end()));
  for (int y = 0; y < plain.height; ++y) {
    for (int x = 0; x < plain.width; ++x) {
      for (const char* name : {"R", "G", "B"}) {
        const float value = expected.pixel(x, y)[expected.channel_index(name)];
        ASSERT_NEAR(plain.pixel(x, y)[plain.channel_index(name)], value, 1e-5f * std::max(value, 1.0f));
        ASSERT_NEAR(layered.pixel(x, y)[layered.channel_index(name)], value, 1e-5f * std::max(value, 1.0f));
        // Half a step of 8 bits, on the steepest part of the curve's inverse.
        ASSERT_NEAR(srgb_encode(shown.pixel(x, y)[shown.channel_index(name)]), srgb_encode(value), 0.51f / 255.0f);
      }
    }
  }
  EXPECT_NE(read_text(folder_ / "a.exr").find("fieldtrace:denoised"), std::string::npos);
  EXPECT_NE(read_text(folder_ / "a.exr").find("Open Image Denoise 2."), std::string::npos);
  EXPECT_EQ(read_text(folder_ / "noisy.exr").find("fieldtrace:denoised"), std::string::npos);
  EXPECT_NE(read_text(folder_ / "a.json").find("\"denoise\""), std::string::npos);
}

// The program alone, as one that was copied elsewhere: the library cannot be opened.
TEST_F(DenoiseCommand, AFailureIsAWarningAndLeavesTheNoise) {
  SKIP_WITHOUT_DENOISER();
  fs::create_directory(folder_ / "bin");
  const std::string program = folder_ / "bin/fieldtrace";
  fs::copy_file(FIELDTRACE_PROGRAM, program);
  ASSERT_EQ(run({"render", "scene.xml", "--quiet", "-o", "a.exr"}).code, 0);
  const Outcome o =
      Program(folder_.path(), {"render", "scene.xml", "--quiet", "--denoise", "-o", "b.exr"}, program).wait();
  EXPECT_EQ(o.code, 0);
  EXPECT_EQ(o.err.rfind("fieldtrace: warning: ", 0), 0u) << o.err;
  EXPECT_NE(o.err.find("is written with its noise"), std::string::npos) << o.err;
  EXPECT_EQ(std::count(o.err.begin(), o.err.end(), '\n'), 1) << o.err;
  EXPECT_EQ(image("b.exr").channels, image("a.exr").channels);
  EXPECT_EQ(image("b.exr").data, image("a.exr").data);
  EXPECT_EQ(read_text(folder_ / "b.exr").find("fieldtrace:denoised"), std::string::npos);
}

}  // namespace
}  // namespace fieldtrace::test
