// Direction maps in files and in the cache: bit for bit what was stored, and nothing else.
#include "field/file/maps_file.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <optional>
#include <random>

#include "field/file/field_cache.h"
#include "field/file/field_vdb.h"
#include "field/file/thesis_file.h"
#include "tests/support/field_checks.h"
#include "tests/support/vdb_leaf.h"

namespace fieldtrace {
namespace {

namespace fs = std::filesystem;
using test::TemporaryFolder;
using test::test_ball;

constexpr MapSize k_small = {4, 16};

FieldIdentity identity_of(const MapSize& size) {
  FieldIdentity i = test::test_identity({.directions = size.directions, .plane = size.texels, .lines = 0});
  i.chart = k_chart_maps;
  return i;
}

// Finished maps with depths of all 16 bits: directions without a hit, some with equal depths alone, and others.
DirectionMaps random_maps(const MapSize& size) {
  DirectionMaps maps(test_ball(), size);
  std::mt19937 random(7);
  for (int d = 0; d < int(size.maps()); ++d) {
    uint16_t* const depths = maps.depths(d);
    for (int i = 0; d % 16 >= 8 && i < size.texels * size.texels; ++i) {
      const uint32_t r = random();
      depths[i] = d / 16 % 2 == 0 ? 65535 : r % 3 == 0 ? 0 : uint16_t(r >> 16);
    }
    if (d % 16 == 3) depths[size.texels * size.texels - 1] = 1;
    maps.finish(d);
  }
  return maps;
}

bool same(const DirectionMaps& a, const DirectionMaps& b) {
  const MapsView va = a.view(), vb = b.view();
  return a.size() == b.size() && a.ball().centre == b.ball().centre && a.ball().radius == b.ball().radius &&
         std::memcmp(va.depth, vb.depth, 2 * a.size().lines()) == 0 &&
         std::memcmp(va.coverage, vb.coverage, a.size().maps() * uint64_t(va.coverage_bytes)) == 0;
}

TEST(MapsFile, LoadsWhatWasSavedBitForBit) {
  const TemporaryFolder folder;
  for (const MapSize size : {MapSize{4, 8}, MapSize{4, 256}, MapSize{16, 32}, MapSize{12, 16}, MapSize{128, 8}}) {
    const DirectionMaps maps = random_maps(size);
    const uint64_t bytes = save_direction_maps(maps, identity_of(size), folder / "a.vdb");
    EXPECT_EQ(bytes, fs::file_size(folder / "a.vdb"));
    EXPECT_TRUE(same(load_direction_maps(identity_of(size), test_ball(), folder / "a.vdb"), maps)) << size.texels;
  }
  const DirectionMaps empty(test_ball(), k_small);
  save_direction_maps(empty, identity_of(k_small), folder / "a.vdb");
  EXPECT_TRUE(same(load_direction_maps(identity_of(k_small), test_ball(), folder / "a.vdb"), empty));
}

TEST(MapsFile, InfoTellsWhatItHolds) {
  const TemporaryFolder folder;
  const DirectionMaps maps = random_maps({16, 32});
  save_direction_maps(maps, identity_of(maps.size()), folder / "a.vdb");
  const MapsFileInfo info = maps_file_info(folder / "a.vdb");
  const uint16_t* const depths = maps.depths(0);
  EXPECT_EQ(info.hits, maps.size().lines() - size_t(std::count(depths, depths + maps.size().lines(), uint16_t(0))));
  EXPECT_EQ(info.size, maps.size());
  EXPECT_EQ(info.header.identity, identity_of(maps.size()));
  EXPECT_EQ(info.header.ball.radius, test_ball().radius);
  EXPECT_EQ(info.bytes_disk, fs::file_size(folder / "a.vdb"));
  EXPECT_EQ(info.bytes_memory, maps.bytes());
}

// ---- files made by hand

// The maps of a file whose depths are what `fill` adds to an empty grid.
DirectionMaps load(const std::function<void(VdbGrid&)>& fill, int32_t background = 0,
                   const FieldIdentity& identity = identity_of(k_small)) {
  const TemporaryFolder folder;
  std::vector<VdbGridPtr> grids;
  grids.push_back(vdb().create("depth", background));
  fill(*grids[0]);
  write_field_vdb(grids, identity, test_ball(), folder / "a.vdb");
  return load_direction_maps(identity, test_ball(), folder / "a.vdb");
}

TEST(MapsFile, AVoxelIsDirectionRowAndColumn) {
  const DirectionMaps maps = load([](VdbGrid& g) {
    vdb().add_leaf(g, {8, 0, 8}, test::leaf_of(64 * 1 + 8 * 2 + 3, 77));
  });
  DirectionMaps expected(test_ball(), k_small);
  expected.depths(9)[2 * k_small.texels + 11] = 77;
  expected.finish(9);
  EXPECT_TRUE(same(maps, expected));
}

TEST(MapsFile, RefusesWhatNoBakeWrites) {
  const auto leaf = [](const VoxelCoord& origin, int32_t value) {
    return [=](VdbGrid& grid) { vdb().add_leaf(grid, origin, test::leaf_of(511, value)); };
  };
  EXPECT_NO_THROW(load(leaf({8, 8, 8}, 65535)));               // the last texel
  EXPECT_THROW(load(leaf({16, 0, 0}, 1)), FieldFileError);     // behind the last direction
  EXPECT_THROW(load(leaf({0, 16, 0}, 1)), FieldFileError);     // behind the last row
  EXPECT_THROW(load(leaf({0, 0, 16}, 1)), FieldFileError);     // behind the last column
  EXPECT_THROW(load(leaf({-8, 0, 0}, 1)), FieldFileError);     // before the first
  EXPECT_THROW(load(leaf({0, 0, 0}, 65536)), FieldFileError);  // no 16 bits
  EXPECT_THROW(load(leaf({0, 0, 0}, -1)), FieldFileError);     // no depth
  EXPECT_THROW(load(leaf({0, 0, 0}, 0)), FieldFileError);      // a miss that is active
  EXPECT_THROW(load(leaf({0, 0, 0}, 1), /*background=*/5), FieldFileError);
  EXPECT_THROW(load([](VdbGrid& g) { vdb().add_tile(g, {0, 0, 0}, 1); }), FieldFileError);
  for (const MapSize size : {MapSize{2, 16}, MapSize{6, 16}, MapSize{256, 16}, MapSize{4, 4}, MapSize{4, 512}}) {
    EXPECT_THROW(load([](VdbGrid&) {}, 0, identity_of(size)), FieldFileError) << size.directions << " " << size.texels;
  }
  FieldIdentity lines = identity_of(k_small);
  lines.parameters.lines = 8;
  EXPECT_THROW(load([](VdbGrid&) {}, 0, lines), FieldFileError);
}

// ---- the cache

TEST(MapsFile, NamesDifferForEveryMeshAndSizeAndFromFields) {
  Shape a, b;
  a.mesh.positions = b.mesh.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  a.mesh.triangles = b.mesh.triangles = {{0, 1, 2}};
  b.mesh.positions[2].z = 1;
  const std::string name = maps_identity(a, DMat3(1.0), {32, 64}).file_name();
  EXPECT_EQ(maps_identity(a, DMat3(1.0), {32, 64}).file_name(), name);
  EXPECT_NE(maps_identity(b, DMat3(1.0), {32, 64}).file_name(), name);
  EXPECT_NE(maps_identity(a, DMat3(1.0), {16, 64}).file_name(), name);
  EXPECT_NE(maps_identity(a, DMat3(1.0), {32, 128}).file_name(), name);
  EXPECT_NE(field_identity(a, {32, 64, 0}).file_name(), name);
  EXPECT_NE(thesis_identity(a, 32).file_name(), maps_identity(a, DMat3(1.0), {32, 0}).file_name());
}

class MapsCache : public testing::Test {
 protected:
  std::optional<DirectionMaps> load() { return cache_.load_maps(identity_of(k_small), test_ball()); }

