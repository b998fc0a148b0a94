// Coverage tiles: summed-area tables against the lines they were made of, baking on demand, and files.
#include "field/store/coverage.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <thread>

#include "core/mesh/mesh_procedural.h"
#include "field/bake/bake_coverage.h"
#include "field/file/field_file.h"
#include "field/file/field_info.h"
#include "tests/support/field_checks.h"
#include "tests/support/field_fixture.h"

namespace fieldtrace {
namespace {

constexpr int k_side = scalar::k_tile_lines;

// Lines of a tile: each hits with probability `share`.
TileLines random_lines(TestRandom& random, float share) {
  TileLines lines(CoverageTiles::k_lines_per_tile);
  for (uint16_t& l : lines) {
    l = random.uniform() < share ? uint16_t(1 + random.index(scalar::k_coverage_depths)) : uint16_t(0);
  }
  return lines;
}

// Tiles with the plane of one direction baked: a third of them empty, a third full, a third in between.
struct RandomPlane {
  CoverageTiles tiles{32, 64};
  std::vector<TileLines> all;  // those of the plane, row by row

  RandomPlane(int32_t direction, TestRandom& random) {
    const int count = tiles.view().tiles * tiles.view().tiles;
    for (int t = 0; t < count; ++t) {
      const uint32_t slot = uint32_t(direction * count + t);
      all.push_back(random_lines(random, t % 3 == 0 ? 0.0f : t % 3 == 1 ? 1.0f : 0.4f));
      EXPECT_TRUE(tiles.claim(slot));
      EXPECT_TRUE(tiles.finish(slot, all.back()));
    }
  }

