// Slices share the tiles of a picture evenly, whatever its size; parts keep what they are given, and faults of theirs
// are named.
#include "hybrid/film/slice.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>
#include <random>

#include "core/io/scratch_folder.h"
#include "core/platform/error.h"
#include "hybrid/film/part.h"

namespace fieldtrace {
namespace {

// How many tiles each slice has of a window of the grid.
std::vector<int> shares_of(const std::vector<int>& slices, int columns, const Rect& window, int count) {
  std::vector<int> shares(size_t(count), 0);
  for (int y = window.y; y < window.y + window.height; ++y) {
    for (int x = window.x; x < window.x + window.width; ++x)
      shares.at(size_t(slices[size_t(y * columns + x)] - 1)) += 1;
  }
  return shares;
}

int spread(const std::vector<int>& shares) {
  const auto [least, most] = std::minmax_element(shares.begin(), shares.end());
  return *most - *least;
}

TEST(Slices, ShareThePictureAndItsRegionsEvenly) {
  std::mt19937 rng(1);
  for (int i = 0; i < 200; ++i) {
    const int columns = 1 + int(rng() % 70), rows = 1 + int(rng() % 50);
    const int count = i % 2 ? 1 + int(rng() % 12) : 1 + int(rng() % 4000);
    const std::vector<int> slices = slices_of_tiles(columns, rows, count);
    ASSERT_EQ(slices.size(), size_t(columns * rows));
    EXPECT_LE(spread(shares_of(slices, columns, {0, 0, columns, rows}, count)), 1);
    for (int side = 1; side <= std::min(columns, rows); side *= 2) {
      const int x = int(rng() % uint32_t(columns / side)) * side, y = int(rng() % uint32_t(rows / side)) * side;
      EXPECT_LE(spread(shares_of(slices, columns, {x, y, side, side}, count)), 1) << columns << " " << rows;
    }
  }
  EXPECT_TRUE(slices_of_tiles(0, 0, 3).empty());
}

// Parts of one picture may be rendered by different builds of one version.
TEST(Slices, AreFixed) { EXPECT_EQ(slices_of_tiles(4, 3, 3), (std::vector<int>{1, 2, 2, 3, 3, 1, 1, 2, 3, 1, 2, 3})); }

TEST(Slices, AreReadAsTheyAreWritten) {
  EXPECT_EQ(parse_slice("1/1"), (Slice{1, 1}));
  EXPECT_EQ(parse_slice("7/65536"), (Slice{7, k_most_slices}));
  EXPECT_EQ(slice_text(parse_slice("3/8")), "3/8");
  const auto refusal = [](const std::string& text) {
    try {
      parse_slice(text);
    } catch (const UsageError& error) {
      return std::string(error.what());
    }
    return std::string("taken");
  };
  const std::string huge(40, '9');
  for (const std::string& text : {std::string("0/4"), std::string("5/4"), std::string("-1/4"), huge + "/4"})
    EXPECT_NE(refusal(text).find("slices count from 1 to 4"), std::string::npos) << refusal(text);
  for (const std::string& text : {std::string("1/0"), std::string("1/-3"), std::string("1/65537"), "1/" + huge})
    EXPECT_NE(refusal(text).find("a picture has 1 to 65536 slices"), std::string::npos) << refusal(text);
  for (const char* text : {"x/y", "", "/", "1", "1/", "/4", "1/4/", "1 /4", "1.5/4", "+1/4", "0x1/4", "1/4 "})
    EXPECT_NE(refusal(text).find("write two whole numbers K/N"), std::string::npos) << refusal(text);
}

class Parts : public testing::Test {
 protected:
  // Of a picture of 3 x 2 tiles, whose window begins within the first; values tell their place.
  static Part part(int number, int count) {
    Part p;
    p.slice = {number, count};
    p.window = {10, 40, 80, 50};
    p.traced = {8, 40, 88, 56};
    p.identity = {{"--seed", "5"}, {"-D name", "\xff\"\n"}};
    p.decided = {{"fields", "2"}};
    p.channels = {"R", "G", "B", "object.Y", "albedo.R"};
    return p;
  }

  static Image picture() {
    std::mt19937 rng(3);
    Image image;
    image.width = 80, image.height = 50;
    image.channels = part(1, 1).channels;
    for (int i = 0; i < 80 * 50 * 5; ++i) {
      const uint32_t bits = rng();
      float value = 0.0f;
      std::memcpy(&value, &bits, sizeof value);  // any float but signalling NaN
      if (std::isnan(value)) value = std::numeric_limits<float>::quiet_NaN();
      image.data.push_back(value);
    }
    return image;
  }

  // The picture with another value outside of the tiles of the slice.
  static Image image_of(const Part& p) {
    Image image = picture();
    const std::vector<int> slices = slices_of_tiles(3, 2, p.slice.count);
    for (int y = 0; y < 50; ++y) {
      for (int x = 0; x < 80; ++x) {
        const int column = (x + p.window.x - p.traced.x) / 32, row = (y + p.window.y - p.traced.y) / 32;
        if (slices[size_t(3 * row + column)] != p.slice.number) std::fill_n(image.pixel(x, y), 5, -1.0f);
      }
    }
    return image;
  }

