// Pictures that are written while they are rendered.
#include "tools/cli/picture_watcher.h"

#include <algorithm>
#include <filesystem>

#include "tests/support/command_files.h"
#include "tests/support/waiting.h"
#include "tests/support/warnings.h"

namespace fieldtrace::test {
namespace {

namespace fs = std::filesystem;

WatcherOptions often(const std::string& path) {
  WatcherOptions o;
  o.paths = {path};
  o.seconds = 0.005;
  return o;
}

TEST(PictureWatcher, WritesWhatIsNew) {
  const TemporaryFolder folder;
  const auto live = std::make_shared<LivePicture>(100, 70);
  Warnings warnings;
  WatcherOptions options = often(folder / "a.png");
  options.paths.push_back(folder / "b.png");
  options.exposure = 1.0f;
  PictureWatcher watcher(live, options, warnings.sink());
  for (int tile = 0; tile < 4; ++tile) {
    const Rect rect{25 * tile, 10 * tile, 25, 30};
    live->update(rect, std::vector<Rgb>(25 * 30, Rgb(0.1f, 0.02f, 0.4f) * float(tile + 1)));
    const auto shows = [&](const std::string& name) {
      try {
        const Image image = read_image(folder / name);
        const float* const p = image.pixel(rect.x + 12, rect.y + 15);
        const float* const beside = image.pixel(99, 0);
        // Twice the radiance, by the exposure; to half a step of 8 bits.
        return image.width == 100 && image.height == 70 &&
               std::abs(srgb_encode(p[0]) - srgb_encode(0.2f * float(tile + 1))) < 0.51f / 255.0f && *beside == 0.0f;
      } catch (const Error&) {
        return false;  // not there yet
      }
    };
    EXPECT_TRUE(comes_true([&] { return shows("a.png") && shows("b.png"); })) << tile;
  }
  watcher.stop();
  EXPECT_EQ(warnings.count(), 0u);
  // Nothing is left beside the files, and nothing is written any more.
  fs::remove(folder / "a.png");
  live->update({0, 0, 1, 1}, std::vector<Rgb>(1, Rgb(1.0f)));
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  EXPECT_EQ(std::distance(fs::directory_iterator(folder.path()), fs::directory_iterator()), 1);
}

// Whoever reads meanwhile finds a whole picture.
TEST(PictureWatcher, FilesAreAlwaysWhole) {
  const TemporaryFolder folder;
  const auto live = std::make_shared<LivePicture>(64, 64);
  Warnings warnings;
  PictureWatcher watcher(live, often(folder / "a.png"), warnings.sink());
  live->update({0, 0, 64, 64}, std::vector<Rgb>(64 * 64, Rgb(1.0f)));
  ASSERT_TRUE(comes_true([&] { return fs::exists(folder / "a.png"); }));
  for (int i = 0; i < 100; ++i) {
    const float value = i % 2 ? 1.0f : 0.0f;
    live->update({0, 0, 64, 64}, std::vector<Rgb>(64 * 64, Rgb(value)));
    const Image image = read_image(folder / "a.png");
    ASSERT_EQ(image.data.size(), size_t(64 * 64 * 3));
    // One block is read at once, so all of it is of one update.
    for (const float v : image.data) ASSERT_EQ(v, image.data[0]);
  }
}

TEST(PictureWatcher, WhatCannotBeWrittenIsToldOnceAndTriedAgain) {
  const TemporaryFolder folder;
  const std::string path = folder / "missing/a.png";
  const auto live = std::make_shared<LivePicture>(10, 10);
  Warnings warnings;
  PictureWatcher watcher(live, often(path), warnings.sink());
  live->update({0, 0, 10, 10}, std::vector<Rgb>(100, Rgb(0.5f)));
  ASSERT_TRUE(comes_true([&] { return warnings.count() > 0; }));
  std::this_thread::sleep_for(std::chrono::milliseconds(100));  // for more attempts
  fs::create_directory(folder / "missing");
  EXPECT_TRUE(comes_true([&] { return fs::exists(path); }));
  watcher.stop();
  ASSERT_EQ(warnings.count(), 1u);
  EXPECT_NE(warnings.texts[0].find("the render goes on"), std::string::npos) << warnings.texts[0];
}

using WatchCommand = CommandFiles;

// Long enough to be watched; interrupted as soon as the picture is there.
TEST_F(WatchCommand, APictureIsThereBeforeTheRenderEnds) {
  Program program(folder_.path(), {"render", "scene.xml", "-o", "a.png", "--watch", "--quiet", "-D", "size=512",
                                   "--spp", "20000", "--method", "montecarlo"});
  EXPECT_TRUE(comes_true([&] { return fs::exists(folder_ / "a.png"); }));
  EXPECT_EQ(read_image(folder_ / "a.png").width, 512);
  ASSERT_TRUE(program.interrupt());
  EXPECT_EQ(program.wait().code, 130);
}

TEST_F(WatchCommand, TheFileInTheEndIsThePicture) {
  ASSERT_EQ(run({"render", "scene.xml", "-o", "a.png", "--quiet"}).code, 0);
  EXPECT_EQ(run({"render", "scene.xml", "-o", "A.PNG", "--watch", "--quiet"}).code, 0);
  const Outcome o = run({"render", "scene.xml", "-o", "b.png", "-o", "c.exr", "--watch", "--quiet"});
  EXPECT_EQ(o.code, 0);
  EXPECT_EQ(o.err, "");
  EXPECT_EQ(read_text(folder_ / "a.png"), read_text(folder_ / "b.png"));
  expect_failure(2, "add -o NAME.png", {"render", "scene.xml", "-o", "d.exr", "--watch"});
}

}  // namespace
}  // namespace fieldtrace::test
