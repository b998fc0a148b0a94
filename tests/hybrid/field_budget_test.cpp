// The memory of fields: what is charged, that a full budget blocks no thread for ever, and that a render that exceeds
// it makes the same picture whatever the order of its threads.
#include "field/store/field_budget.h"

#include <gtest/gtest.h>

#include <atomic>
#include <span>
#include <thread>

#include "core/mesh/mesh_procedural.h"
#include "field/bake/bake.h"
#include "field/bake/bake_coverage.h"
#include "hybrid/fields/bake_estimate.h"
#include "hybrid/fields/field_set.h"
#include "hybrid/render/render.h"
#include "tests/support/field_checks.h"
#include "tests/support/hybrid_scenes.h"

namespace fieldtrace {
namespace {

constexpr FieldParameters k_small = {32, 64, 4};

TEST(FieldBudget, TakesUpToItsLimitAndNothingAfterARefusal) {
  FieldBudget budget(100);
  EXPECT_TRUE(budget.take(60));
  EXPECT_TRUE(budget.take(40));
  EXPECT_FALSE(budget.exceeded());
  EXPECT_FALSE(budget.take(1));
  EXPECT_TRUE(budget.exceeded());
  EXPECT_EQ(budget.used(), 100u);
  budget.give_back(50);
  EXPECT_FALSE(budget.take(1));  // a later request must not succeed either
  EXPECT_EQ(budget.used(), 50u);
}

TEST(FieldBudget, ThreadsTakeNoMoreThanThereIs) {
  for (const uint64_t limit : {uint64_t(3999), uint64_t(4000)}) {
    FieldBudget budget(limit);
    std::vector<std::thread> threads;
    for (int t = 0; t < 4; ++t) {
      threads.emplace_back([&] {
        for (int i = 0; i < 1000; ++i) budget.take(1);
      });
    }
    for (std::thread& t : threads) t.join();
    EXPECT_LE(budget.used(), limit);
    EXPECT_EQ(budget.exceeded(), limit < 4000);
  }
}

TEST(FieldBudget, AFieldCountsCellsAndTheirTriangles) {
  Field field(test::test_ball(), k_small);
  test::fill_slice(field, FieldLayer::depth, 0);
  test::fill_slice(field, FieldLayer::visibility, 0);
  EXPECT_EQ(field.cells_baked(), 2u * scalar::k_slice_cells);
  EXPECT_EQ(field.primitives_baked(), 0u);
  test::fill_slice(field, FieldLayer::primitive, 0);
  EXPECT_EQ(field.cells_baked(), 2u * scalar::k_slice_cells);
  EXPECT_EQ(field.primitives_baked(), uint64_t(scalar::k_slice_cells));
}

TEST(FieldBudget, AFieldChargesBricksOnceAndGivesThemBack) {
  FieldBudget budget;
  {
    Field field(test::test_ball(), k_small, &budget);
    const uint64_t empty = budget.used();
    test::fill_slice(field, FieldLayer::depth, 0);
    const uint64_t page = uint64_t(field.view().plane_bricks) * sizeof(int32_t);
    EXPECT_EQ(budget.used(), empty + page + 512 * 8);
    test::fill_slice(field, FieldLayer::depth, uint32_t(field.view().plane_bricks));  // another direction of the brick
    EXPECT_EQ(budget.used(), empty + page + 512 * 8);
    test::fill_slice(field, FieldLayer::visibility, 0);
    EXPECT_EQ(budget.used(), empty + page + 512 * 9);
    test::fill_slice(field, FieldLayer::primitive, 0);
    EXPECT_EQ(budget.used(), empty + page + 512 * 13);
    ASSERT_TRUE(field.coverage().claim(5));
    ASSERT_TRUE(field.coverage().finish(5, TileLines(CoverageTiles::k_lines_per_tile, 3)));
    EXPECT_EQ(budget.used(), empty + page + 512 * 13 + 4096 + CoverageTiles::k_tile_bytes);
    EXPECT_EQ(field.bytes(), budget.used());
    EXPECT_LE(field.bytes(), Field::most_bytes(k_small));
  }
  EXPECT_EQ(budget.used(), 0u);
}

TEST(FieldBudget, AFullFieldRefusesClaims) {
  FieldBudget budget(20000);
  Field field(test::test_ball(), k_small, &budget);
  uint32_t filled = 0;
  for (uint32_t slice = 0; slice < 64; ++slice) {
    if (const auto cell = field.claim(FieldLayer::depth, slice)) {
      field.finish(FieldLayer::depth, slice);
      ++filled;
    }
  }
  EXPECT_EQ(filled, 4u);  // of 4096 bytes each
  EXPECT_TRUE(field.pool_full());
  EXPECT_TRUE(budget.exceeded());
  EXPECT_LE(budget.used(), 20000u);
  EXPECT_FALSE(field.finished(FieldLayer::depth, 10));
  EXPECT_FALSE(field.coverage().claim(7));
}

// Bakers wait for what others have claimed; a claim that found no room must not block them.
TEST(FieldBudget, BakersOfAFullFieldEnd) {
  Scene scene;
  Shape& shape = scene.shapes.emplace_back();
  shape.mesh = make_sphere({.around = 32, .along = 16});
  shape.bounds = shape.mesh.bounds();
  const Accel accel(scene);
  for (uint64_t limit = 10000; limit < 4000000; limit *= 3) {
    FieldBudget budget(limit);
    Field field(field_ball(shape.bounds), k_small, &budget);
    std::vector<uint32_t> slices, tiles;
    for (uint32_t i = 0; i < 600; ++i) slices.push_back(i), tiles.push_back(i);
    std::vector<std::thread> threads;
    for (int t = 0; t < 4; ++t) {
      threads.emplace_back([&] {
        BakeCounters counters;
        bake_slices(field, FieldLayer::depth, slices, accel, 0, counters);
        bake_coverage(field, tiles, accel, 0, counters);
      });
    }
    for (std::thread& t : threads) t.join();
    EXPECT_LE(budget.used(), limit);
    EXPECT_TRUE(budget.exceeded() || field.coverage().finished(599));
  }
}

// ---- whole renders

class FieldMemory : public testing::Test {
 protected:
  RenderOptions options() const {
    RenderOptions o;
    o.light_samples = 4;
    o.threads = 2;
    o.directions = 64;
    o.plane = 128;
    o.max_depth = 2;
    return o;
  }
  RenderResult run(const RenderOptions& o) {
    warnings_.clear();
    RenderCallbacks callbacks;
    callbacks.warning = [this](const std::string& line) { warnings_.push_back(line); };
    return render(scene_, o, callbacks);
  }

