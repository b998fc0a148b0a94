// Fields where the system limits address space: they reserve less, and renders go on with what there is.
#include "core/platform/address_space.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "core/image/image.h"
#include "core/mesh/mesh_procedural.h"
#include "field/file/field_file.h"
#include "hybrid/fields/field_set.h"
#include "tests/support/field_checks.h"
#include "tests/support/program.h"

namespace fieldtrace {
namespace {

using test::Outcome;

constexpr FieldParameters k_small = {32, 64, 4};

TEST(AddressSpace, AFieldWithLessIsFullSooner) {
  const uint64_t whole = Field::reserved_bytes(k_small), tables = Field::table_bytes(k_small);
  const uint64_t bricks = Field::most_bytes(k_small);  // far more than is charged below
  for (const uint64_t tenths : {1, 5, 10}) {
    FieldBudget budget(bricks);
    Field field(test::test_ball(), k_small, &budget, tables + (whole - tables) * tenths / 10);
    const uint32_t all = field.slice_count() / 16;  // bricks, of each of which one slice is claimed
    const auto plane_bricks = uint32_t(field.view().plane_bricks);
    uint32_t claimed = 0;
    for (uint32_t brick = 0; brick < all; ++brick) {
      const uint32_t slice = brick / plane_bricks * 16 * plane_bricks + brick % plane_bricks;
      if (const auto cell = field.claim(FieldLayer::visibility, slice)) {
        field.store_visibility(*cell, 1);  // the memory is there
        field.finish(FieldLayer::visibility, slice);
        ++claimed;
      }
    }
    EXPECT_NEAR(double(claimed), double(all) * double(tenths) / 10.0, 2.0);
    EXPECT_EQ(field.pool_full(), tenths < 10);
    EXPECT_EQ(budget.out_of_addresses(), tenths < 10);
    EXPECT_EQ(budget.exceeded(), tenths < 10);
    EXPECT_NEAR(double(field.coverage().room()), double(field.coverage().slot_count()) * double(tenths) / 10.0, 2.0);
  }
}

// Each attempt makes do with the address space there is, down to complete fields of as many objects as fit.
TEST(AddressSpace, AFieldSetStepsDownToWhatFits) {
  Scene scene;
  for (const int along : {16, 32, 64}) {
    Shape& shape = scene.shapes.emplace_back();
    shape.mesh = make_sphere({.around = 32, .along = along});
    shape.bounds = shape.mesh.bounds();
    scene.instances.emplace_back().shape = uint32_t(scene.shapes.size() - 1);
  }
  const std::vector<ShapeTraits> traits = shape_traits(scene);
  FieldPlan plan;
  plan.parameters = {256, 512, 16};
  // Enough for two complete fields at 32 x 64, and less than the tables of three finer ones.
  const uint64_t addresses = Field::reserved_bytes({32, 64, 16}) * 5 / 2;
  ASSERT_GT(3 * Field::table_bytes(plan.parameters), addresses);
  std::string change;
  const auto make = [&] {
    return std::make_unique<FieldSet>(scene, traits, plan, FieldBudget::k_no_limit, true, addresses);
  };
  EXPECT_TRUE(make()->budget().out_of_addresses());
  for (int steps = 0; plan.parameters.directions > 32; ++steps) {
    ASSERT_LT(steps, 4);
    plan = make()->next_plan(change);
  }
  EXPECT_FALSE(make()->budget().exceeded());
  plan = make()->next_plan(change);
  EXPECT_EQ(plan.most_fields, 2u);
  EXPECT_NE(change.find("2 of 3"), std::string::npos) << change;
  EXPECT_FALSE(make()->budget().exceeded());
}

const char* const k_scene = R"(<scene version="3.0.0">
  <integrator type="path"><integer name="max_depth" value="2"/></integrator>
  <sensor type="perspective">
    <transform name="to_world"><lookat origin="0, 5, 4" target="0, 0, 0.7" up="0, 0, 1"/></transform>
    <sampler type="independent"><integer name="sample_count" value="1"/></sampler>
    <film type="hdrfilm">
      <integer name="width" value="64"/><integer name="height" value="64"/><rfilter type="box"/>
    </film>
  </sensor>
  <shape type="rectangle"><transform name="to_world"><scale value="5"/></transform></shape>
  <shape type="ply"><string name="filename" value="object.ply"/>
    <transform name="to_world"><translate z="1.1"/></transform></shape>
  <shape type="sphere"><point name="center" x="2" y="1" z="6"/><float name="radius" value="0.3"/>
    <emitter type="area"><rgb name="radiance" value="40"/></emitter></shape>
</scene>
)";

class LimitedProgram : public testing::Test {
 protected:
  void SetUp() override {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
    GTEST_SKIP() << "sanitizers reserve terabytes";
#endif
    std::ofstream(folder_ / "scene.xml") << k_scene;
    ASSERT_EQ(test::Program(folder_.path(), {"mesh", "supershape", "-o", "object.ply"}).wait().code, 0);
  }

  struct Render {
    Outcome outcome;
    Image image;
    nlohmann::json stats;
  };
  // `cells`: options that set the fields' resolution. `limit`: MiB for `ulimit -v`; 0: none.
  Render render(int limit, int threads, const std::string& cells) {
    const std::string ulimit = limit > 0 ? "ulimit -v " + std::to_string(limit * 1024) + " && " : "";
    const std::string command = ulimit +
                                "exec '" FIELDTRACE_PROGRAM "' render scene.xml -o out.exr --float32 --quiet " +
                                "--light-samples 16 --stats stats.json --threads " + std::to_string(threads) + cells;
    Render r;
    r.outcome = test::Program(folder_.path(), {"-c", command}, "/bin/sh").wait();
    if (r.outcome.code != 0) return r;
    r.image = read_image(folder_ / "out.exr");
    r.stats = nlohmann::json::parse(test::read_text(folder_ / "stats.json"));
    return r;
  }

