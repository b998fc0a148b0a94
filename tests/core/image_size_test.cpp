// Images whose headers claim more than their files can hold, and images at the maximum compression of their formats.

#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <vector>

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

// A small frame on a canvas.
std::string gif_of_a_pixel(unsigned width, unsigned height) {
  return gif_header(width, height).substr(0, 19) + "," + word(0) + word(0) + word(1) + word(1) +
         std::string("\0\x02\x02\x4c\x01\0;", 7);
}

std::string jpeg_word(unsigned v) { return {char(v >> 8 & 0xff), char(v & 0xff)}; }
std::string jpeg_segment(unsigned marker, const std::string& body) {
  return "\xff" + std::string(1, char(marker)) + jpeg_word(unsigned(body.size()) + 2) + body;
}

// A grey image whose Huffman tables have one code of one bit each: no difference, and the end of a block.
std::string jpeg_of_zeros(unsigned frame_marker, unsigned width, unsigned height, size_t data_bytes) {
  const auto table = [](unsigned id) { return std::string(1, char(id)) + "\x01" + std::string(16, '\0'); };
  const bool progressive = frame_marker == 0xc2;
  return "\xff\xd8" + jpeg_segment(0xdb, std::string(1, '\0') + std::string(64, '\x01')) +
         jpeg_segment(frame_marker, "\x08" + jpeg_word(height) + jpeg_word(width) + std::string("\x01\x01\x11\0", 4)) +
         jpeg_segment(0xc4, table(0) + table(0x10)) +
         jpeg_segment(0xda, std::string("\x01\x01\0\0", 4) + char(progressive ? 0 : 63) + '\0') +
         std::string(data_bytes, '\0') + "\xff\xd9";
}

// A single strip of a few zeros.
std::string tiff_of_zeros(unsigned compression, unsigned bits, unsigned width, unsigned height) {
  const auto dword = [](unsigned v) { return word(v) + word(v >> 16); };
  const auto entry = [&](unsigned tag, unsigned value) { return word(tag) + word(4) + dword(1) + dword(value); };
  const std::string entries = entry(256, width) + entry(257, height) + entry(258, bits) + entry(259, compression) +
                              entry(262, 1) + entry(273, 8 + 2 + 9 * 12 + 4) + entry(277, 1) + entry(278, height) +
                              entry(279, 16);
  return std::string("II*\0", 4) + dword(8) + word(9) + entries + dword(0) + std::string(16, '\0');
}

std::string bytes_of(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
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

  // Noise or black, written by OpenImageIO: `compression` "NAME" or "NAME:QUALITY".
  std::string write_picture(const std::string& name, const std::string& compression, bool noise, int size) const {
    const std::string path = (folder_ / name).string();
    std::vector<uint8_t> values(size_t(size) * size_t(size) * 3, 0);
    std::mt19937 random(1);
    if (noise) {
      for (uint8_t& v : values) v = uint8_t(random() >> 24);
    }
    OIIO::ImageSpec spec(size, size, 3, OIIO::TypeDesc::UINT8);
    spec.attribute("compression", compression);
    const auto output = OIIO::ImageOutput::create(path);
    const bool written = output && output->open(path, spec) &&
                         output->write_image(OIIO::TypeDesc::UINT8, values.data()) && output->close();
    EXPECT_TRUE(written) << name;
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
      {"a.jpg", jpeg_of_zeros(0xc0, 26000, 26000, 100)},
      {"progressive.jpg", jpeg_of_zeros(0xc2, 26000, 26000, 100)},
      {"plain.tif", tiff_of_zeros(1, 8, 26000, 26000)},
      {"fax.tif", tiff_of_zeros(4, 1, 26000, 26000)},
      {"lzw.tif", tiff_of_zeros(5, 8, 26000, 26000)},
      {"zip.tif", tiff_of_zeros(8, 8, 26000, 26000)},
      {"packbits.tif", tiff_of_zeros(32773, 8, 26000, 26000)},
      {"canvas.gif", gif_of_a_pixel(23000, 23000)},
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

TEST_F(ImageSize, FilesThatEndEarlyAreRefused) {
  for (const char* kind : {"a.jpg jpeg:95", "none.tif none", "zip.tif zip", "lzw.tif lzw", "packbits.tif packbits"}) {
    const std::string both = kind, name = both.substr(0, both.find(' ')), compression = both.substr(name.size() + 1);
    const std::string whole = bytes_of(write_picture(name, compression, true, 200));
    EXPECT_EQ(error_of(name, whole), "no error");
    EXPECT_EQ(error_of(name, whole + std::string(64, '\0')), "no error") << "padded " << name;
    for (const double share : {0.3, 0.5, 0.75, 0.95}) {
      const std::string cut = whole.substr(0, size_t(share * double(whole.size())));
      EXPECT_NE(error_of(name, cut).find("cannot be read as an image: "), std::string::npos) << name << " " << share;
      EXPECT_NE(error_of(name, cut + "\xff\xd9").find("cannot be read"), std::string::npos) << name << " " << share;
    }
  }
}

// Strips whose lengths are right, but whose data end before the picture does.
TEST_F(ImageSize, StripsThatEndEarlyAreRefused) {
  const std::string deflated("\x78\x9c\x63\0\0\0\x01\0\x01", 9);  // one zero, and its check sum
  const struct {
    const char* name;
    unsigned compression;
    std::string data;
  } files[] = {{"none.tif", 1, std::string(16, '\0')},
               {"zip.tif", 8, deflated + std::string(7, '\0')},
               {"packbits.tif", 32773, repeat(std::string("\xff\0", 2), 8)}};
  for (const auto& [name, compression, data] : files) {
    std::string bytes = tiff_of_zeros(compression, 8, 16, 16);
    bytes.replace(bytes.size() - 16, 16, data);
    EXPECT_NE(error_of(name, bytes).find("cannot be read as an image: "), std::string::npos) << name;
  }
}

TEST_F(ImageSize, ASmallFrameOnALargeCanvasIsRead) {
  const Image image = read_image(write("a.gif", gif_of_a_pixel(1500, 1000)));
  EXPECT_EQ(image.width, 1500);
  EXPECT_EQ(image.height, 1000);
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
      // 128 x 128 blocks of two bits, or of one
      {"a.jpg", jpeg_of_zeros(0xc0, 1024, 1024, 128 * 128 / 4), 1024, 1024},
      {"progressive.jpg", jpeg_of_zeros(0xc2, 1024, 1024, 128 * 128 / 8), 1024, 1024},
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
  for (const char* compression : {"zip", "lzw", "packbits", "jpeg"}) {
    const std::string path = write_picture(std::string(compression) + ".tif", compression, false, 2048);
    EXPECT_EQ(read_image(path).height, 2048) << compression;
  }
  EXPECT_EQ(read_image(write_picture("black.jpg", "jpeg:1", false, 2048)).height, 2048);
}

}  // namespace
}  // namespace fieldtrace
