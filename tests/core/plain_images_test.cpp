// Images that are read without OpenImageIO are what OpenImageIO reads; what it alone can read, or must refuse, is left
// to it.

#include "core/image/plain_images.h"

#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "core/io/scratch_folder.h"
#include "core/platform/module.h"

namespace fieldtrace {
namespace {

DecodedImage by_openimageio(const std::string& path) {
  const auto decode =
      reinterpret_cast<ImageDecoder*>(module_function(k_image_decoder_module, k_image_decoder_function));
  DecodedImage result;
  decode(path, result);
  return result;
}

// NaN, too, must be the same.
bool same_bits(const std::vector<float>& a, const std::vector<float>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0;
}

struct Written {
  std::vector<std::string> channels = {"R", "G", "B"};
  OIIO::TypeDesc type = OIIO::TypeDesc::HALF;
  std::string compression = "zip";
  int tile = 0, x = 0, y = 0;
  int width = 61, height = 37;
};

std::vector<float> random_pixels(size_t count) {
  std::mt19937 random(7);
  std::uniform_real_distribution<float> exponent(-20.0f, 15.0f);
  std::vector<float> data(count);
  for (float& v : data) v = std::exp2(exponent(random));
  return data;
}

void write(const std::string& path, const Written& w) {
  OIIO::ImageSpec spec(w.width, w.height, int(w.channels.size()), w.type);
  spec.channelnames = w.channels;
  spec.x = w.x, spec.y = w.y;
  spec.tile_width = spec.tile_height = w.tile;
  spec.attribute("compression", w.compression);
  spec.attribute("fieldtrace:command", "render me");
  const auto output = OIIO::ImageOutput::create(path);
  ASSERT_TRUE(output && output->open(path, spec)) << path;
  const std::vector<float> data = random_pixels(size_t(w.width) * size_t(w.height) * w.channels.size());
  ASSERT_TRUE(output->write_image(OIIO::TypeDesc::FLOAT, data.data())) << output->geterror();
  ASSERT_TRUE(output->close());
}

std::string bytes_of(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

void write_bytes(const std::string& path, const std::string& bytes) { std::ofstream(path, std::ios::binary) << bytes; }

// A Radiance picture without runs.
std::string flat_hdr(int width, int height, size_t pixels, const std::string& signature = "#?RADIANCE") {
  std::string bytes =
      signature + "\nFORMAT=32-bit_rle_rgbe\n\n-Y " + std::to_string(height) + " +X " + std::to_string(width) + "\n";
  for (size_t i = 0; i < pixels; ++i) bytes += {char(i % 251 + 3), char(i % 241), char(i % 239), char(120 + i % 17)};
  return bytes;
}

class PlainImages : public testing::Test {
 protected:
  std::string file(const std::string& name) const { return folder_.path() + "/" + name; }
  void expect_as_openimageio(const std::string& path) {
    DecodedImage plain;
    ASSERT_TRUE(read_plain_image(path, plain)) << path;
    const DecodedImage other = by_openimageio(path);
    EXPECT_EQ(plain.image.width, other.image.width);
    EXPECT_EQ(plain.image.height, other.image.height);
    EXPECT_EQ(plain.image.channels, other.image.channels);
    EXPECT_EQ(plain.is_integer, other.is_integer);
    EXPECT_TRUE(same_bits(plain.image.data, other.image.data)) << path;
  }
  void expect_left(const std::string& path) {
    DecodedImage result;
    result.image.width = 123;
    EXPECT_FALSE(read_plain_image(path, result)) << path;
    EXPECT_EQ(result.image.width, 123);
  }

  const ScratchFolder folder_{std::filesystem::temp_directory_path().string(), "fieldtrace_plain_images"};
};

TEST_F(PlainImages, ExrIsWhatOpenImageIOReads) {
  using OIIO::TypeDesc;
  const std::vector<Written> all = {{},
                                    {.type = TypeDesc::FLOAT, .compression = "none"},
                                    {.channels = {"R", "G", "B", "A"}, .compression = "piz"},
                                    {.channels = {"Y"}, .type = TypeDesc::FLOAT, .compression = "zips"},
                                    {.channels = {"Y", "A"}, .type = TypeDesc::FLOAT},
                                    {.compression = "rle", .x = -5, .y = 11},
                                    {.compression = "dwaa", .tile = 16},
                                    {.channels = {"R", "G"}, .compression = "pxr24"},
                                    {.compression = "b44", .width = 1, .height = 1}};
  for (size_t i = 0; i < all.size(); ++i) {
    const std::string path = file(std::to_string(i) + ".exr");
    write(path, all[i]);
    expect_as_openimageio(path);
  }
}

TEST_F(PlainImages, StringsOfTheHeaderAreKept) {
  const std::string path = file("a.exr");
  write(path, {});
  DecodedImage read;
  ASSERT_TRUE(read_plain_image(path, read));
  EXPECT_EQ(read.metadata["fieldtrace:command"], "render me");
}

TEST_F(PlainImages, HdrIsWhatOpenImageIOReads) {
  write(file("runs.hdr"), {.type = OIIO::TypeDesc::FLOAT});  // coded in runs
  expect_as_openimageio(file("runs.hdr"));
  write(file("wide.hdr"), {.type = OIIO::TypeDesc::FLOAT, .width = 1031, .height = 3});
  expect_as_openimageio(file("wide.hdr"));
  write_bytes(file("flat.hdr"), flat_hdr(16, 9, 16 * 9));
  expect_as_openimageio(file("flat.hdr"));
  write_bytes(file("narrow.hdr"), flat_hdr(5, 9, 5 * 9, "#?RGBE"));
  expect_as_openimageio(file("narrow.hdr"));
  std::string black = flat_hdr(8, 2, 8 * 2);
  for (size_t i = 4; i <= black.size() / 2; i += 8) black[black.size() - i + 3] = '\0';  // exponents of 0
  write_bytes(file("black.hdr"), black);
  expect_as_openimageio(file("black.hdr"));
}

// Wherever a file is cut off, and whichever byte is wrong, nothing is read that OpenImageIO would not read.
TEST_F(PlainImages, DamageIsLeftToOpenImageIO) {
  write(file("whole.exr"), {});
  write(file("runs.hdr"), {.type = OIIO::TypeDesc::FLOAT});
  write_bytes(file("flat.hdr"), flat_hdr(16, 9, 16 * 9));
  for (const std::string name : {"whole.exr", "runs.hdr", "flat.hdr"}) {
    const std::string bytes = bytes_of(file(name)), path = file("damaged" + name.substr(name.find('.')));
    for (size_t size = 0; size < bytes.size(); size += 1 + size / 40) {
      write_bytes(path, bytes.substr(0, size));
      expect_left(path);
    }
    write_bytes(path, bytes.substr(0, bytes.size() - 1));
    expect_left(path);
    for (size_t at = 0; at < bytes.size(); at += 3 + at / 10) {
      std::string damaged = bytes;
      damaged[at] = char(damaged[at] ^ 0x55);
      write_bytes(path, damaged);
      DecodedImage read;
      if (!read_plain_image(path, read)) continue;
      const DecodedImage other = by_openimageio(path);
      EXPECT_EQ(read.image.width, other.image.width) << name << " " << at;
      EXPECT_EQ(read.image.height, other.image.height) << name << " " << at;
      EXPECT_EQ(read.image.channels, other.image.channels) << name << " " << at;
      ASSERT_EQ(read.image.data.size(), other.image.data.size()) << name << " " << at;
      size_t differ = 0;  // in more than OpenImageIO's rounding of tiny values
      for (size_t i = 0; i < read.image.data.size(); ++i) {
        const float a = read.image.data[i], b = other.image.data[i];
        differ += !(std::abs(a - b) <= 1e-6f * std::abs(b)) && !(std::isnan(a) && std::isnan(b)) && a != b;
      }
      EXPECT_EQ(differ, 0u) << name << " " << at;
    }
  }
}

// Of other encodings, or of none that is named.
TEST_F(PlainImages, OnlyRgbeIsRead) {
  const std::string good = flat_hdr(16, 9, 16 * 9), format = "FORMAT=32-bit_rle_rgbe\n";
  const size_t at = good.find(format);
  ASSERT_NE(at, std::string::npos);
  const auto with = [&](const std::string& line) {
    std::string bytes = good;
    bytes.replace(at, format.size(), line);
    write_bytes(file("a.hdr"), bytes);
  };
  for (const char* line : {"FORMAT=32-bit_rle_xyze\n", "", "FORMAT=32-bit_rle_rgbe\r\n"}) {
    with(line);
    expect_left(file("a.hdr"));
  }
  with("# a comment\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=1\n");
  expect_as_openimageio(file("a.hdr"));
}

TEST_F(PlainImages, HeadersThatPromiseTooMuchAreLeft) {
  write_bytes(file("large.hdr"), flat_hdr(30000, 20000, 40));
  expect_left(file("large.hdr"));
  write(file("a.exr"), {});
  std::string bytes = bytes_of(file("a.exr"));
  const size_t at = bytes.find("dataWindow");
  ASSERT_NE(at, std::string::npos);
  const size_t corner = at + std::strlen("dataWindow") + 1 + std::strlen("box2i") + 1 + 4 + 8;
  // More than the file can hold; and more than memory should, where the file could hold it.
  for (const int32_t side : {100000, 30000}) {
    const int32_t far[] = {side, side};
    std::memcpy(&bytes[corner], far, sizeof far);
    write_bytes(file("large.exr"), bytes + std::string(side == 30000 ? 1000000 : 0, 'x'));
    expect_left(file("large.exr"));
  }
}

TEST_F(PlainImages, LayersAndOtherFormatsAreLeft) {
  write(file("layers.exr"), {.channels = {"R", "G", "B", "depth.Z"}});
  write(file("integers.exr"), {.type = OIIO::TypeDesc::UINT});
  write(file("a.png"), {.type = OIIO::TypeDesc::UINT8});
  for (const char* name : {"layers.exr", "integers.exr", "a.png", "missing.exr"}) expect_left(file(name));
}

}  // namespace
}  // namespace fieldtrace