  const TemporaryFolder folder_;
  std::vector<std::string> warnings_;
  FieldCache cache_{folder_.path(), [this](const std::string& line) { warnings_.push_back(line); }};
  const std::string path_ = cache_.path_of(identity_of(k_small));
  const DirectionMaps maps_ = random_maps(k_small);
};

TEST_F(MapsCache, KeepsWhatIsStored) {
  EXPECT_FALSE(load());
  cache_.store(maps_, identity_of(k_small));
  EXPECT_TRUE(same(*load(), maps_));
  EXPECT_EQ(cache_.bytes_on_disk(identity_of(k_small)), fs::file_size(path_));
  EXPECT_FALSE(cache_.load_maps(identity_of({8, 16}), test_ball()));  // another size
  EXPECT_FALSE(cache_.load_maps(identity_of({4, 32}), test_ball()));
  EXPECT_TRUE(warnings_.empty());
}

TEST_F(MapsCache, DamagedAndForeignFilesAreToldAboutAndReplaced) {
  const auto spoil = [&](const std::function<void()>& how, const char* word) {
    cache_.store(maps_, identity_of(k_small));
    how();
    warnings_.clear();
    EXPECT_FALSE(load());
    ASSERT_EQ(warnings_.size(), 1u) << word;
    EXPECT_EQ(warnings_[0].rfind(path_ + ": ", 0), 0u) << warnings_[0];
    EXPECT_NE(warnings_[0].find(word), std::string::npos) << warnings_[0];
    EXPECT_NE(warnings_[0].find("baked again"), std::string::npos) << warnings_[0];
    cache_.store(maps_, identity_of(k_small));
    const auto replaced = load();
    EXPECT_TRUE(replaced && same(*replaced, maps_)) << word;
  };
  spoil([&] { fs::resize_file(path_, fs::file_size(path_) / 2); }, "cut short");
  spoil([&] { fs::resize_file(path_, 0); }, "cut short");
  spoil([&] { std::ofstream(path_, std::ios::binary) << std::string(1 << 16, 'x'); }, "no field file");
  // Any byte: each is checked before one is decoded.
  for (const double share : {0.01, 0.5, 0.99}) {
    spoil(
        [&] {
          std::fstream file(path_, std::ios::binary | std::ios::in | std::ios::out);
          const auto at = std::streamoff(share * double(fs::file_size(path_) - 32));
          file.seekg(at);
          const char byte = char(file.get());
          file.seekp(at);
          file.put(char(byte ^ 4));
        },
        "damaged");
  }
  FieldIdentity other = identity_of(k_small);
  other.geometry.high ^= 1;
  spoil([&] { save_direction_maps(maps_, other, path_); }, "another mesh");
  const MapSize finer = {8, 16};
  spoil([&] { save_direction_maps(random_maps(finer), identity_of(finer), path_); }, "other parameters");
  const DirectionMaps moved({test_ball().centre, 3.0f}, k_small);
  spoil([&] { save_direction_maps(moved, identity_of(k_small), path_); }, "another mesh");
  constexpr FieldParameters k_field = {32, 64, 8};
  Field field(test_ball(), k_field);
  test::fill_random_slices(field, 1, 10);
  spoil([&] { save_field(field, test::test_identity(k_field), path_); }, "chart");
}

TEST_F(MapsCache, FieldsRefuseTheFilesOfMaps) {
  cache_.store(maps_, identity_of(k_small));
  EXPECT_THROW(FieldFile{path_}, FieldFileError);
  EXPECT_THROW(thesis_file_info(path_), FieldFileError);
  EXPECT_EQ(field_file_chart(path_), k_chart_maps);
}

TEST_F(MapsCache, CountAgainstTheLimitUnlessInUse) {
  cache_.store(maps_, identity_of(k_small));
  FieldCache user(folder_.path(), 1, [this](const std::string& line) { warnings_.push_back(line); });
  EXPECT_TRUE(user.load_maps(identity_of(k_small), test_ball()));
  user.trim();
  EXPECT_TRUE(fs::exists(path_));
  EXPECT_EQ(warnings_.size(), 1u);  // more than the limit by itself
  FieldCache(folder_.path(), 1).trim();
  EXPECT_FALSE(fs::exists(path_));
}

}  // namespace
}  // namespace fieldtrace