  const Scene scene_ = test::hybrid_scene("object_over_floor", 40).scene;
  std::vector<std::string> warnings_;
};

TEST_F(FieldMemory, APictureThatOutgrowsItsMemoryDoesNotDependOnThreads) {
  RenderOptions o = options();
  o.light_estimator = LightEstimator::samples;  // of both methods
  o.method = Method::monte_carlo;
  const RenderResult exact = run(o);
  EXPECT_EQ(exact.stats.field_bytes_budget, 0u);
  o.method = Method::hybrid;
  const RenderResult roomy = run(o);
  EXPECT_EQ(roomy.stats.field_restarts, 0u);
  EXPECT_EQ(roomy.stats.field_directions, 64);
  EXPECT_EQ(roomy.stats.field_bytes_peak, roomy.stats.field_bytes_memory);
  EXPECT_TRUE(warnings_.empty());
  const uint64_t need = roomy.stats.field_bytes_peak;
  struct Case {
    uint64_t budget, restarts;
    int directions;  // 0: no fields
  };
  for (const Case& c : {Case{need, 0, 64}, {need * 9 / 10, 1, 32}, {100000, 2, 0}}) {
    std::vector<RenderResult> results;
    for (const int threads : {1, 2, 5}) {
      o.threads = threads;
      o.field_memory = c.budget;
      results.push_back(run(o));
      const Stats& s = results.back().stats;
      EXPECT_EQ(s.field_restarts, c.restarts) << c.budget;
      EXPECT_EQ(warnings_.size(), c.restarts);
      EXPECT_EQ(s.field_directions, c.directions) << c.budget;
      EXPECT_EQ(s.field_bytes_budget, c.budget);
      EXPECT_LE(s.field_bytes_peak, c.budget);
      EXPECT_EQ(results.back().image.data, results.front().image.data) << c.budget << ", threads " << threads;
    }
    if (c.directions == 64) {
      EXPECT_EQ(results[0].image.data, roomy.image.data);
    } else if (c.directions == 0) {
      EXPECT_EQ(results[0].image.data, exact.image.data);
    } else {
      // As accurate as a render whose options request coarse fields.
      RenderOptions coarse = o;
      coarse.field_memory = 0;
      coarse.directions = 32;
      coarse.plane = 64;
      EXPECT_EQ(results[0].image.data, run(coarse).image.data);
      EXPECT_LT(results[0].stats.rays_exact, results[0].stats.rays_crossing);
      EXPECT_GT(results[0].stats.bake_rays, run(coarse).stats.bake_rays);  // those of the first attempt count, too
    }
  }
}

// Cached cells that this picture does not need must not make it exceed the budget.
TEST_F(FieldMemory, APictureThatOutgrowsItsMemoryDoesNotDependOnTheCache) {
  const test::TemporaryFolder folder;
  RenderOptions more = options();
  more.field_cache = folder.path();
  more.light_samples = 64;
  const uint64_t more_need = run(more).stats.field_bytes_peak;
  RenderOptions o = options();
  const RenderResult alone = run(o);
  ASSERT_LT(alone.stats.field_bytes_peak * 11 / 10, more_need);
  o.field_memory = alone.stats.field_bytes_peak * 11 / 10;
  const RenderResult cold = run(o);
  EXPECT_EQ(cold.stats.field_restarts, 0u);
  o.field_cache = folder.path();
  const RenderResult warm = run(o);
  EXPECT_EQ(warm.stats.field_restarts, 1u);
  EXPECT_EQ(warm.stats.field_directions, 64);
  EXPECT_EQ(warm.image.data, cold.image.data);
  // Half the budget: with a cache that holds nothing for the next resolution, then with one that holds all of it.
  o.field_memory = alone.stats.field_bytes_peak / 2;
  const RenderResult first = run(o), second = run(o);
  EXPECT_EQ(first.stats.field_directions, 32);
  EXPECT_EQ(first.image.data, second.image.data);
  o.field_cache.clear();
  EXPECT_EQ(run(o).image.data, first.image.data);
}

// Nor does what is left of a picture whose fields had outgrown their memory when it was interrupted.
TEST_F(FieldMemory, AResumedPictureKeepsItsSmallerFields) {
  const test::TemporaryFolder folder;
  RenderOptions more = options();
  more.field_cache = folder.path() + "/cache";
  more.light_samples = 64;
  run(more);
  RenderOptions o = options();
  o.field_memory = run(o).stats.field_bytes_peak * 9 / 10;
  const RenderResult whole = run(o);
  ASSERT_EQ(whole.stats.field_directions, 32);
  o.checkpoint = folder.path() + "/picture";
  o.checkpoint_seconds = 0.0;
  o.threads = 1;
  std::atomic<bool> stop = false;
  RenderCallbacks callbacks;
  bool is_second = false;
  callbacks.stop = &stop;
  callbacks.warning = [&](const std::string&) { is_second = true; };
  callbacks.tile = [&](const Rect&, std::span<const Rgb>) { stop = is_second; };
  ASSERT_TRUE(render(scene_, o, callbacks).interrupted);
  o.resume = o.checkpoint;
  o.field_cache = more.field_cache;
  const RenderResult resumed = run(o);
  EXPECT_EQ(resumed.stats.field_directions, 32);
  EXPECT_EQ(resumed.image.data, whole.image.data);
  EXPECT_TRUE(warnings_.empty());
}

// If complete fields fit for some objects only, those with the most triangles get them.
TEST(FieldSet, StepsDownToFewerObjects) {
  Scene scene;
  for (const int along : {16, 64, 32, 4}) {  // the last has too few triangles
    Shape& shape = scene.shapes.emplace_back();
    shape.mesh = make_sphere({.around = 32, .along = along});
    shape.bounds = shape.mesh.bounds();
    scene.instances.emplace_back().shape = uint32_t(scene.shapes.size() - 1);
  }
  for (int i = 0; i < 3; ++i) scene.instances.emplace_back().shape = 0;  // together as many triangles as the second
  scene.instances.emplace_back().shape = 0;
  const std::vector<ShapeTraits> traits = shape_traits(scene);
  const uint64_t budget = Field::most_bytes({32, 64, 16}) * 5 / 2;
  FieldPlan plan;
  plan.parameters = {128, 64, 16};
  std::string change;
  for (const int directions : {64, 32}) {
    plan = FieldSet(scene, traits, plan, budget, true).next_plan(change);
    EXPECT_EQ(plan.parameters.directions, directions);
    EXPECT_EQ(plan.parameters.plane, 64);
    EXPECT_NE(change.find(std::to_string(directions) + " x 64"), std::string::npos) << change;
  }
  plan = FieldSet(scene, traits, plan, budget, true).next_plan(change);
  EXPECT_EQ(plan.most_fields, 2u);
  EXPECT_NE(change.find("2 of 3"), std::string::npos) << change;
  const std::vector<Field*> kept = FieldSet(scene, traits, plan, budget, true).pointers();
  ASSERT_EQ(kept.size(), 4u);
  EXPECT_NE(kept[0], nullptr);  // five small instances
  EXPECT_NE(kept[1], nullptr);
  EXPECT_EQ(kept[2], nullptr);
  EXPECT_EQ(kept[3], nullptr);
  EXPECT_TRUE(FieldSet(scene, traits, plan, budget, false).empty());
}

// Where cost does not decide, nothing is left to rays for it.
TEST(FieldSet, LeavesAllWhereCostDecides) {
  const Scene scene = test::hybrid_scene("object_over_floor", 32).scene;
  const std::vector<ShapeTraits> traits = shape_traits(scene);
  FieldPlan plan;
  plan.parameters = k_small;
  for (const bool cost_decides : {false, true}) {
    plan.light_samples = cost_decides ? 1e12 : std::numeric_limits<double>::infinity();
    FieldSet fields(scene, traits, plan, FieldBudget::k_no_limit, true);
    ASSERT_TRUE(fields.answers_shadows());
    fields.leave_all();
    EXPECT_EQ(fields.answers_shadows(), !cost_decides);
    EXPECT_EQ(fields.empty(), cost_decides);
  }
}

// What a survey counts must pay the bake several times over.
TEST(FieldSet, HasFieldsThatPay) {
  const Scene scene = test::hybrid_scene("object_over_floor", 32).scene;
  const std::vector<ShapeTraits> traits = shape_traits(scene);
  FieldPlan plan;
  for (const int directions : {32, 64, 128}) {
    plan.parameters = {directions, 2 * directions};
    double bake = 0.0;  // one shape wants a field
    const std::vector<double> all = estimated_bake_rays(scene, plan.parameters);
    for (size_t s = 0; s < all.size(); ++s) {
      if (!traits[s].wants_field) continue;
      bake += all[s] * coverage_share(plan.parameters);
    }
    ASSERT_GT(bake, 0.0);
    for (const double part : {0.99, 1.01}) {
      FieldSurvey survey;
      survey.uses.resize(scene.shapes.size());
      for (FieldUse& use : survey.uses) use.met = uint64_t(part * k_answers_a_bake_ray * bake);
      plan.light_samples = part * k_answers_a_bake_ray * bake;
      EXPECT_EQ(FieldSet(scene, traits, plan, FieldBudget::k_no_limit, true).answers_shadows(), part > 1.0);
      plan.light_samples = 1e15;
      FieldSet fields(scene, traits, plan, FieldBudget::k_no_limit, true);
      ASSERT_TRUE(fields.answers_shadows());
      fields.leave_unpaid(survey);
      EXPECT_EQ(fields.answers_shadows(), part > 1.0);
    }
  }
}

}  // namespace
}  // namespace fieldtrace
