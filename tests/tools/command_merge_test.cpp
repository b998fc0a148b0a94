// `render --slice` and `merge` as commands: the files that they write, refuse and leave alone.
#include <cstring>
#include <map>
#include <nlohmann/json.hpp>

#include "core/image/image.h"
#include "tests/support/command_files.h"

namespace fieldtrace::test {
namespace {

namespace fs = std::filesystem;

class CommandMerge : public CommandFiles {
 protected:
  static std::string name_of(int slice) { return "part " + std::to_string(slice) + ".exr"; }

  std::vector<std::string> command(int slice, int count, const std::vector<std::string>& more = {}) const {
    std::vector<std::string> all = {"render",       "scene.xml", "-o",
                                    name_of(slice), "--slice",   std::to_string(slice) + "/" + std::to_string(count),
                                    "--quiet",      "-D",        "size=80"};
    all.insert(all.end(), more.begin(), more.end());
    return all;
  }
  void render_parts(int count, const std::vector<std::string>& more = {}) const {
    for (int k = 1; k <= count; ++k) {
      const Outcome o = run(command(k, count, more));
      ASSERT_EQ(o.code, 0) << o.err;
      EXPECT_EQ(o.err, "");
    }
  }
  static std::vector<std::string> merge(int count, const std::vector<std::string>& more) {
    std::vector<std::string> all = {"merge"};
    for (int k = count; k >= 1; --k) all.push_back(name_of(k));
    all.insert(all.end(), more.begin(), more.end());
    return all;
  }
  void expect_same_pixels(const std::string& a, const std::string& b) const {
    const Image first = read_image(folder_ / a), second = read_image(folder_ / b);
    EXPECT_EQ(first.channels, second.channels);
    ASSERT_EQ(first.data.size(), second.data.size());
    EXPECT_EQ(std::memcmp(first.data.data(), second.data.data(), first.data.size() * sizeof(float)), 0) << a;
  }
};

TEST_F(CommandMerge, WritesWhatRenderWrites) {
  const std::vector<std::string> options = {"--aov", "depth,normal", "--crop", "5,3,70,20", "--light-samples", "4"};
  std::vector<std::string> whole = {"render",     "scene.xml", "-o",      "whole.exr", "-o",     "whole.png",
                                    "--exposure", "1",         "--quiet", "-D",        "size=80"};
  whole.insert(whole.end(), options.begin(), options.end());
  ASSERT_EQ(run(whole).code, 0);
  whole[3] = "whole32.exr";
  whole.push_back("--float32");
  ASSERT_EQ(run(whole).code, 0);
  render_parts(3, options);
  ASSERT_EQ(run(merge(3, {"-o", "merged.exr", "-o", "merged.png", "--exposure", "1"})).code, 0);
  ASSERT_EQ(run(merge(3, {"-o", "merged32.exr", "--float32"})).code, 0);
  expect_same_pixels("merged.exr", "whole.exr");
  expect_same_pixels("merged32.exr", "whole32.exr");
  EXPECT_EQ(read_text(folder_ / "merged.png"), read_text(folder_ / "whole.png"));
  // Half is narrower than what parts hold, so the two differ, which shows that the option counts.
  EXPECT_NE(read_image(folder_ / "merged.exr").data, read_image(folder_ / "merged32.exr").data);
  const auto header = [&](const std::string& name) {
    std::map<std::string, std::string> metadata;
    ImageReadOptions reading;
    reading.metadata = &metadata;
    read_image(folder_ / name, reading);
    return metadata;
  };
  auto merged = header("merged.exr"), of_whole = header("whole.exr");
  EXPECT_EQ(merged["fieldtrace:command"].rfind("fieldtrace merge part 3.exr", 0), 0u) << merged["fieldtrace:command"];
  EXPECT_NE(merged["fieldtrace:part_command"].find("--slice 1/3"), std::string::npos);
  for (const char* name : {"fieldtrace:version", "fieldtrace:seed", "fieldtrace:spp"})
    EXPECT_EQ(merged[name], of_whole[name]);
  EXPECT_EQ(merged.count("fieldtrace:part"), 0u);
}

TEST_F(CommandMerge, NamesWhatIsWrong) {
  render_parts(3);
  expect_failure(1, "slice 1 of 3 is missing", {"merge", name_of(2), name_of(3), "-o", "out.exr"});
  expect_failure(1, "part 2.exr: is slice 2/3, as part 2.exr", merge(3, {name_of(2), "-o", "out.exr"}));
  expect_failure(1, "nix.exr: no such file", merge(3, {"nix.exr", "-o", "out.exr"}));
  ASSERT_EQ(run({"render", "scene.xml", "-o", "whole.exr", "--quiet"}).code, 0);
  expect_failure(1, "whole.exr: is no part of a picture", merge(3, {"whole.exr", "-o", "out.exr"}));
  expect_failure(2, "-o part 1.exr: would overwrite the input part 1.exr", merge(3, {"-o", name_of(1)}));
  expect_failure(1, "unknown image format '.jpg'", merge(3, {"-o", "out.jpg"}));
  expect_failure(2, "parts is required", {"merge", "-o", "out.exr"});
  expect_failure(2, "-o is required", merge(3, {}));
  // A part of the same scene by other options, and of another one of that name.
  ASSERT_EQ(run(command(2, 3, {"--seed", "7"})).code, 0);
  expect_failure(1, "part 2.exr: is a part of another picture than part 3.exr: --seed is 7 instead of 0",
                 merge(3, {"-o", "out.exr"}));
  std::string scene = k_small_scene;
  scene.replace(scene.find("\"40\""), 4, "\"41\"");
  write("scene.xml", scene);
  ASSERT_EQ(run(command(2, 3)).code, 0);
  expect_failure(1, "the file scene.xml is ", merge(3, {"-o", "out.exr"}));
  const std::string cut = read_text(folder_ / name_of(2));
  write(name_of(2), cut.substr(0, cut.size() / 2));
  expect_failure(1, "part 2.exr: cannot be read as an image", merge(3, {"-o", "out.exr"}));
}

TEST_F(CommandMerge, SlicesRefuseWhatNeedsTheWholePicture) {
  const auto with = [&](const std::vector<std::string>& more) { return command(1, 2, more); };
  expect_failure(2, "--slice is for pictures of --spp samples", with({"--target-error", "0.1"}));
  expect_failure(2, "--slice is for pictures of --spp samples", with({"--time-limit", "1"}));
  expect_failure(2, "--slice is for pictures of --spp samples", with({"--checkpoint", "c"}));
  expect_failure(2, "--slice is for pictures of --spp samples", with({"--resume", "c"}));
  expect_failure(2, "--denoise needs the whole picture", with({"--denoise"}));
  expect_failure(2, "--watch writes the PNG outputs", with({"--watch"}));
  expect_failure(2, "--slice writes one part; give one -o", with({"-o", "b.exr"}));
  for (const char* name : {"a.png", "a.jpg", "a"})
    expect_failure(2, std::string("-o ") + name + ": parts are EXR files",
                   {"render", "scene.xml", "--slice", "1/2", "-o", name});
  expect_failure(2, "--slice 0/4: slices count from 1 to 4", {"render", "scene.xml", "--slice", "0/4", "-o", "a.exr"});
  expect_failure(2, "--slice x/y: write two whole numbers", {"render", "scene.xml", "--slice", "x/y", "-o", "a.exr"});
  expect_failure(2, "--slice", {"render", "scene.xml", "--skip-done", "-o", "a.exr"});
}

TEST_F(CommandMerge, APartThatIsThereIsLeftAlone) {
  const std::vector<std::string> skip = {"--skip-done", "--stats", "stats.json"};
  const auto renders = [&](const std::vector<std::string>& arguments) {
    fs::remove(folder_ / "stats.json");
    const std::string before = read_text(folder_ / name_of(1));
    const Outcome o = run(arguments);
    EXPECT_EQ(o.code, 0) << o.err;
    const bool rendered = fs::exists(folder_ / "stats.json");
    EXPECT_TRUE(rendered || read_text(folder_ / name_of(1)) == before);
    return rendered;
  };
  EXPECT_TRUE(renders(command(1, 2, skip)));
  EXPECT_FALSE(renders(command(1, 2, skip)));
  EXPECT_TRUE(renders(command(1, 2, {"--stats", "stats.json"}))) << "not asked to skip";
  EXPECT_EQ(nlohmann::json::parse(read_text(folder_ / "stats.json")).at("slice"), "1/2");
  // Of another number of slices, samples or seed; cut off; another file altogether.
  EXPECT_TRUE(renders(command(1, 3, skip)));
  EXPECT_TRUE(renders(command(1, 3, {"--skip-done", "--stats", "stats.json", "--spp", "3"})));
  EXPECT_TRUE(renders(command(1, 3, {"--skip-done", "--stats", "stats.json", "--spp", "3", "--seed", "1"})));
  EXPECT_TRUE(renders(command(1, 2, skip)));
  const std::string bytes = read_text(folder_ / name_of(1));
  write(name_of(1), bytes.substr(0, bytes.size() - 1));
  EXPECT_TRUE(renders(command(1, 2, skip)));
  write(name_of(1), "older");
  EXPECT_TRUE(renders(command(1, 2, skip)));
  EXPECT_FALSE(renders(command(1, 2, skip)));
}

// Whether or not a part was there before: it stays.
TEST_F(CommandMerge, AnInterruptedSliceWritesNothing) {
  for (const bool is_there : {false, true}) {
    if (is_there) write(name_of(1), "older");
    const std::set<std::string> before = files();
    Program program(folder_.path(), command(1, 2, {"--spp", "1000000", "--method", "montecarlo"}));
    ASSERT_TRUE(program.interrupt());
    const Outcome o = program.wait();
    EXPECT_EQ(o.code, 130);
    EXPECT_EQ(o.err, "fieldtrace: interrupted; the part was not written\n");
    EXPECT_EQ(files(), before);
  }
  EXPECT_EQ(read_text(folder_ / name_of(1)), "older");
}

TEST_F(CommandMerge, InfoTellsTheSlice) {
  render_parts(2);
  const Outcome o = run({"info", name_of(2)});
  EXPECT_EQ(o.code, 0);
  EXPECT_NE(o.out.find("\nslice      2/2\n"), std::string::npos) << o.out;
}

}  // namespace
}  // namespace fieldtrace::test
