#include "hybrid/compare/tradeoff.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <filesystem>
#include <set>

namespace fieldtrace {
namespace {

namespace fs = std::filesystem;

constexpr double k_rounding = 1e-12;  // a few operations in double

using Relation = TimeAtError::Relation;

TEST(SecondsAtError, MeetsThePoints) {
  const std::vector<ErrorPoint> points = {{4.0, 0.01}, {1.0, 0.02}, {16.0, 0.005}};
  for (const ErrorPoint& p : points) {
    const TimeAtError time = seconds_at_error(points, p.rmse);
    EXPECT_NEAR(time.seconds, p.seconds, k_rounding * p.seconds);
    EXPECT_EQ(time.relation, Relation::equals);
  }
}

// Beyond the ends there is no law: the noise of light samples falls faster than samples^-1/2.
TEST(SecondsAtError, BeyondTheEndsIsMoreOrLessThanThese) {
  const std::vector<ErrorPoint> points = {{4.0, 0.01}, {1.0, 0.02}, {16.0, 0.005}};
  for (const double rmse : {0.0049999, 0.0025, 1e-9}) {
    const TimeAtError time = seconds_at_error(points, rmse);
    EXPECT_EQ(time.relation, Relation::more_than) << rmse;
    EXPECT_EQ(time.seconds, 16.0) << rmse;
  }
  for (const double rmse : {0.0200001, 0.04, 1e9}) {
    const TimeAtError time = seconds_at_error(points, rmse);
    EXPECT_EQ(time.relation, Relation::less_than) << rmse;
    EXPECT_EQ(time.seconds, 1.0) << rmse;
  }
}

TEST(SecondsAtError, IsLinearInLogLogBetweenPoints) {
  // Slope -3 instead of -2: halving the error takes eight times as long.
  const std::vector<ErrorPoint> points = {{1.0, 0.08}, {8.0, 0.04}, {64.0, 0.02}};
  const double between = 0.08 / std::sqrt(2.0);
  EXPECT_NEAR(seconds_at_error(points, between).seconds, std::sqrt(8.0), 100 * k_rounding);
}

TEST(SecondsAtError, DecreasesWithTheError) {
  const std::vector<ErrorPoint> points = {{1.0, 0.03}, {3.0, 0.02}, {30.0, 0.004}};
  double last = std::numeric_limits<double>::infinity();
  for (double rmse = 0.0041; rmse < 0.03; rmse *= 1.1) {
    const double seconds = seconds_at_error(points, rmse).seconds;
    EXPECT_LT(seconds, last) << rmse;
    last = seconds;
  }
}

TEST(SecondsAtError, WithoutUsablePointsThereIsNoAnswer) {
  EXPECT_TRUE(std::isnan(seconds_at_error({}, 0.1).seconds));
  EXPECT_TRUE(std::isnan(seconds_at_error({{0.0, 0.1}, {1.0, 0.0}, {1.0, NAN}}, 0.1).seconds));
  EXPECT_TRUE(std::isnan(seconds_at_error({{1.0, 0.1}}, 0.0).seconds));
  EXPECT_TRUE(std::isnan(seconds_at_error({{1.0, 0.1}}, NAN).seconds));
  EXPECT_NEAR(seconds_at_error({{1.0, 0.1}, {2.0, NAN}}, 0.1).seconds, 1.0, k_rounding);
}

bool ends_with(const std::string& text, const std::string& end) {
  return text.size() >= end.size() && text.compare(text.size() - end.size(), end.size(), end) == 0;
}

TEST(TradeoffCsv, RowsHaveTheColumnsOfTheHeader) {
  const auto columns = [](const std::string& line) { return std::count(line.begin(), line.end(), ',') + 1; };
  TradeoffRow row;
  EXPECT_EQ(columns(tradeoff_csv_row(row, {})), columns(tradeoff_csv_header()));
  EXPECT_EQ(columns(tradeoff_csv_row(row, {{1.0, 0.1}})), columns(tradeoff_csv_header()));
  EXPECT_EQ(tradeoff_csv_row(row, {}).rfind("hybrid,", 0), 0u);
  row.options.method = Method::monte_carlo;
  EXPECT_EQ(tradeoff_csv_row(row, {}).rfind("montecarlo,", 0), 0u);
}

TEST(TradeoffCsv, SaysWhereMonteCarloWasNotMeasured) {
  EXPECT_TRUE(ends_with(tradeoff_csv_header(), ",montecarlo_relation,montecarlo_seconds"));
  TradeoffRow monte_carlo;
  monte_carlo.options.method = Method::monte_carlo;
  monte_carlo.seconds_cold = 4.0;
  monte_carlo.difference.rmse = 0.01;
  TradeoffRow row;  // hybrid
  row.seconds_cold = 1.0;
  row.difference.rmse = 0.01;
  const std::vector<ErrorPoint> points = monte_carlo_points({monte_carlo, row});
  ASSERT_EQ(points.size(), 1u);
  EXPECT_TRUE(ends_with(tradeoff_csv_row(row, points), ",equals,4")) << tradeoff_csv_row(row, points);
  row.difference.rmse = 0.001;
  EXPECT_TRUE(ends_with(tradeoff_csv_row(row, points), ",more_than,4")) << tradeoff_csv_row(row, points);
  row.difference.rmse = 0.1;
  EXPECT_TRUE(ends_with(tradeoff_csv_row(row, points), ",less_than,4")) << tradeoff_csv_row(row, points);
  EXPECT_TRUE(ends_with(tradeoff_csv_row(row, {}), ",,")) << tradeoff_csv_row(row, {});
}

TEST(TradeoffCsv, PartsHaveTheColumnsOfTheirHeader) {
  const auto columns = [](const std::string& line) { return std::count(line.begin(), line.end(), ',') + 1; };
  EXPECT_EQ(columns(parts_csv_row({})), columns(parts_csv_header()));
}

TEST(TradeoffRows, AreComparedWithMonteCarloOfTheirLadder) {
  std::vector<TradeoffRow> rows(4);
  const Ladder ladders[] = {Ladder::samples, Ladder::target, Ladder::time, Ladder::resolution};
  for (size_t i = 0; i < rows.size(); ++i) {
    rows[i].options.method = Method::monte_carlo;
    rows[i].ladder = ladders[i];
    rows[i].seconds_cold = double(i + 1);
    rows[i].difference.rmse = 0.1;
  }
  for (const Ladder ladder : {Ladder::samples, Ladder::time, Ladder::resolution}) {
    ASSERT_EQ(monte_carlo_points(rows, ladder).size(), 1u);
    EXPECT_EQ(monte_carlo_points(rows, ladder)[0].seconds, 1.0);
  }
  ASSERT_EQ(monte_carlo_points(rows, Ladder::target).size(), 1u);
  EXPECT_EQ(monte_carlo_points(rows, Ladder::target)[0].seconds, 2.0);
}

// The definition, tried for each number of frames.
TEST(FramesToPay, IsTheFirstNumberThatCostsLess) {
  using Pay = FramesToPay::Relation;
  for (const double cold : {1.0, 1.5, 3.0, 10.0}) {
    for (const double monte_carlo : {0.5, 1.013, 1.31, 2.1, 20.0}) {  // no ties
      const double warm = 1.0;
      const FramesToPay f = frames_to_pay(cold, warm, {monte_carlo, Relation::equals});
      int first = 0;
      for (int n = 1; n < 10000 && first == 0; ++n) {
        if (cold + (n - 1) * warm < n * monte_carlo) first = n;
      }
      EXPECT_EQ(f.relation, first ? Pay::equals : Pay::never) << cold << " " << monte_carlo;
      EXPECT_EQ(f.frames, first) << cold << " " << monte_carlo;
    }
  }
}

TEST(FramesToPay, SaysWhatMonteCarloLeavesOpen) {
  using Pay = FramesToPay::Relation;
  EXPECT_EQ(frames_to_pay(3.0, 1.0, {2.0, Relation::more_than}).relation, Pay::at_most);
  EXPECT_EQ(frames_to_pay(3.0, 1.0, {2.0, Relation::less_than}).relation, Pay::at_least);
  EXPECT_EQ(frames_to_pay(3.0, 1.0, {0.5, Relation::more_than}).relation, Pay::unknown);
  EXPECT_EQ(frames_to_pay(3.0, 1.0, {0.5, Relation::less_than}).relation, Pay::never);
  EXPECT_EQ(frames_to_pay(3.0, 1.0, {NAN, Relation::equals}).relation, Pay::unknown);
  // Noise of timing: a warm render that took longer.
  EXPECT_EQ(frames_to_pay(0.9, 1.0, {2.0, Relation::equals}).frames, 1.0);
}

TEST(TradeoffPlan, TheReferenceHasItsOwnSeedAndMoreSamples) {
  Scene scene;
  scene.seed = 5;
  for (const bool quick : {false, true}) {
    TradeoffPlanOptions options;
    options.quick = quick;
    const TradeoffPlan plan = make_tradeoff_plan(scene, options);
    EXPECT_EQ(plan.reference.method, Method::monte_carlo);
    std::set<Method> methods;
    for (const auto& [c, ladder] : plan.cases) {
      methods.insert(c.method);
      EXPECT_LT(c.spp, plan.reference.spp);
      EXPECT_NE(c.seed, plan.reference.seed);
      EXPECT_NE(*c.seed, *plan.reference.seed + 1);  // that of its second half
    }
    EXPECT_EQ(methods.size(), 2u);
  }
}

// A floor under a rectangular light, 24 x 16 pixels.
Scene small_scene() {
  Scene scene;
  scene.textures.push_back({});
  scene.bsdfs.push_back({});
  Shape rectangle;
  rectangle.kind = ShapeKind::rectangle;
  rectangle.name = "rectangle";
  rectangle.mesh.positions = {{-1, -1, 0}, {1, -1, 0}, {1, 1, 0}, {-1, 1, 0}};
  rectangle.mesh.normals.assign(4, Vec3(0, 0, 1));
  rectangle.mesh.texcoords = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
  rectangle.mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  rectangle.bounds = rectangle.mesh.bounds();
  scene.shapes.push_back(rectangle);
  const auto place = [&](const DAffine& to_world, uint32_t emitter) {
    Instance instance;
    instance.emitter = emitter;
    instance.to_world = Affine(to_world);
    instance.to_object = Affine(inverse_affine(to_world));
    scene.instances.push_back(instance);
  };
  place(DAffine(DVec3(4, 0, 0), DVec3(0, 4, 0), DVec3(0, 0, 4), DVec3(0)), k_none);
  // Rotated about x by 180 degrees, so that the light's normal points down.
  place(DAffine(DVec3(0.5, 0, 0), DVec3(0, -0.5, 0), DVec3(0, 0, -0.5), DVec3(0, 0, 2)), 0);
  Emitter light;
  light.instance = 1;
  light.value = Rgb(5.0f);
  scene.emitters.push_back(light);
  // From above, looking down: the camera's +z is the world's -z.
  scene.camera.to_world = Affine(Vec3(1, 0, 0), Vec3(0, -1, 0), Vec3(0, 0, -1), Vec3(0.2f, 0.1f, 6.0f));
  scene.film.width = 24;
  scene.film.height = 16;
  scene.film.crop = {0, 0, 24, 16};
  scene.film.filter = FilterKind::box;
  scene.film.filter_radius = 0.5f;
  return scene;
}

class TradeoffRun : public testing::Test {
 protected:
  void SetUp() override {
    const auto* info = testing::UnitTest::GetInstance()->current_test_info();
    folder_ = fs::temp_directory_path() /
              (std::string("fieldtrace_tradeoff_") + info->name() + "_" + std::to_string(getpid()));
    fs::remove_all(folder_);
    fs::create_directories(folder_);
    plan_.reference.method = Method::monte_carlo;
    plan_.reference.spp = 64;
    plan_.reference.seed = 9;
    for (const Method method : {Method::monte_carlo, Method::hybrid}) {
      RenderOptions options;
      options.method = method;
      options.spp = 2;
      plan_.cases.push_back({options});
    }
  }
  void TearDown() override { fs::remove_all(folder_); }

