// A field's copy on an emulated device holds what was asked for and is finished, and nothing else.
#include "gpu/device_mirror.h"

#include <gtest/gtest.h>

#include <set>

#include "gpu/emulated.h"
#include "tests/gpu/random_questions.h"

namespace fieldtrace::gpu {
namespace {

constexpr int k_words = int(scalar::k_tile_words);

class FieldMirrorTest : public ::testing::Test {
 protected:
  FieldMirrorTest() { runtime_.open(0, {}); }

  // What a wave does with the mirror's packet.
  void update() {
    Packet packet;
    mirror_.stage(packet, 0);
    runtime_.synchronise(0);
    packet.outgrown.clear();
    runs_ = packet.runs.size();
    if (runs_ == 0) return;
    const ScatterArguments arguments = {packet.runs.data(), packet.words.data(), uint32_t(runs_)};
    run_emulated_kernel(Kernel::scatter, arguments.warps, &arguments);
  }

  uint32_t claim(FieldLayer layer, uint32_t slice) {
    const std::optional<uint32_t> cell = field_.claim(layer, slice);
    EXPECT_TRUE(cell);
    for (uint32_t c = *cell; c < *cell + uint32_t(scalar::k_slice_cells); ++c) {
      if (layer == FieldLayer::visibility) {
        field_.store_visibility(c, uint8_t(1 + random_.index(250)));
      } else {
        field_.store_plane_fit(c, uint32_t(random_.index(1 << 30)), 1 + uint32_t(random_.index(1 << 15)));
      }
    }
    return *cell;
  }
  void bake(FieldLayer layer, uint32_t slice) {
    claim(layer, slice);
    field_.finish(layer, slice);
    baked_[int(layer)].insert(slice);
  }
  void bake_tile(uint32_t slot, bool empty) {
    EXPECT_TRUE(field_.coverage().claim(slot));
    TileLines lines(CoverageTiles::k_lines_per_tile);
    for (uint16_t& line : lines) line = empty ? uint16_t(0) : uint16_t(random_.index(1024));
    field_.coverage().finish(slot, lines);
    tiles_.insert(slot);
  }
  void want(MissingKind kind, const std::set<uint32_t>& numbers) {
    std::vector<uint32_t> words = {k_nothing};
    for (const uint32_t n : numbers) words.push_back(missing_word(kind, n));
    mirror_.want(words);
  }

  // Cells of a slice in a view, as look-ups find them.
  static size_t first_cell(const FieldView& v, uint32_t slice) {
    const uint32_t direction = slice / uint32_t(v.plane_bricks);
    const int32_t page = v.top[direction / 16];
    const int32_t brick = v.pages[size_t(page) * size_t(v.plane_bricks) + slice % uint32_t(v.plane_bricks)];
    return size_t(brick) * scalar::k_brick_cells + direction % 16 * uint32_t(scalar::k_slice_cells);
  }

  // Every slice and tile of the chart: the field's if it was wanted and finished, else zero.
  void expect_holds(const std::set<uint32_t>& visibility, const std::set<uint32_t>& depth,
                    const std::set<uint32_t>& tiles) {
    const FieldView a = field_.view(), b = mirror_.view();
    size_t wrong = 0;
    for (uint32_t slice = 0; slice < field_.slice_count(); ++slice) {
      const size_t from = first_cell(a, slice), to = first_cell(b, slice);
      for (int c = 0; c < scalar::k_slice_cells; ++c) {
        const size_t i = from + size_t(c), j = to + size_t(c);
        wrong += b.visibility[j] != (visibility.count(slice) ? a.visibility[i] : 0);
        wrong += b.certificate[j] != (depth.count(slice) ? a.certificate[i] : 0);
        wrong += depth.count(slice) && b.depth[j] != a.depth[i];
      }
    }
    EXPECT_EQ(wrong, 0u);
    for (uint32_t slot = 0; slot < field_.coverage().slot_count(); ++slot) {
      const int32_t from = a.coverage.tile_of[slot], to = b.coverage.tile_of[slot];
      if (!tiles.count(slot) || from < 2) {
        wrong += to != (tiles.count(slot) ? from : 0);
      } else {
        wrong += to < 2 || !std::equal(a.coverage.sums + from * k_words, a.coverage.sums + (from + 1) * k_words,
                                       b.coverage.sums + to * k_words);
      }
    }
    EXPECT_EQ(wrong, 0u);
    for (int i = 0; i < 2 * k_words; ++i) wrong += b.coverage.sums[i] != 0;
    EXPECT_EQ(wrong, 0u);
  }

