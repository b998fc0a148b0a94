// Files read without OpenVDB hold what OpenVDB reads from them; whatever is unusual or damaged is declined.
#include "field/grid/plain_vdb.h"

#include <gtest/gtest.h>

#include <cstring>
#include <fstream>
#include <iterator>
#include <limits>
#include <random>

#include "tests/support/field_checks.h"
#include "tests/support/vdb_leaf.h"

namespace fieldtrace {
namespace {

constexpr int k_most_grids = 5;

const VdbMetadata k_metadata = {{"name of a string", std::string("text")},
                                {"whole", int32_t(-7)},
                                {"long", int64_t(1) << 40},
                                {"real", 0.1f},
                                {"point", std::array<float, 3>{1.0f, -2.0f, 3e30f}}};

std::shared_ptr<const std::string> written(const std::vector<VdbGridPtr>& grids) {
  const test::TemporaryFolder folder;
  std::vector<const VdbGrid*> all;
  for (const VdbGridPtr& grid : grids) all.push_back(grid.get());
  vdb().write(folder / "a.vdb", all, k_metadata);
  std::ifstream in(folder / "a.vdb", std::ios::binary);
  return std::make_shared<const std::string>(std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>());
}

std::vector<VdbGridPtr> one(VdbGridPtr grid) {
  std::vector<VdbGridPtr> grids;
  grids.push_back(std::move(grid));
  return grids;
}

// Leaves of 1 to 512 active voxels, of values that pack well and of those that do not, and tiles, in many nodes.
VdbGridPtr random_grid(const char* name, int32_t background, int leaves, int tiles, std::mt19937& random) {
  VdbGridPtr grid = vdb().create(name, background);
  const auto origin = [&] {
    VoxelCoord c;
    for (int32_t& axis : c) axis = int32_t(random() % (random() % 2 ? 2048u : 32u)) * k_vdb_leaf_side;
    return c;
  };
  for (int i = 0; i < tiles; ++i) vdb().add_tile(*grid, origin(), int32_t(random()));
  for (int i = 0; i < leaves; ++i) {
    VdbLeaf leaf;
    const uint32_t density = random() % 4, range = random() % 2 ? 3u : ~0u;
    for (int v = 0; v < k_vdb_leaf_voxels; ++v) {
      leaf.values[size_t(v)] = int32_t(random() & range);
      const uint32_t one_in = density == 0 ? 1u : density == 1 ? 2u : density == 2 ? 40u : 400u;
      if (random() % one_in == 0) leaf.active[size_t(v) / 64] |= uint64_t(1) << (v % 64);
    }
    leaf.active[0] |= 1;
    vdb().add_leaf(*grid, origin(), leaf);
  }
  return grid;
}

void expect_same(const VdbStoredGrid& a, const VdbStoredGrid& b) {
  EXPECT_EQ(a.name, b.name);
  EXPECT_EQ(a.background, b.background);
  ASSERT_EQ(a.leaves.size(), b.leaves.size());
  ASSERT_EQ(a.tiles.size(), b.tiles.size());
  for (size_t i = 0; i < a.tiles.size(); ++i) {
    EXPECT_EQ(a.tiles[i].origin, b.tiles[i].origin);
    EXPECT_EQ(a.tiles[i].side, b.tiles[i].side);
    EXPECT_EQ(a.tiles[i].value, b.tiles[i].value);
    EXPECT_EQ(find_by_origin(a.tiles, b.tiles[i].origin), &a.tiles[i]);
    EXPECT_EQ(find_by_origin(a.leaves, b.tiles[i].origin), nullptr);
  }
  for (size_t i = 0; i < a.leaves.size(); ++i) {
    EXPECT_EQ(a.leaves[i].origin, b.leaves[i].origin);
    EXPECT_EQ(a.leaves[i].active, b.leaves[i].active);
    EXPECT_EQ(find_by_origin(a.leaves, b.leaves[i].origin), &a.leaves[i]);
    VdbValues of_a, of_b;
    ASSERT_TRUE(a.unpack(a.leaves[i], of_a));
    ASSERT_TRUE(b.unpack(b.leaves[i], of_b));
    EXPECT_EQ(of_a, of_b);
  }
}

TEST(PlainVdb, HoldsWhatOpenVdbReads) {
  std::mt19937 random(3);
  for (int repeat = 0; repeat < 6; ++repeat) {
    std::vector<VdbGridPtr> grids;
    grids.push_back(random_grid("depth", 0, 40, 5, random));
    grids.push_back(random_grid("no tiles", -1, 7, 0, random));
    grids.push_back(random_grid("tiles alone", 65535, 0, 9, random));
    grids.push_back(vdb().create("empty, and so left out", 3));
    const auto bytes = written(grids);
    const std::optional<VdbFile> plain = read_plain_vdb(bytes, k_most_grids);
    ASSERT_TRUE(plain);
    const VdbFile expected = vdb().read(*bytes, k_most_grids);
    EXPECT_EQ(plain->metadata, k_metadata);
    EXPECT_EQ(expected.metadata, k_metadata);
    ASSERT_EQ(plain->grids.size(), 3u);
    ASSERT_EQ(expected.grids.size(), 3u);
    for (size_t g = 0; g < 3; ++g) expect_same(plain->grids[g], expected.grids[g]);
  }
}

TEST(PlainVdb, FindsNothingWhereNothingIs) {
  const std::optional<VdbFile> file = read_plain_vdb(written(one([] {
                                                       VdbGridPtr grid = vdb().create("a", 0);
                                                       vdb().add_leaf(*grid, {8, 16, 24}, test::leaf_of(5, 1));
                                                       return grid;
                                                     }())),
                                                     k_most_grids);
  ASSERT_TRUE(file && file->grids.size() == 1);
  EXPECT_NE(find_by_origin(file->grids[0].leaves, {8, 16, 24}), nullptr);
  for (const VoxelCoord& origin : {VoxelCoord{0, 0, 0}, {8, 16, 16}, {8, 16, 32}, {16, 0, 0}}) {
    EXPECT_EQ(find_by_origin(file->grids[0].leaves, origin), nullptr);
    EXPECT_EQ(find_by_origin(file->grids[0].tiles, origin), nullptr);
  }
}

TEST(PlainVdb, DeclinesWhatIsUnusual) {
  std::mt19937 random(5);
  const std::string usual = *written(one(random_grid("a", 0, 3, 2, random)));
  const auto reads = [](std::string bytes, int most_grids = k_most_grids) {
    return read_plain_vdb(std::make_shared<const std::string>(std::move(bytes)), most_grids).has_value();
  };
  EXPECT_TRUE(reads(usual));
  EXPECT_TRUE(reads(usual + "what follows the last grid"));
  EXPECT_FALSE(reads(usual, 0));
  EXPECT_FALSE(reads(""));
  const auto with = [&](size_t at, char value) {
    std::string bytes = usual;
    bytes[at] = value;
    return bytes;
  };
  EXPECT_FALSE(reads(with(0, 'x')));        // the magic number
  EXPECT_FALSE(reads(with(8, char(223))));  // the format
  EXPECT_FALSE(reads(with(20, 0)));         // offsets of grids
  const size_t type = usual.find("Tree_int32_5_4_3");
  ASSERT_NE(type, std::string::npos);
  EXPECT_FALSE(reads(with(type + 5, 'u')));
  const size_t scale = usual.find("UniformScaleMap");
  ASSERT_NE(scale, std::string::npos);
  EXPECT_FALSE(reads(with(scale, 'A')));
  // Before the first voxel of any field, and twice the same name.
  VdbGridPtr negative = vdb().create("a", 0);
  vdb().add_leaf(*negative, {-8, 0, 0}, test::leaf_of(0, 1));
  const auto before = written(one(std::move(negative)));
  EXPECT_FALSE(reads(*before));
  EXPECT_EQ(vdb().read(*before, k_most_grids).grids.size(), 1u);
  std::vector<VdbGridPtr> twice;
  for (int i = 0; i < 2; ++i) twice.push_back(random_grid("a", 0, 1, 0, random));
  const auto same_names = written(twice);
  EXPECT_FALSE(reads(*same_names));
  EXPECT_EQ(vdb().read(*same_names, k_most_grids).grids[1].name, "a");
}

// Sizes and places that no file of OpenVDB's has.
TEST(PlainVdb, DeclinesWhatPointsElsewhere) {
  VdbGridPtr grid = vdb().create("a", 0);
  for (const int32_t z : {0, 4096}) vdb().add_leaf(*grid, {0, 0, z}, test::leaf_of(9, 1));
  const std::string usual = *written(one(std::move(grid)));
  const auto reads = [](std::string bytes) {
    return read_plain_vdb(std::make_shared<const std::string>(std::move(bytes)), k_most_grids).has_value();
  };
  ASSERT_TRUE(reads(usual));
  const auto with = [&](size_t at, auto value) {
    std::string bytes = usual;
    bytes.replace(at, sizeof value, reinterpret_cast<const char*>(&value), sizeof value);
    return reads(std::move(bytes));
  };
  // Behind the transform: a count of buffers, the background, counts of tiles and children, and the first child, whose
  // two masks a code and the size of its values follow.
  const std::string scale = "UniformScaleMap";
  const size_t tree = usual.find(scale) + scale.size() + 5 * 3 * sizeof(double);
  const size_t child = tree + 16, size = child + 12 + 2 * 4096 + 1;
  EXPECT_TRUE(with(tree, int32_t(1)));
  EXPECT_FALSE(with(tree, int32_t(2)));
  EXPECT_FALSE(with(tree + 8, uint32_t(1)));
  EXPECT_FALSE(with(tree + 12, uint32_t(3)));
  EXPECT_FALSE(with(tree + 12, ~uint32_t(0)));
  for (const int32_t axis : {1, 8, 2048, -4096, std::numeric_limits<int32_t>::min(), 1 << 30}) {
    for (const size_t at : {child, child + 4, child + 8}) EXPECT_FALSE(with(at, axis)) << axis;
  }
  EXPECT_FALSE(with(child + 8, int32_t(4096))) << "twice the same";
  EXPECT_FALSE(with(child + 8, int32_t(8192))) << "not in order";
  int64_t bytes;
  std::memcpy(&bytes, usual.data() + size, sizeof bytes);
  EXPECT_TRUE(with(size, bytes));
  for (const int64_t other : {int64_t(0), int64_t(-1), bytes - 1, bytes + 1, std::numeric_limits<int64_t>::min(),
                              std::numeric_limits<int64_t>::max()}) {
    EXPECT_FALSE(with(size, other)) << other;
  }
  // The leaf's mask stands in the file twice.
  EXPECT_FALSE(with(usual.rfind(std::string("\0\x02\0", 3)) + 1, uint8_t(3)));
}

// A checksum comes before it in field files; alone it must stand as much.
TEST(PlainVdb, SurvivesDamage) {
  std::mt19937 random(9);
  const std::string usual = *written(one(random_grid("a", 0, 6, 2, random)));
  int declined = 0;
  for (int i = 0; i < 4000; ++i) {
    std::string bytes = usual;
    if (i % 4 == 0) {
      bytes.resize(random() % usual.size());
    } else {
      for (int k = 0; k < 1 + i % 3; ++k) bytes[random() % bytes.size()] ^= char(1u << random() % 8);
    }
    const auto file = read_plain_vdb(std::make_shared<const std::string>(std::move(bytes)), k_most_grids);
    declined += !file;
    EXPECT_FALSE(file && i % 4 == 0) << "cut short";
    if (!file) continue;
    for (const VdbStoredGrid& grid : file->grids) {
      VdbValues values;
      for (const VdbStoredLeaf& leaf : grid.leaves) grid.unpack(leaf, values);
    }
  }
  EXPECT_GT(declined, 1500);  // and some that are not
}

}  // namespace
}  // namespace fieldtrace
