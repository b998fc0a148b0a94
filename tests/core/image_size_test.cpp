// Images whose headers claim more than their files can hold, and images at the maximum compression of their formats.

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>

#include "core/image/image.h"
#include "core/platform/error.h"

namespace fieldtrace {
namespace {

namespace fs = std::filesystem;

std::string word(unsigned v) { return {char(v & 0xff), char(v >> 8 & 0xff)}; }
std::string repeat(const std::string& s, int n) {
  std::string result;
  for (int i = 0; i < n; ++i) result += s;
  return result;
}

std::string targa_header(int kind, int width, int height, int bits, int palette_size = 0) {
  return std::string(1, '\0') + char(palette_size ? 1 : 0) + char(kind) + word(0) + word(unsigned(palette_size)) +
         char(palette_size ? 32 : 0) + word(0) + word(0) + word(unsigned(width)) + word(unsigned(height)) + char(bits) +
         char(palette_size ? 8 : 0);
}

std::string bitmap_header(int width, int height, int bits, int compression, int colours) {
  const auto dword = [](int v) { return word(unsigned(v)) + word(unsigned(v) >> 16); };
  const int offset = 54 + 4 * colours;
  return "BM" + dword(0) + dword(0) + dword(offset) + dword(40) + dword(width) + dword(height) + word(1) +
         word(unsigned(bits)) + dword(compression) + dword(0) + dword(0) + dword(0) + dword(colours) + dword(0);
}

std::string gif_header(unsigned width, unsigned height) {
  return "GIF89a" + word(width) + word(height) + std::string("\x80\0\0", 3) + std::string(6, '\0') + "," + word(0) +
         word(0) + word(width) + word(height) + std::string(1, '\0');
}

class ImageSize : public testing::Test {
 protected:
  void SetUp() override {
    const auto* info = testing::UnitTest::GetInstance()->current_test_info();
    folder_ = fs::temp_directory_path() / (std::string("fieldtrace_") + info->name() + "_" + std::to_string(getpid()));
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  std::string write(const std::string& name, const std::string& bytes) const {
    const std::string path = (folder_ / name).string();
    std::ofstream(path, std::ios::binary) << bytes;
    return path;
  }

  std::string error_of(const std::string& name, const std::string& bytes) const {
    try {
      read_image(write(name, bytes));
    } catch (const Error& error) {
      return error.what();
    }
    return "no error";
  }

 private:
  fs::path folder_;
};

long peak_memory_kib() {
  rusage usage;
  getrusage(RUSAGE_SELF, &usage);
  return usage.ru_maxrss;
}

TEST_F(ImageSize, AShortFileGetsNoMemory) {
  const struct {
    const char* name;
    std::string bytes;
  } files[] = {
      {"a.ppm", std::string("P6\n26000 26000\n255\n\0", 20)},
      {"a.pfm", "PF\n26000 26000\n-1.0\n"},
      {"a.hdr", "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 26000 +X 26000\n"},
      {"a.tga", targa_header(2, 26000, 26000, 24)},
      {"runs.tga", targa_header(10, 26000, 26000, 24)},
      {"a.bmp", bitmap_header(26000, 26000, 24, 0, 0)},
      {"a.gif", gif_header(23000, 23000) + std::string("\x02\x02\x4c\x01\0;", 6)},
      {"broken.gif", gif_header(65535, 65535) + std::string("\x02\x02\x4c\x01\0;", 6)},
  };
  for (const auto& [name, bytes] : files) {
    const std::string message = error_of(name, bytes);
    EXPECT_NE(message.find("more than its " + std::to_string(bytes.size()) + " bytes can hold"), std::string::npos)
        << message;
    EXPECT_NE(message.find(std::string("/") + name + ": "), std::string::npos) << message;
  }
  // The canvas of even the smaller GIF would be 2 GiB.
  EXPECT_LT(peak_memory_kib(), 1 << 20);
}

TEST_F(ImageSize, EveryReasonIsGiven) {
  const struct {
    const char* name;
    std::string bytes;
  } files[] = {{"a.ppm", std::string("P6\n4 4\n255\n\0", 12)},
               {"a.pfm", std::string("PF\n4 4\n-1.0\n\0\0", 14)},
               {"text.ppm", "P6\nx 4\n255\n"},
               {"a.gif", gif_header(2, 2) + "\x02\x02\x4c"},
               {"empty.hdr", ""}};
  for (const auto& [name, bytes] : files) {
    const std::string message = error_of(name, bytes), start = "cannot be read as an image: ";
    const size_t at = message.find(start);
    ASSERT_NE(at, std::string::npos) << message;
    EXPECT_GT(message.size(), at + start.size() + 10) << message;
    EXPECT_EQ(message.find("vector::"), std::string::npos) << message;
  }
}

// Single-coloured images at their format's maximum compression ratio can be read.
TEST_F(ImageSize, TheBestCompressionIsAccepted) {
  const int n = 1016;                                           // 8 runs of 127
  const std::string row = repeat(std::string("\xff\0", 2), 4);  // 4 runs of 255
  const std::string scanline =
      "\x02\x02" + std::string(1, char(n >> 8)) + char(n & 0xff) + repeat("\xff\x80", 24) + repeat("\xff\x81", 8);
  const struct {
    const char* name;
    std::string bytes;
    int width, height;
  } files[] = {
      {"a.pbm", "P4\n1024 1024\n" + std::string(1024 * 128, '\0'), 1024, 1024},
      {"a.hdr", "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1016 +X 1016\n" + repeat(scanline, n), n, n},
      {"a.tga", targa_header(9, 1024, 1024, 8, 1) + "\x10\x20\x30\xff" + repeat(std::string("\xff\0", 2), 1024 * 8),
       1024, 1024},
      {"a.bmp",
       bitmap_header(1020, 1024, 8, 1, 1) + std::string(4, '\x40') + repeat(row + std::string(2, '\0'), 1023) + row +
           std::string("\0\1", 2),
       1020, 1024},
  };
  for (const auto& [name, bytes, width, height] : files) {
    const Image image = read_image(write(name, bytes));
    EXPECT_EQ(image.width, width) << name;
    EXPECT_EQ(image.height, height) << name;
  }
  Image black{2048, 2048, {"R", "G", "B"}, std::vector<float>(size_t(2048) * 2048 * 3, 0.0f)};
  for (const char* name : {"a.png", "a.exr"}) {
    const std::string path = write(name, "");
    write_image(path, black);
    EXPECT_EQ(read_image(path).height, 2048) << name;
  }
}

}  // namespace
}  // namespace fieldtrace
