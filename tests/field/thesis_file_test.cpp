// Thesis fields in files, grid by grid: what is no sample of a field is refused, and tiles of any size are read.
#include "field/file/thesis_file.h"

#include <gtest/gtest.h>

#include <functional>

#include "field/file/field_vdb.h"
#include "tests/support/field_checks.h"
#include "tests/support/vdb_leaf.h"

namespace fieldtrace {
namespace {

using test::TemporaryFolder;

constexpr int k_m = 32;

FieldIdentity identity() {
  FieldIdentity i;
  i.chart = k_chart_thesis;
  i.parameters = {.directions = k_m, .plane = 0, .lines = 0};
  i.primitive_count = 1;
  return i;
}

// The field of a file whose distances are what `fill` adds to an empty grid.
ThesisField load(const std::function<void(VdbGrid&)>& fill, int32_t background = k_thesis_miss) {
  const TemporaryFolder folder;
  std::vector<VdbGridPtr> grids;
  grids.push_back(vdb().create("distance", background));
  fill(*grids[0]);
  const std::string path = folder / "a.vdb";
  write_field_vdb(grids, identity(), {{0.0f, 0.0f, 0.0f}, 1.0f}, path);
  return load_thesis_field(identity(), path);
}

TEST(ThesisFile, PutsEverySampleInItsPlace) {
  const ThesisField field = load([](VdbGrid& grid) {
    vdb().add_leaf(grid, {8, 16, 24}, test::leaf_of(64 * 1 + 8 * 2 + 3, 7));
    vdb().add_tile(grid, {4216, 0, 8}, 9);
  });
  size_t others = 0;
  for (size_t i = 0; i < field.samples(); ++i) {
    const int z = int(i % k_m), y = int(i / k_m % k_m), x = int(i / k_m / k_m), value = field.view().distance[i];
    if (x == 9 && y == 18 && z == 27) {
      EXPECT_EQ(value, 7);
    } else if (x >= 4216 && x < 4224 && y < 8 && z >= 8 && z < 16) {
      EXPECT_EQ(value, 9) << i;
    } else {
      others += value != k_thesis_miss;
    }
  }
  EXPECT_EQ(others, 0u);
}

TEST(ThesisFile, RefusesWhatIsNoSampleOfAField) {
  const auto leaf = [](const VoxelCoord& origin, int voxel, int32_t value) {
    return [=](VdbGrid& grid) { vdb().add_leaf(grid, origin, test::leaf_of(voxel, value)); };
  };
  EXPECT_NO_THROW(load(leaf({4224, 24, 24}, 64 + 63, k_thesis_miss)));          // the last one
  EXPECT_THROW(load(leaf({4224, 24, 24}, 2 * 64, 1)), FieldFileError);          // behind the last position
  EXPECT_THROW(load(leaf({0, 32, 0}, 0, 1)), FieldFileError);                   // behind the last v
  EXPECT_THROW(load(leaf({0, 0, 32}, 0, 1)), FieldFileError);                   // behind the last u
  EXPECT_THROW(load(leaf({-8, 0, 0}, 0, 1)), FieldFileError);                   // before the first
  EXPECT_THROW(load(leaf({0, 0, 0}, 0, k_thesis_miss + 1)), FieldFileError);    // no byte
  EXPECT_THROW(load(leaf({0, 0, 0}, 0, -1)), FieldFileError);                   // no byte
  EXPECT_THROW(load(leaf({0, 0, 0}, 0, 1), /*background=*/0), FieldFileError);  // the rest is no miss
  EXPECT_THROW(load([](VdbGrid& g) { vdb().add_tile(g, {4224, 0, 0}, 1); }), FieldFileError);  // sticks out
}

}  // namespace
}  // namespace fieldtrace