  fs::path folder_;
  TradeoffPlan plan_;
};

TEST_F(TradeoffRun, MeasuresEveryCaseAndLeavesNoCache) {
  std::vector<TradeoffRow> rows;
  float last_share = 0.0f;
  TradeoffCallbacks callbacks;
  callbacks.row = [&](const TradeoffRow& row, const Image& image) {
    rows.push_back(row);
    EXPECT_EQ(image.width, 24);
  };
  callbacks.render.progress = [&](float share, const char*) {
    EXPECT_GE(share, last_share);
    EXPECT_LE(share, 1.0f);
    last_share = share;
  };
  TradeoffReference reference;
  EXPECT_TRUE(run_tradeoff(small_scene(), plan_, folder_.string(), reference, callbacks));
  EXPECT_EQ(reference.image.height, 16);
  ASSERT_EQ(rows.size(), 2u);
  for (const TradeoffRow& row : rows) {
    EXPECT_GT(row.difference.rmse, 0.0);
    EXPECT_GT(row.seconds_cold, 0.0);
    EXPECT_GT(row.seconds_warm, 0.0);
  }
  EXPECT_TRUE(rows[0].options.field_cache.empty());
  EXPECT_FALSE(rows[1].options.field_cache.empty());
  EXPECT_TRUE(fs::is_empty(folder_));
}

TEST_F(TradeoffRun, KeepsTheReferenceThatItIsGiven) {
  TradeoffPlan only_reference;
  only_reference.reference = plan_.reference;
  TradeoffReference reference;
  TradeoffCallbacks callbacks;
  EXPECT_TRUE(run_tradeoff(small_scene(), only_reference, folder_.string(), reference, callbacks));
  const std::vector<float> before = reference.image.data;
  EXPECT_TRUE(run_tradeoff(small_scene(), plan_, folder_.string(), reference, callbacks));
  EXPECT_EQ(reference.image.data, before);
}

TEST_F(TradeoffRun, HandsOverTheReferenceBeforeTheFirstCase) {
  std::vector<std::string> calls;
  TradeoffReference reference;
  Image handed;
  TradeoffCallbacks callbacks;
  callbacks.reference = [&](const Image& image) {
    calls.push_back("reference");
    handed = image;
  };
  callbacks.row = [&](const TradeoffRow&, const Image&) { calls.push_back("row"); };
  EXPECT_TRUE(run_tradeoff(small_scene(), plan_, folder_.string(), reference, callbacks));
  EXPECT_EQ(calls, (std::vector<std::string>{"reference", "row", "row"}));
  EXPECT_EQ(handed.data, reference.image.data);
  calls.clear();
  EXPECT_TRUE(run_tradeoff(small_scene(), plan_, folder_.string(), reference, callbacks));
  EXPECT_EQ(calls, (std::vector<std::string>{"row", "row"})) << "it was given";
}

TEST_F(TradeoffRun, AStoppedRunKeepsTheRowsSoFar) {
  std::atomic<bool> stop{false};
  size_t rows = 0;
  TradeoffCallbacks callbacks;
  callbacks.render.stop = &stop;
  callbacks.row = [&](const TradeoffRow&, const Image&) {
    ++rows;
    stop = true;
  };
  TradeoffReference reference;
  EXPECT_FALSE(run_tradeoff(small_scene(), plan_, folder_.string(), reference, callbacks));
  EXPECT_EQ(rows, 1u);
  EXPECT_TRUE(fs::is_empty(folder_));
}

TEST_F(TradeoffRun, AReferenceForBiasIsTheMeanOfItsHalves) {
  TradeoffPlan only_reference;
  only_reference.reference = plan_.reference;
  TradeoffReference whole, reference;
  ASSERT_TRUE(run_tradeoff(small_scene(), only_reference, folder_.string(), whole, {}));
  EXPECT_EQ(whole.image.data, render(small_scene(), plan_.reference).image.data);
  EXPECT_TRUE(whole.halves[0].data.empty() && whole.halves[1].data.empty());
  only_reference.seeds = 2;
  ASSERT_TRUE(run_tradeoff(small_scene(), only_reference, folder_.string(), reference, {}));
  EXPECT_NE(reference.halves[0].data, reference.halves[1].data);
  for (size_t i = 0; i < reference.image.data.size(); ++i) {
    EXPECT_EQ(reference.image.data[i], 0.5f * (reference.halves[0].data[i] + reference.halves[1].data[i]));
  }
}

TEST_F(TradeoffRun, MeasuresPicturesToAnErrorInATimeAndOfSeveralSeeds) {
  plan_.cases[0].options.spp = 16;  // Monte Carlo
  plan_.targets = {2.0, 1.0};
  plan_.equal_time = true;
  plan_.seeds = 2;
  for (const TradeoffCase& c : plan_.cases) plan_.parts.push_back(c.options);
  std::vector<TradeoffRow> rows;
  std::vector<TradeoffParts> parts;
  float last_share = 0.0f;
  TradeoffCallbacks callbacks;
  callbacks.row = [&](const TradeoffRow& row, const Image&) { rows.push_back(row); };
  callbacks.parts = [&](const TradeoffParts& p) { parts.push_back(p); };
  callbacks.render.progress = [&](float share, const char*) {
    EXPECT_GE(share, last_share);
    EXPECT_LE(share, 1.0f);
    last_share = share;
  };
  TradeoffReference reference;
  ASSERT_TRUE(run_tradeoff(small_scene(), plan_, folder_.string(), reference, callbacks));
  struct Expected {
    Method method;
    Ladder ladder;
  };
  const Expected expected[] = {{Method::monte_carlo, Ladder::samples}, {Method::monte_carlo, Ladder::target},
                               {Method::monte_carlo, Ladder::target},  {Method::hybrid, Ladder::samples},
                               {Method::hybrid, Ladder::target},       {Method::hybrid, Ladder::target},
                               {Method::monte_carlo, Ladder::time},    {Method::hybrid, Ladder::time}};
  ASSERT_EQ(rows.size(), std::size(expected));
  for (size_t i = 0; i < rows.size(); ++i) {
    EXPECT_EQ(rows[i].options.method, expected[i].method) << i;
    EXPECT_EQ(rows[i].ladder, expected[i].ladder) << i;
    EXPECT_GT(rows[i].flip, 0.0) << i;
    EXPECT_GT(rows[i].hdr_flip, 0.0) << i;
  }
  // Targets are multiples of Monte Carlo's least error, to two digits, and the same for both.
  EXPECT_NEAR(rows[1].options.target_error, 2.0 * rows[0].difference.rmse, 0.1 * rows[0].difference.rmse);
  EXPECT_NEAR(rows[2].options.target_error, rows[0].difference.rmse, 0.05 * rows[0].difference.rmse);
  for (const size_t i : {1u, 2u}) EXPECT_EQ(rows[i].options.target_error, rows[i + 3].options.target_error);
  EXPECT_NE(tradeoff_csv_row(rows[1], {}).find(",target,"), std::string::npos);
  // The time is that of the hybrid's middle target.
  for (const size_t i : {6u, 7u}) EXPECT_EQ(rows[i].options.time_limit, float(rows[5].seconds_cold));
  ASSERT_EQ(parts.size(), 2u);
  for (const TradeoffParts& p : parts) {
    EXPECT_EQ(p.seeds, 2);
    EXPECT_GT(p.parts.variance, 0.0);
    EXPECT_GT(p.parts.reference_variance, 0.0);
  }
  EXPECT_TRUE(fs::is_empty(folder_));
}

}  // namespace
}  // namespace fieldtrace
