#include "core/image/image.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <random>

#include "core/io/atomic_file.h"
#include "core/platform/error.h"

namespace fieldtrace {
namespace {

namespace fs = std::filesystem;

// A fresh folder per test, removed at the end.
class ImageFile : public testing::Test {
 protected:
  void SetUp() override {
    const auto* info = testing::UnitTest::GetInstance()->current_test_info();
    folder_ =
        fs::temp_directory_path() / (std::string("fieldtrace_image_") + info->name() + "_" + std::to_string(getpid()));
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  size_t files() const { return size_t(std::distance(fs::directory_iterator(folder_), fs::directory_iterator())); }

  fs::path folder_;
};

Image random_image(int width, int height, std::vector<std::string> channels, uint32_t seed) {
  Image image{width, height, std::move(channels), {}};
  std::mt19937 random(seed);
  std::lognormal_distribution<float> value(0.0f, 2.0f);
  image.data.resize(size_t(width) * height * image.channel_count());
  for (float& v : image.data) v = value(random);
  return image;
}

template <class Action>
std::string error_of(const Action& action) {
  try {
    action();
  } catch (const Error& e) {
    return e.what();
  }
  return "no error";
}

const std::vector<std::string> k_rgb = {"R", "G", "B"};

TEST_F(ImageFile, FloatExrIsExact) {
  const Image image = random_image(37, 11, k_rgb, 1);
  ImageWriteOptions options;
  options.half = false;
  write_image(path("a.exr"), image, options);
  const Image back = read_image(path("a.exr"));
  ASSERT_EQ(back.channels, k_rgb);
  EXPECT_EQ(back.width, 37);
  EXPECT_EQ(back.height, 11);
  EXPECT_EQ(back.data, image.data);
}

TEST_F(ImageFile, HalfExrIsWithinHalfAnUlpOfHalf) {
  const Image image = random_image(64, 16, k_rgb, 2);
  write_image(path("a.exr"), image);
  const Image back = read_image(path("a.exr"));
  for (size_t i = 0; i < image.data.size(); ++i) {
    // 11 significant bits: relative error 2^-11; absolute error 2^-25 among subnormals.
    EXPECT_NEAR(back.data[i], image.data[i], 0x1p-11f * image.data[i] + 0x1p-25f);
  }
}

TEST_F(ImageFile, LayersKeepTheirNamesAndPrecision) {
  const std::vector<std::string> channels = {
      "R",        "G",       "B",         "normal.X",          "normal.Y",
      "normal.Z", "depth.Z", "object.id", "reflected_depth.Z", "reflected_object.Y"};
  Image image = random_image(9, 5, channels, 3);
  for (int y = 0; y < 5; ++y) {
    for (int x = 0; x < 9; ++x) {
      image.pixel(x, y)[6] = 1000.0f + 0x1p-10f * float(x);  // not representable in half
      image.pixel(x, y)[7] = 4097.0f;                        // not representable in half
      image.pixel(x, y)[8] = image.pixel(x, y)[6];
      image.pixel(x, y)[9] = 4097.0f;
    }
  }
  write_image(path("a.exr"), image);
  const Image back = read_image(path("a.exr"));
  ASSERT_EQ(back.channel_count(), channels.size());
  for (const char* exact : {"depth.Z", "object.id", "reflected_depth.Z", "reflected_object.Y"}) {
    const int from = image.channel_index(exact), to = back.channel_index(exact);
    ASSERT_GE(to, 0) << exact;
    for (int y = 0; y < 5; ++y) {
      for (int x = 0; x < 9; ++x) EXPECT_EQ(back.pixel(x, y)[to], image.pixel(x, y)[from]) << exact;
    }
  }
  const int y_normal = back.channel_index("normal.Y");
  ASSERT_GE(y_normal, 0);
  EXPECT_NEAR(back.pixel(4, 2)[y_normal], image.pixel(4, 2)[4], 0x1p-11f * image.pixel(4, 2)[4]);
}

TEST_F(ImageFile, HalfClampsTheFiniteAndKeepsTheRest) {
  Image image{3, 1, k_rgb, std::vector<float>(9, 0.0f)};
  image.pixel(0, 0)[0] = 1e9f;
  image.pixel(1, 0)[0] = INFINITY;
  image.pixel(2, 0)[0] = NAN;
  write_image(path("a.exr"), image);
  const Image back = read_image(path("a.exr"));
  EXPECT_EQ(back.pixel(0, 0)[0], 65504.0f);
  EXPECT_TRUE(std::isinf(back.pixel(1, 0)[0]));
  EXPECT_TRUE(std::isnan(back.pixel(2, 0)[0]));
}

TEST_F(ImageFile, MetadataIsInTheHeader) {
  ImageWriteOptions options;
  options.metadata = {{"fieldtrace:seed", "77"}, {"fieldtrace:command", "fieldtrace render x.xml"}};
  write_image(path("a.exr"), random_image(4, 4, k_rgb, 4), options);
  std::ifstream in(path("a.exr"), std::ios::binary);
  const std::string bytes((std::istreambuf_iterator<char>(in)), {});
  EXPECT_NE(bytes.find("fieldtrace:seed"), std::string::npos);
  EXPECT_NE(bytes.find("fieldtrace render x.xml"), std::string::npos);
}

TEST_F(ImageFile, PngIsSrgbToHalfAStep) {
  Image image{256, 1, k_rgb, std::vector<float>(256 * 3)};
  for (int x = 0; x < 256; ++x) {
    for (int c = 0; c < 3; ++c) image.pixel(x, 0)[c] = float(x) / 255.0f;
  }
  write_image(path("a.png"), image);
  const Image back = read_image(path("a.png"));
  for (int x = 0; x < 256; ++x) {
    EXPECT_NEAR(srgb_encode(back.pixel(x, 0)[1]), srgb_encode(image.pixel(x, 0)[1]), 0.501f / 255.0f) << x;
  }
  ImageReadOptions raw;
  raw.linearise = false;
  EXPECT_NEAR(read_image(path("a.png"), raw).pixel(55, 0)[0], std::round(255.0f * srgb_encode(55.0f / 255.0f)) / 255.0f,
              0x1p-20f);
}

TEST_F(ImageFile, PngExposureIsInStops) {
  Image image{1, 1, k_rgb, {0.1f, 0.1f, 0.1f}};
  ImageWriteOptions options;
  options.exposure = 2.0f;
  write_image(path("a.png"), image, options);
  EXPECT_NEAR(srgb_encode(read_image(path("a.png")).data[0]), srgb_encode(0.4f), 0.501f / 255.0f);
}

TEST_F(ImageFile, PngSurvivesNanInfinityAndNegatives) {
  Image image{4, 1, k_rgb, std::vector<float>(12, NAN)};
  for (int c = 0; c < 3; ++c) {
    image.pixel(1, 0)[c] = INFINITY;
    image.pixel(2, 0)[c] = -INFINITY;
    image.pixel(3, 0)[c] = -3.0f;
  }
  write_image(path("a.png"), image);
  const Image back = read_image(path("a.png"));
  EXPECT_EQ(back.pixel(0, 0)[0], 0.0f);
  EXPECT_EQ(back.pixel(1, 0)[0], 1.0f);
  EXPECT_EQ(back.pixel(2, 0)[0], 0.0f);
  EXPECT_EQ(back.pixel(3, 0)[0], 0.0f);
}

TEST_F(ImageFile, SrgbCurvesAreInverse) {
  for (int i = 0; i <= 1000; ++i) {
    const float v = float(i) / 1000.0f;
    EXPECT_NEAR(srgb_decode(srgb_encode(v)), v, 0x1p-18f);
  }
}

TEST_F(ImageFile, BadOutputsNameThePathAndLeaveNothing) {
  const Image image = random_image(4, 4, k_rgb, 5);
  for (const char* name : {"missing/a.exr", "missing/a.png"}) {
    const std::string message = error_of([&] { write_image(path(name), image); });
    EXPECT_NE(message.find(path(name)), std::string::npos) << message;
    EXPECT_NE(message.find("No such file"), std::string::npos) << message;
    EXPECT_EQ(message, error_of([&] { require_image_writable(path(name)); }));
  }
  EXPECT_NE(error_of([&] { write_image(path("a.jpg"), image); }).find(".exr or .png"), std::string::npos);
  EXPECT_NE(error_of([&] { require_image_writable(path("a.jpg")); }).find(".exr or .png"), std::string::npos);
  fs::create_directories(path("folder.exr"));
  EXPECT_NE(error_of([&] { write_image(path("folder.exr"), image); }).find("is a folder"), std::string::npos);
  EXPECT_NE(error_of([&] { require_writable("/dev/null"); }).find("not a regular file"), std::string::npos);
  Image no_colour = random_image(4, 4, {"Z"}, 6);
  EXPECT_NE(error_of([&] { write_image(path("a.png"), no_colour); }).find("R, G and B"), std::string::npos);
  EXPECT_NE(error_of([&] { write_image(path("a.exr"), Image{}); }).find("without pixels"), std::string::npos);
  EXPECT_EQ(files(), 1u);  // folder.exr
}

TEST_F(ImageFile, UnreadableInputsNameThePath) {
  EXPECT_NE(error_of([&] { read_image(path("no.exr")); }).find(path("no.exr") + ": no such file"), std::string::npos);
  EXPECT_NE(error_of([&] { read_image(folder_.string()); }).find("is a folder"), std::string::npos);
  std::ofstream(path("text.exr")) << "not an image\n";
  EXPECT_NE(error_of([&] { read_image(path("text.exr")); }).find("cannot be read"), std::string::npos);
  // Every truncation must end in an image or an Error.
  write_image(path("a.exr"), random_image(16, 16, k_rgb, 7));
  const auto size = fs::file_size(path("a.exr"));
  for (uintmax_t keep = 0; keep < size; keep += size / 7) {
    fs::copy_file(path("a.exr"), path("cut.exr"), fs::copy_options::overwrite_existing);
    fs::resize_file(path("cut.exr"), keep);
    EXPECT_NE(error_of([&] { read_image(path("cut.exr")); }), "no error") << keep;
  }
}

TEST_F(ImageFile, AtomicFileReplacesOnlyOnCommit) {
  write_text_file(path("a.txt"), "old");
  {
    AtomicFile file(path("a.txt"));
    std::ofstream(file.temporary_path()) << "new";
  }
  EXPECT_EQ(files(), 1u);
  std::string text;
  std::ifstream(path("a.txt")) >> text;
  EXPECT_EQ(text, "old");
  fs::create_symlink("a.txt", path("link.txt"));
  write_text_file(path("link.txt"), "linked");
  EXPECT_TRUE(fs::is_symlink(path("link.txt")));
  std::ifstream(path("a.txt")) >> text;
  EXPECT_EQ(text, "linked");
}

TEST_F(ImageFile, RequireWritableLeavesAnExistingFileAlone) {
  write_text_file(path("a.txt"), "kept");
  require_writable(path("a.txt"));
  std::string text;
  std::ifstream(path("a.txt")) >> text;
  EXPECT_EQ(text, "kept");
  EXPECT_EQ(files(), 1u);
}

}  // namespace
}  // namespace fieldtrace
