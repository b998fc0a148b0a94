// Bakes that wait until enough rays have asked.
#include "field/bake/slice_demand.h"

#include <gtest/gtest.h>

#include <thread>

#include "core/mesh/mesh_procedural.h"
#include "tests/support/field_fixture.h"

namespace fieldtrace {
namespace {

class SliceDemands : public testing::Test {
 protected:
  FieldFixture fixture_{make_sphere({.around = 32, .along = 16}), {.directions = 32, .plane = 64, .lines = 8}};
  SliceDemand demand_{fixture_.field()};
  static constexpr uint32_t k_due = 32 * 8 / k_bake_rays_of_ray;  // visibility: 8 lines in each of 32 cells

  // What is due after that many rays have asked for each.
  std::vector<uint32_t> ask(FieldLayer layer, const std::vector<uint32_t>& slices, uint32_t rays) {
    std::vector<uint32_t> asked;
    for (uint32_t i = 0; i < rays; ++i)
      for (const uint32_t slice : slices) asked.push_back(slice);
    demand_.count(layer, asked);
    return asked;
  }
};

TEST_F(SliceDemands, AreCountedByRayAndLayer) {
  const uint32_t last = fixture_.field().slice_count() - 1;
  EXPECT_EQ(ask(FieldLayer::visibility, {7, 0, last}, k_due - 1), std::vector<uint32_t>());
  EXPECT_EQ(ask(FieldLayer::depth, {7}, 1), std::vector<uint32_t>());
  EXPECT_EQ(ask(FieldLayer::visibility, {last, 3}, 1), std::vector<uint32_t>({last}));
  EXPECT_EQ(ask(FieldLayer::visibility, {last, 7, 0, 3}, 2), std::vector<uint32_t>({0, 7, last}));
  EXPECT_EQ(ask(FieldLayer::visibility, {3}, 1u << 17), std::vector<uint32_t>({3}));  // more than a count holds
  EXPECT_EQ(ask(FieldLayer::visibility, {}, 1), std::vector<uint32_t>());
}

TEST_F(SliceDemands, WaitNoMoreOnceStopped) {
  EXPECT_EQ(ask(FieldLayer::primitive, {4, 2, 4}, 1), std::vector<uint32_t>());
  demand_.stop_waiting();
  EXPECT_EQ(ask(FieldLayer::primitive, {4, 2, 4}, 1), std::vector<uint32_t>({2, 4}));
}

// Counts of threads may be lost, but not for good.
TEST_F(SliceDemands, AreDueWhateverThreadsDo) {
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t) {
    threads.emplace_back([&] {
      for (uint32_t i = 0; i < k_due; ++i) ask(FieldLayer::visibility, {5, 6}, 1);
    });
  }
  for (std::thread& t : threads) t.join();
  EXPECT_EQ(ask(FieldLayer::visibility, {5, 6}, 0), std::vector<uint32_t>());
  EXPECT_EQ(ask(FieldLayer::visibility, {5, 6}, k_due), std::vector<uint32_t>({5, 6}));
}

}  // namespace
}  // namespace fieldtrace