  test::TemporaryFolder folder_;
};

// MiB. The program with its libraries takes 200, and more on machines with many processors. Without a limit, fields of
// 64 x 128 cells reserve 2 GB.
constexpr int k_limit = 2000;

TEST_F(LimitedProgram, MakesTheSamePictureWhereTheFieldsFit) {
  const std::string cells = " --directions 64 --plane 128";
  const Render free = render(0, 2, cells);
  ASSERT_EQ(free.outcome.code, 0) << free.outcome.err;
  for (const int threads : {1, 2}) {
    const Render limited = render(k_limit, threads, cells);
    ASSERT_EQ(limited.outcome.code, 0) << limited.outcome.err;
    EXPECT_EQ(limited.outcome.err, "");
    EXPECT_EQ(limited.image.data, free.image.data);
    EXPECT_EQ(limited.stats["field"]["directions"], 64);
    EXPECT_LT(limited.stats["exact_fraction"], 0.5);
  }
}

// The tables of such fields alone do not fit.
TEST_F(LimitedProgram, BeginsAgainWhereFieldsForGlossyRaysDoNotFit) {
  std::string scene = k_scene;
  const std::string depth = "\"max_depth\" value=\"2\"", floor = "<scale value=\"5\"/></transform></shape>";
  scene.replace(scene.find(depth), depth.size(), "\"max_depth\" value=\"3\"");
  scene.replace(scene.find(floor), floor.size(),
                "<scale value=\"5\"/></transform><bsdf type=\"roughconductor\"><float name=\"alpha\" value=\"0.3\"/>"
                "</bsdf></shape>");
  std::ofstream(folder_ / "scene.xml") << scene;
  const Render limited = render(2441, 2, " --directions 256 --plane 512 --field-hits always --lobe-samples 16");
  EXPECT_EQ(limited.outcome.code, 0) << limited.outcome.err;
  EXPECT_NE(limited.outcome.err.find("begins again"), std::string::npos) << limited.outcome.err;
}

// Files are made, read, and merged with what another image demands.
TEST_F(LimitedProgram, KeepsItsFields) {
  for (const char* seed : {"1", "2"}) {
    const std::string options = std::string(" --directions 64 --plane 128 --field-cache cache --seed ") + seed;
    const Render cold = render(k_limit, 2, options);
    ASSERT_EQ(cold.outcome.code, 0) << cold.outcome.err;
    EXPECT_EQ(cold.outcome.err, "");
    EXPECT_GT(cold.stats["bake"]["rays"], 0);
    const Render warm = render(k_limit, 2, options);
    ASSERT_EQ(warm.outcome.code, 0) << warm.outcome.err;
    EXPECT_EQ(warm.outcome.err, "");
    EXPECT_EQ(warm.stats["bake"]["rays"], 0);
    EXPECT_EQ(warm.image.data, cold.image.data);
  }
}

// A file that others have filled is not replaced by the little that fits.
TEST_F(LimitedProgram, LeavesFilesThatDoNotFit) {
  const FieldParameters p = {64, 128, 16};
  ASSERT_EQ(render(0, 2, " --directions 64 --plane 128 --field-cache cache").outcome.code, 0);
  std::string path;
  for (const auto& entry : std::filesystem::directory_iterator(folder_ / "cache")) {
    if (entry.path().extension() == ".vdb") path = entry.path();
  }
  FieldFileHeader header;
  {
    const FieldFile file(path);
    header = file.header();
    ASSERT_EQ(header.identity.parameters.directions, p.directions);
    Field field(header.ball, header.identity.parameters);
    file.copy_to(field);
    // A slice of every brick of the first directions; the limited program has room for an eighth of all.
    const auto plane_bricks = uint32_t(field.view().plane_bricks);
    for (uint32_t slice = 0; slice < field.slice_count(); ++slice) {
      if (slice / plane_bricks % 16 != 0) continue;
      test::fill_slice(field, FieldLayer::visibility, slice);
    }
    save_field(field, header.identity, path);
  }
  const std::string before = test::read_text(path);
  const Render limited = render(k_limit, 2, " --directions 64 --plane 128 --field-cache cache --seed 9");
  ASSERT_EQ(limited.outcome.code, 0) << limited.outcome.err;
  EXPECT_NE(limited.outcome.err.find("left as it is; raise the limit, ulimit -v; not kept: the field of"),
            std::string::npos)
      << limited.outcome.err;
  EXPECT_TRUE(test::read_text(path) == before);  // without printing them
}

TEST_F(LimitedProgram, GoesOnWithLessWhereTheyDoNot) {
  std::vector<Render> renders;
  for (const int threads : {1, 2}) {
    renders.push_back(render(k_limit, threads, " --directions 256 --plane 512"));
    const Render& r = renders.back();
    ASSERT_EQ(r.outcome.code, 0) << r.outcome.err;
    EXPECT_NE(r.outcome.err.find("address space"), std::string::npos) << r.outcome.err;
    EXPECT_NE(r.outcome.err.find("ulimit -v"), std::string::npos) << r.outcome.err;
    EXPECT_GT(r.stats["field"]["restarts"], 0);
    EXPECT_EQ(r.image.data, renders.front().image.data);
  }
}

}  // namespace
}  // namespace fieldtrace