  Field field_{Sphere{Vec3(0.0f), 1.0f}, {32, 64}};
  TestRandom random_{1};
  const std::shared_ptr<EmulatedLog> log_ = std::make_shared<EmulatedLog>();
  EmulatedRuntime runtime_{EmulatedFaults{}, log_};
  DeviceMemory memory_{runtime_, uint64_t(1) << 30};
  FieldMirror mirror_{field_, memory_};
  size_t runs_ = 0;
  std::set<uint32_t> baked_[2], tiles_;
};

TEST_F(FieldMirrorTest, BeginsEmpty) {
  bake(FieldLayer::visibility, 5);
  bake_tile(3, false);
  update();
  expect_holds({}, {}, {});
}

TEST_F(FieldMirrorTest, WaitsForWhatIsNotFinished) {
  bake(FieldLayer::visibility, 5);
  claim(FieldLayer::visibility, 6);
  claim(FieldLayer::depth, 7);
  ASSERT_TRUE(field_.coverage().claim(9));
  want(MissingKind::visibility, {5, 6, 8});
  want(MissingKind::depth, {5, 7});
  want(MissingKind::tile, {9});
  update();
  expect_holds({5}, {}, {});
  field_.finish(FieldLayer::visibility, 6);
  field_.finish(FieldLayer::depth, 7);
  update();  // without being asked again
  expect_holds({5, 6}, {7}, {});
  update();
  EXPECT_EQ(runs_, 0u);
}

// Radiance maps are tiles alone, each with the radiance of its lines.
TEST_F(FieldMirrorTest, HoldsRadianceBesideTiles) {
  const RandomMaps maps(16, 32, 0.5f, random_);
  FieldMirror mirror({maps.tiles(), maps.view()}, memory_);
  std::vector<uint32_t> words;
  for (uint32_t slot = 0; slot < maps.tiles().slot_count(); slot += 3) {
    words.push_back(missing_word(MissingKind::tile, slot));
  }
  mirror.want(words);
  Packet packet;
  mirror.stage(packet, 0);
  runtime_.synchronise(0);
  const ScatterArguments arguments = {packet.runs.data(), packet.words.data(), uint32_t(packet.runs.size())};
  run_emulated_kernel(Kernel::scatter, arguments.warps, &arguments);
  const CoverageView a = maps.view().coverage, b = mirror.view().coverage;
  ASSERT_NE(b.radiance, nullptr);
  size_t wrong = 0, stored = 0;
  for (uint32_t slot = 0; slot < maps.tiles().slot_count(); ++slot) {
    const int32_t from = slot % 3 == 0 ? a.tile_of[slot] : 0, to = b.tile_of[slot];
    if (from < 2) {
      wrong += to != from;
      continue;
    }
    ++stored;
    const float* const radiance = a.radiance + from * 3 * k_words;
    wrong += to < 2 || !std::equal(a.sums + from * k_words, a.sums + (from + 1) * k_words, b.sums + to * k_words) ||
             !std::equal(radiance, radiance + 3 * k_words, b.radiance + to * 3 * k_words);
  }
  EXPECT_EQ(wrong, 0u);
  EXPECT_GT(stored, 50u);
  EXPECT_EQ(mirror.view().visibility, nullptr);
  EXPECT_EQ(log_->misuse, 0u);
}

// As much as makes every pool grow several times, in several waves.
TEST_F(FieldMirrorTest, KeepsWhatItHoldsAsItGrows) {
  std::set<uint32_t> visibility, depth, tiles;
  for (int wave = 0; wave < 6; ++wave) {
    std::set<uint32_t> v, d, t;
    for (int i = 0; i < 150; ++i) {
      const uint32_t slice = uint32_t(random_.index(field_.slice_count())), slot = uint32_t(random_.index(4096));
      if (!baked_[0].count(slice)) bake(FieldLayer::visibility, slice);
      if (!baked_[1].count(slice)) bake(FieldLayer::depth, slice);
      if (!tiles_.count(slot)) bake_tile(slot, i % 5 == 0);
      // Of some, only one layer; some twice.
      if (i % 3) v.insert(slice);
      if (i % 4) d.insert(slice);
      if (i % 2) t.insert(slot);
    }
    want(MissingKind::visibility, v), want(MissingKind::depth, d), want(MissingKind::tile, t);
    want(MissingKind::visibility, v);
    visibility.merge(v), depth.merge(d), tiles.merge(t);
    update();
    expect_holds(visibility, depth, tiles);
  }
  EXPECT_EQ(log_->misuse, 0u);
}

}  // namespace
}  // namespace fieldtrace::gpu