  std::string path(const std::string& name) const { return folder_.path() + "/" + name + ".exr"; }
  std::string write(const std::string& name, const Part& p) const {
    write_part(path(name), image_of(p), p, {{"fieldtrace:spp", "4"}});
    return path(name);
  }
  static std::string refusal(const std::vector<std::string>& paths) {
    try {
      merge_parts(paths);
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  }
  static void expect_in(const std::string& part, const std::string& text) {
    EXPECT_NE(text.find(part), std::string::npos) << text;
  }

  ScratchFolder folder_{testing::TempDir(), "parts"};
};

TEST_F(Parts, JoinToThePictureBitForBit) {
  const Image whole = picture();
  for (const int count : {1, 2, 3, 5, 6, 7, 20}) {
    std::vector<std::string> paths;
    for (int k = count; k >= 1; --k) paths.push_back(write(std::to_string(k), part(k, count)));
    const MergedPicture merged = merge_parts(paths);
    EXPECT_EQ(merged.slices, count);
    EXPECT_EQ(merged.metadata.at("fieldtrace:spp"), "4");
    EXPECT_EQ(merged.image.channels, whole.channels);
    ASSERT_EQ(merged.image.data.size(), whole.data.size());
    EXPECT_EQ(std::memcmp(merged.image.data.data(), whole.data.data(), whole.data.size() * sizeof(float)), 0) << count;
  }
}

TEST_F(Parts, WhatIsMissingTwiceOrForeignIsNamed) {
  std::vector<std::string> all;
  for (int k = 1; k <= 6; ++k) all.push_back(write("p" + std::to_string(k), part(k, 6)));
  EXPECT_EQ(refusal(all), "");
  expect_in("slices 2 to 4, 6 of 6 are missing", refusal({all[0], all[4]}));
  expect_in("slice 3 of 6 is missing", refusal({all[0], all[1], all[3], all[4], all[5]}));
  std::vector<std::string> more = all;
  more.push_back(write("again", part(2, 6)));
  expect_in(path("again") + ": is slice 2/6, as " + all[1], refusal(more));
  EXPECT_EQ(refusal(more).find("missing"), std::string::npos);

  Part seed = part(2, 6), decided = part(3, 6), layers = part(4, 6);
  seed.identity[0].second = "6";
  seed.identity.emplace_back("-D x", "1");
  decided.decided = {};
  layers.channels.back() = "albedo.G";
  more = {all[0], write("seed", seed), write("decided", decided), write("count", part(2, 7)), all[4], all[5]};
  {
    Image image = image_of(layers);
    image.channels = layers.channels;
    write_part(path("layers"), image, layers, {});
    more.push_back(path("layers"));
  }
  const std::string faults = refusal(more);
  // Most parts are right, so the first of them is what others differ from, wherever it stands.
  expect_in(path("seed") + ": is a part of another picture than " + all[0] +
                ": --seed is 6 instead of 5, -D x is 1 instead of nothing;",
            faults);
  expect_in(path("decided") + ": is a part of another picture than " + all[0] + ": fields is nothing instead of 2;",
            faults);
  expect_in(path("count") + ": is a part of another picture than " + all[0] + ": it is one of 7 slices, not of 6;",
            faults);
  expect_in(path("layers") + ": is a part of another picture than " + all[0] + ": it has other tiles or layers;",
            faults);
  expect_in("slices 2 to 4 of 6 are missing", faults);
  std::reverse(more.begin(), more.end());
  expect_in(path("seed") + ": is a part of another picture than " + all[5], refusal(more));
}

// Whatever byte is changed, and wherever the file ends.
TEST_F(Parts, DamageIsFound) {
  const std::string file = write("damaged", part(1, 2)), other = write("whole", part(2, 2));
  std::ifstream in(file, std::ios::binary);
  const std::string bytes{std::istreambuf_iterator<char>(in), {}};
  in.close();
  std::mt19937 rng(6);
  const auto put = [&](const std::string& text) { std::ofstream(file, std::ios::binary) << text; };
  int accepted = 0;
  for (int i = 0; i < 200; ++i) {
    std::string damaged = bytes;
    damaged[rng() % damaged.size()] ^= char(1u << (rng() % 8));
    put(damaged);
    const bool held = holds_part(file, part(1, 2));
    EXPECT_EQ(held, refusal({file, other}).empty());
    accepted += held;
    put(bytes.substr(0, rng() % bytes.size()));
    EXPECT_FALSE(holds_part(file, part(1, 2)));
    expect_in(file + ": ", refusal({file, other}));
  }
  // A few bits of the header mean nothing for the pixels.
  EXPECT_LT(accepted, 10);
  put("");
  EXPECT_FALSE(holds_part(file, part(1, 2)));
  expect_in("slice 1 of 2 is missing", refusal({file, other}));
}

TEST_F(Parts, AreToldFromOtherFiles) {
  const std::string file = write("part", part(1, 2));
  EXPECT_TRUE(holds_part(file, part(1, 2)));
  EXPECT_FALSE(holds_part(file, part(2, 2)));
  EXPECT_FALSE(holds_part(file, part(1, 3)));
  EXPECT_FALSE(holds_part(path("none"), part(1, 2)));
  EXPECT_FALSE(holds_part(folder_.path(), part(1, 2)));
  Part other = part(1, 2);
  other.identity[0].second = "6";
  EXPECT_FALSE(holds_part(file, other));
  other = part(1, 2);
  other.decided = {};  // only the render knows
  EXPECT_TRUE(holds_part(file, other));
  write_image(path("picture"), picture(), {});
  EXPECT_FALSE(holds_part(path("picture"), part(1, 2)));
  expect_in(path("picture") + ": is no part of a picture", refusal({file, path("picture")}));
  expect_in(path("none") + ": no such file", refusal({path("none")}));
  std::map<std::string, std::string> metadata;
  ImageReadOptions options;
  options.metadata = &metadata;
  read_image(file, options);
  EXPECT_EQ(slice_of(metadata), (Slice{1, 2}));
  read_image(path("picture"), options);
  EXPECT_EQ(slice_of(metadata), std::nullopt);
}

}  // namespace
}  // namespace fieldtrace