  uint16_t line(int x, int y) const {
    const TileLines& tile = all[size_t(y / k_side * tiles.view().tiles + x / k_side)];
    return tile[size_t(y % k_side * k_side + x % k_side)];
  }
};

// Sums in scalar code, with the last missing tile.
struct Sum {
  int32_t count = 0, depths = 0, missing = -1;
};
Sum sum_of_rect(const CoverageView& view, int32_t direction, const scalar::TexelRect<float>& rect) {
  Sum result;
  const auto sum = scalar::sum_coverage<float>(view, direction, rect, true, [&](int32_t slot, bool missing) {
    if (missing) result.missing = slot;
  });
  EXPECT_EQ(sum.unknown, result.missing >= 0);
  result.count = sum.count;
  result.depths = sum.depths;
  return result;
}

TEST(Coverage, SumsAreThoseOfTheLines) {
  TestRandom random(1);
  constexpr int32_t k_direction = 77;
  const RandomPlane plane(k_direction, random);
  const CoverageView view = plane.tiles.view();
  const int lines = plane.tiles.lines();
  for (int i = 0; i < 2000; ++i) {
    int x[2] = {int(random.index(uint32_t(lines + 1))), int(random.index(uint32_t(lines + 1)))};
    int y[2] = {int(random.index(uint32_t(lines + 1))), int(random.index(uint32_t(lines + 1)))};
    if (x[0] > x[1]) std::swap(x[0], x[1]);
    if (y[0] > y[1]) std::swap(y[0], y[1]);
    int64_t count = 0, depths = 0;
    for (int b = y[0]; b < y[1]; ++b) {
      for (int a = x[0]; a < x[1]; ++a) {
        const uint16_t l = plane.line(a, b);
        count += l != 0;
        depths += l != 0 ? l - 1 : 0;
      }
    }
    const Sum sum = sum_of_rect(view, k_direction, {x[0], x[1], y[0], y[1]});
    ASSERT_EQ(sum.missing, -1);
    ASSERT_EQ(sum.count, count);
    ASSERT_EQ(sum.depths, depths);
  }
}

// Texels that a rectangle covers in part count by the covered area.
TEST(Coverage, AreasWeighTexelsByWhatLiesWithin) {
  TestRandom random(4);
  constexpr int32_t k_direction = 31;
  const RandomPlane plane(k_direction, random);
  const CoverageView view = plane.tiles.view();
  const int side = view.tiles, lines = plane.tiles.lines();
  const auto within = [](float begin, float end, int texel) {
    return double(std::max(0.0f, std::min(end, float(texel + 1)) - std::max(begin, float(texel))));
  };
  for (int i = 0; i < 500; ++i) {
    const float size = random.log_uniform(0.5f, float(lines));
    const auto span = [&](float& begin, float& end) {
      begin = random.index(8) == 0 ? float(random.index(uint32_t(lines))) : random.uniform() * float(lines) * 0.999f;
      end = random.index(8) == 0 ? float(lines) : std::min(begin + size, float(lines));
    };
    scalar::PlaneRect<float> rect;
    span(rect.x0, rect.x1);
    span(rect.y0, rect.y1);
    double count = 0.0;
    for (int b = int(rect.y0); b < std::min(int(rect.y1) + 1, lines); ++b) {
      for (int a = int(rect.x0); a < std::min(int(rect.x1) + 1, lines); ++a) {
        const double share = within(rect.x0, rect.x1, a) * within(rect.y0, rect.y1, b);
        count += plane.line(a, b) != 0 ? share : 0.0;
      }
    }
    const auto area = scalar::sum_coverage_area<float>(view, k_direction, rect, true, [](int, bool) {});
    ASSERT_FALSE(area.unknown);
    // A tile's sums reach 2^10 and are read to 24 bits, four by four, in every tile.
    ASSERT_NEAR(area.count, count, 16.0 * 1024 * 0x1p-24 * side * side);
  }
}

TEST(Coverage, ThinFeatureRatioTellsThinFromSolid) {
  CoverageTiles tiles(32, 64);
  TestRandom random(5);
  TileLines half(CoverageTiles::k_lines_per_tile), stripes(half), noise = random_lines(random, 0.5f);
  for (int i = 0; i < k_side * k_side; ++i) {
    half[size_t(i)] = i % k_side < k_side / 2 ? 9 : 0;
    stripes[size_t(i)] = i % 2 ? 9 : 0;
  }
  float ratio[3];
  const TileLines* const lines[] = {&half, &stripes, &noise};
  for (uint32_t t = 0; t < 3; ++t) {
    ASSERT_TRUE(tiles.claim(t));
    ASSERT_TRUE(tiles.finish(t, *lines[t]));
    ratio[t] = scalar::thin_feature_ratio_at<float>(tiles.view(), 0, int32_t(t) * k_side, 0, true);
  }
  EXPECT_EQ(ratio[0], 0.0f);
  EXPECT_GT(ratio[1], 0.9f);
  EXPECT_GT(ratio[2], 0.3f);
}

TEST(Coverage, TilesThatAreNotBakedAreNamed) {
  CoverageTiles tiles(32, 64);
  const CoverageView view = tiles.view();
  const uint32_t slot = 5u * uint32_t(view.tiles * view.tiles) + 1;
  const scalar::TexelRect<float> rect = {k_side - 1, k_side + 1, 0, 1};
  Sum sum = sum_of_rect(view, 5, rect);
  EXPECT_EQ(uint32_t(sum.missing), slot);
  ASSERT_TRUE(tiles.claim(slot - 1));
  EXPECT_FALSE(tiles.claim(slot - 1));
  EXPECT_GE(sum_of_rect(view, 5, rect).missing, 0);  // claimed, but not baked
  ASSERT_TRUE(tiles.finish(slot - 1, TileLines(CoverageTiles::k_lines_per_tile)));
  sum = sum_of_rect(view, 5, rect);
  EXPECT_EQ(uint32_t(sum.missing), slot);
  ASSERT_TRUE(tiles.claim(slot));
  tiles.give_back(slot);
  ASSERT_TRUE(tiles.claim(slot));
  ASSERT_TRUE(tiles.finish(slot, TileLines(CoverageTiles::k_lines_per_tile, 1)));
  sum = sum_of_rect(view, 5, rect);
  EXPECT_EQ(sum.missing, -1);
  EXPECT_EQ(sum.count, 1);
  EXPECT_EQ(tiles.baked(), (std::vector<uint32_t>{slot - 1, slot}));
}

// The list of baked slots is made from the written parts of the table: it must be complete all the same.
TEST(Coverage, ListsWhatIsBakedAllOverTheTable) {
  TestRandom random(8);
  CoverageTiles tiles(64, 128);
  std::set<uint32_t> expected = {0, 1023, 1024, tiles.slot_count() - 1};
  for (int i = 0; i < 50; ++i) expected.insert(random.index(tiles.slot_count()));
  std::set<uint32_t> parts;
  uint64_t stored = 0;
  for (const uint32_t slot : expected) {
    ASSERT_TRUE(tiles.claim(slot));
    ASSERT_TRUE(tiles.finish(slot, TileLines(CoverageTiles::k_lines_per_tile, uint16_t(slot % 2))));
    stored += slot % 2;
    parts.insert(slot / 1024);
  }
  ASSERT_TRUE(tiles.claim(5000));  // but not finished
  parts.insert(5000 / 1024);
  EXPECT_EQ(tiles.baked(), std::vector<uint32_t>(expected.begin(), expected.end()));
  EXPECT_EQ(tiles.tiles_baked(), expected.size());
  EXPECT_EQ(tiles.tiles_stored(), stored);
  EXPECT_EQ(tiles.bytes(), parts.size() * 4096 + stored * CoverageTiles::k_tile_bytes);
}

// With a full budget no tile is published without its lines.
TEST(Coverage, ATileThatFindsNoRoomIsNotBaked) {
  FieldBudget budget(4096 + 2 * CoverageTiles::k_tile_bytes);
  CoverageTiles tiles(32, 64, &budget);
  const TileLines lines(CoverageTiles::k_lines_per_tile, 7), none(CoverageTiles::k_lines_per_tile, 0);
  for (uint32_t slot = 0; slot < 2; ++slot) {
    ASSERT_TRUE(tiles.claim(slot));
    EXPECT_TRUE(tiles.finish(slot, lines));
  }
  ASSERT_TRUE(tiles.claim(2));
  EXPECT_TRUE(tiles.finish(2, none));  // an empty tile takes no room
  ASSERT_TRUE(tiles.claim(3));
  EXPECT_FALSE(tiles.finish(3, lines));
  EXPECT_FALSE(tiles.finished(3));
  EXPECT_TRUE(tiles.full());
  EXPECT_FALSE(tiles.claim(4));
  EXPECT_EQ(tiles.baked(), (std::vector<uint32_t>{0, 1, 2}));
}

TEST(Coverage, FilesHoldTheTiles) {
  const test::TemporaryFolder folder;
  constexpr FieldParameters p = {32, 64, 8};
  const FieldIdentity identity = test::test_identity(p);
  TestRandom random(9);
  Field field(test::test_ball(), p), other(test::test_ball(), p);
  const uint32_t per_plane = uint32_t(field.coverage().view().tiles * field.coverage().view().tiles);
  const auto bake = [&](Field& f, uint32_t slot, float share) {
    ASSERT_TRUE(f.coverage().claim(slot));
    ASSERT_TRUE(f.coverage().finish(slot, random_lines(random, share)));
  };
  // Eight empty directions in a row, eight of which one is not empty, seven, and some elsewhere.
  for (uint32_t d = 0; d < 8; ++d) {
    bake(field, d * per_plane + 3, 0.0f);
    bake(field, d * per_plane + 4, d == 5 ? 0.3f : 0.0f);
    if (d != 2) bake(field, (d + 16) * per_plane, 0.0f);
    bake(field, (d * 101 + 40) * per_plane + d, 0.5f);
  }
  bake(other, 3, 1.0f);  // the first field's tile wins
  bake(other, 900 * per_plane, 0.7f);
  const Field* const both[] = {&field, &other};
  save_fields(both, identity, folder / "a.vdb");
  Field loaded(test::test_ball(), p);
  load_field(loaded, identity, folder / "a.vdb");
  std::vector<uint32_t> expected = field.coverage().baked();
  expected.insert(std::lower_bound(expected.begin(), expected.end(), 900 * per_plane), 900 * per_plane);
  ASSERT_EQ(loaded.coverage().baked(), expected);
  TileLines a(CoverageTiles::k_lines_per_tile), b(a);
  for (const uint32_t slot : expected) {
    (slot == 900 * per_plane ? other : field).coverage().read(slot, a);
    loaded.coverage().read(slot, b);
    ASSERT_EQ(a, b) << slot;
  }
  const CoverageInfo info = coverage_info(loaded.coverage());
  EXPECT_EQ(info.tiles_baked, expected.size());
  EXPECT_EQ(info.tiles_full, loaded.coverage().slot_count());
  EXPECT_EQ(info.tiles_empty, 8u + 7u + 7u);
  EXPECT_EQ(info.lines_baked, expected.size() * 1024);
  EXPECT_NEAR(double(info.lines_hit) / 1024, 0.3 + 8 * 0.5 + 0.7, 0.3);
}

TEST(Coverage, ReadsBackTheLines) {
  TestRandom random(2);
  CoverageTiles tiles(32, 64);
  const TileLines lines = random_lines(random, 0.5f);
  ASSERT_TRUE(tiles.claim(1234));
  ASSERT_TRUE(tiles.finish(1234, lines));
  TileLines read(CoverageTiles::k_lines_per_tile);
  tiles.read(1234, read);
  EXPECT_EQ(read, lines);
}

// The parallel lines of any direction that meet a ball make a disc, at the sphere's depth.
TEST(Coverage, OfASphereIsADisc) {
  FieldFixture f(make_sphere({.around = 128, .along = 64}), {.directions = 32, .plane = 64});
  CoverageTiles& tiles = f.field().coverage();
  TestRandom random(3);
  // The mesh is smaller than its ball, which encloses the bounding box: its radius over the ball's.
  const float radius = glm::length(f.mesh().positions[0] - f.ball().centre) / f.ball().radius;
  const float step = 2.0f / float(tiles.lines());
  int hits = 0;
  for (int i = 0; i < 40; ++i) {
    const uint32_t slot = random.index(tiles.slot_count());
    BakeCounters counters;
    bake_coverage(f.field(), std::span(&slot, 1), f.accel(), 0, counters);
    ASSERT_TRUE(tiles.finished(slot));
    TileLines lines(CoverageTiles::k_lines_per_tile);
    tiles.read(slot, lines);
    const CoverageTiles::Place place = tiles.place(slot);
    for (int t = 0; t < k_side * k_side; ++t) {
      const float x = (float(place.x + t % k_side) + 0.5f) * step - 1.0f;
      const float y = (float(place.y + t / k_side) + 0.5f) * step - 1.0f;
      const float across = std::sqrt(x * x + y * y);
      if (std::abs(across - radius) < 0.01f) continue;  // the mesh is not an exact sphere
      ASSERT_EQ(lines[size_t(t)] != 0, across < radius) << x << " " << y;
      if (lines[size_t(t)] == 0) continue;
      ++hits;
      const float depth = float(lines[size_t(t)] - 1) * scalar::k_coverage_depth_step - 1.0f;
      const float expected = std::sqrt(radius * radius - across * across);
      // Chords of 128 facets lie up to 2 (pi / 128)^2 inside, more along a grazing line.
      ASSERT_NEAR(depth, expected, scalar::k_coverage_depth_step + 0.003f / std::max(expected, 0.1f)) << x << " " << y;
    }
  }
  EXPECT_GT(hits, 2000);
}

TEST(Coverage, ThreadsBakeEachTileOnce) {
  FieldFixture f(make_sphere({.around = 32, .along = 16}), {.directions = 32, .plane = 64});
  std::vector<uint32_t> slots;
  for (uint32_t s = 0; s < 400; ++s) slots.push_back(s * 7);
  std::vector<BakeCounters> counters(4);
  std::vector<std::thread> threads;
  for (BakeCounters& c : counters) {
    threads.emplace_back([&] { bake_coverage(f.field(), slots, f.accel(), 0, c); });
  }
  for (std::thread& t : threads) t.join();
  for (const uint32_t s : slots) ASSERT_TRUE(f.field().coverage().finished(s));
  uint64_t rays = 0;
  for (const BakeCounters& c : counters) rays += c.rays;
  FieldFixture alone(make_sphere({.around = 32, .along = 16}), {.directions = 32, .plane = 64});
  BakeCounters once;
  bake_coverage(alone.field(), slots, alone.accel(), 0, once);
  EXPECT_EQ(rays, once.rays);
  TileLines a(CoverageTiles::k_lines_per_tile), b(a);
  for (const uint32_t s : slots) {
    f.field().coverage().read(s, a);
    alone.field().coverage().read(s, b);
    ASSERT_EQ(a, b);
  }
}

}  // namespace
}  // namespace fieldtrace
