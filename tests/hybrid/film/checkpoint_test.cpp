// Checkpoint files: what is written is read again, and what is damaged or of another picture is refused.
#include "hybrid/film/checkpoint.h"

#include <gtest/gtest.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <random>

#include "core/io/scratch_folder.h"
#include "core/platform/error.h"

namespace fieldtrace {
namespace {

class CheckpointFile : public testing::Test {
 protected:
  Checkpoint example(bool layers) const {
    std::mt19937 rng(5);
    std::uniform_real_distribution<double> value(0.0, 9.0);
    Checkpoint c;
    c.identity = {{"--seed", "5"}, {"--method", "hybrid"}};
    c.planned_samples = 90, c.expected_samples = 17;
    c.accuracy = FieldAccuracy::coarse_maps, c.field_mean_square = 1.0 / 3.0;
    c.light_samples = 4, c.open_light_samples = 8, c.lobe_samples = 2;
    c.reductions = 2, c.round = 3;
    c.film = FilmSums({1, 2, 5, 7}, layers);
    for (StoredSums& stored : c.film.pixels) {
      PixelSums p;
      for (DVec3& quarter : p.radiance) quarter = DVec3(value(rng));
      p.squares = DVec3(value(rng));
      p.count[0] = p.count[1] = uint32_t(rng() % 100);
      p.work = float(value(rng)), p.seconds = value(rng);
      stored = p;
    }
    for (AovSums& a : c.film.aovs) a.depth = value(rng);
    c.counts = {1, 0, 7};
    c.tiles_done = {1, 0, 1, 1};
    return c;
  }

  std::string bytes() const {
    std::ifstream file(path_, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
  }
  void put(const std::string& text) const { std::ofstream(path_, std::ios::binary) << text; }
  std::string refusal(const PictureIdentity& identity) const {
    try {
      read_checkpoint(path_, identity);
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  }

  ScratchFolder folder_{testing::TempDir(), "checkpoint"};
  std::string path_ = folder_.path() + "/picture.checkpoint";
};

TEST_F(CheckpointFile, HoldsWhatWasWritten) {
  for (const bool layers : {false, true}) {
    const Checkpoint c = example(layers);
    write_checkpoint(path_, c);
    const Checkpoint r = read_checkpoint(path_, c.identity);
    EXPECT_EQ(r.planned_samples, 90);
    EXPECT_EQ(r.expected_samples, 17);
    EXPECT_EQ(r.accuracy, FieldAccuracy::coarse_maps);
    EXPECT_EQ(r.field_mean_square, 1.0 / 3.0);
    EXPECT_EQ(r.light_samples, 4);
    EXPECT_EQ(r.open_light_samples, 8);
    EXPECT_EQ(r.lobe_samples, 2);
    EXPECT_EQ(r.reductions, 2u);
    EXPECT_EQ(r.round, 3u);
    EXPECT_EQ(r.counts, c.counts);
    EXPECT_EQ(r.tiles_done, c.tiles_done);
    EXPECT_EQ(r.film.window.y, 2);
    ASSERT_EQ(r.film.pixels.size(), c.film.pixels.size());
    const size_t size = r.film.pixels.size() * sizeof(StoredSums);
    EXPECT_EQ(std::memcmp(r.film.pixels.data(), c.film.pixels.data(), size), 0);
    ASSERT_EQ(r.film.aovs.size(), c.film.aovs.size());
    for (size_t i = 0; i < r.film.aovs.size(); ++i) EXPECT_EQ(r.film.aovs[i].depth, c.film.aovs[i].depth);
  }
}

TEST_F(CheckpointFile, AnotherPictureIsRefusedByWhatDiffers) {
  write_checkpoint(path_, example(false));
  const std::string message = refusal({{"--seed", "6"}, {"--method", "hybrid"}});
  EXPECT_NE(message.find("--seed is 6 instead of 5"), std::string::npos) << message;
  EXPECT_EQ(message.find("--method"), std::string::npos) << message;
  EXPECT_NE(refusal({{"--seed", "5"}, {"--method", "hybrid"}, {"-D x", "1"}}).find("-D x is 1 instead of nothing"),
            std::string::npos);
  EXPECT_NE(refusal({{"--seed", "5"}}).find("--method is nothing instead of hybrid"), std::string::npos);
}

// Whatever byte is changed, and wherever the file ends.
TEST_F(CheckpointFile, DamageIsFound) {
  const Checkpoint c = example(true);
  write_checkpoint(path_, c);
  const std::string whole = bytes();
  std::mt19937 rng(6);
  for (int i = 0; i < 300; ++i) {
    std::string damaged = whole;
    damaged[rng() % damaged.size()] ^= char(1u << (rng() % 8));
    put(damaged);
    EXPECT_NE(refusal(c.identity), "");
    put(whole.substr(0, rng() % whole.size()));
    EXPECT_NE(refusal(c.identity), "");
  }
  put(whole + "x");
  EXPECT_NE(refusal(c.identity).find("damaged"), std::string::npos);
  put("");
  EXPECT_NE(refusal(c.identity), "");
}

TEST_F(CheckpointFile, WhatCannotBeWrittenOrReadIsNamed) {
  const std::string missing = folder_.path() + "/none/x";
  EXPECT_THROW(write_checkpoint(missing, example(false)), Error);
  EXPECT_THROW(read_checkpoint(missing, {}), Error);
  EXPECT_THROW(read_checkpoint(folder_.path(), {}), Error);
}

}  // namespace
}  // namespace fieldtrace
