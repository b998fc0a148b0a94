// Renders in the thesis' chart: close to Monte Carlo but never certified, the same picture whatever the machine does,
// and fields that a cache keeps.
#include <gtest/gtest.h>

#include "core/mesh/mesh_procedural.h"
#include "field/file/thesis_file.h"
#include "hybrid/bake/bake_scene.h"
#include "hybrid/compare/compare.h"
#include "hybrid/render/render.h"
#include "tests/support/field_checks.h"
#include "tests/support/hybrid_scenes.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace {
namespace {

RenderOptions thesis_options() {
  RenderOptions o;
  o.chart = Chart::thesis;
  o.directions = 32;
  o.light_samples = 4;
  o.seed = 1;
  o.threads = 2;
  return o;
}

// A solid object over a floor that is answered by its bounds and exact rays.
Scene scene_of(int size) { return test::hybrid_scene("object_over_floor", size).scene; }

TEST(HybridThesis, PictureIsNearMonteCarloAndNearerWithMoreDirections) {
  const Scene scene = scene_of(48);
  RenderOptions o = thesis_options();
  o.method = Method::monte_carlo;
  const RenderResult exact = render(scene, o);
  o.method = Method::hybrid;
  double before = 0.1;
  for (const int m : {32, 64}) {
    o.directions = m;
    const RenderResult r = render(scene, o);
    const double rmse = compare_images(r.image, exact.image).rmse;
    EXPECT_LT(rmse, before) << m;
    EXPECT_GT(rmse, 1e-4) << m;  // otherwise no field has answered
    before = rmse;
    EXPECT_EQ(r.stats.field_objects, 1u);
    EXPECT_EQ(r.stats.field_directions, m);
    EXPECT_EQ(r.stats.field_bytes_memory, thesis_samples(m));
    EXPECT_EQ(r.stats.bake_rays, thesis_samples(m));
    EXPECT_GT(r.stats.lookups, 1000u);
    // No ray is undecided.
    EXPECT_EQ(r.stats.rays_exact, 0u);
    EXPECT_GT(exact.stats.rays_exact, 1000u);
  }
}

TEST(HybridThesis, ObjectsWithoutAFieldAreAnsweredByExactRays) {
  Scene scene = scene_of(24);
  // A cube has too few triangles for a field.
  test::SceneMaker maker;
  maker.scene = std::move(scene);
  maker.instance(maker.mesh(make_cube()), 0, test::translation({-2.0f, 0.0f, 1.0f}));
  RenderOptions o = thesis_options();
  const RenderResult r = render(maker.scene, o);
  EXPECT_EQ(r.stats.field_objects, 1u);
  EXPECT_GT(r.stats.rays_exact, 10u);
}

TEST(HybridThesis, ToleranceZeroIsMonteCarlo) {
  const Scene scene = scene_of(24);
  RenderOptions o = thesis_options();
  o.tolerance = 0.0f;
  const RenderResult r = render(scene, o);
  o.method = Method::monte_carlo;
  EXPECT_EQ(r.image.data, render(scene, o).image.data);
  EXPECT_EQ(r.stats.lookups, 0u);
}

TEST(HybridThesis, PictureDependsOnNeitherThreadsNorInstructionSetNorCache) {
  const Scene scene = scene_of(32);
  const RenderOptions o = thesis_options();
  const RenderResult first = render(scene, o);
  for (const Isa isa : supported_isas()) {
    RenderOptions other = o;
    other.isa = isa;
    other.threads = 1;
    EXPECT_EQ(render(scene, other).image.data, first.image.data) << isa_name(isa);
  }
  const test::TemporaryFolder folder;
  RenderOptions cached = o;
  cached.field_cache = folder.path();
  const RenderResult cold = render(scene, cached), warm = render(scene, cached);
  EXPECT_EQ(cold.image.data, first.image.data);
  EXPECT_EQ(warm.image.data, first.image.data);
  EXPECT_EQ(cold.stats.bake_rays, thesis_samples(32));
  EXPECT_EQ(warm.stats.bake_rays, 0u);
  EXPECT_GT(warm.stats.field_bytes_disk, 1000u);
}

TEST(HybridThesis, ChecksCountWrongAnswers) {
  RenderOptions o = thesis_options();
  o.check = true;
  const Stats stats = render(scene_of(48), o).stats;
  EXPECT_GT(stats.check_answers, 1000u);
  EXPECT_GT(stats.check_wrong, 0u);
  EXPECT_LT(stats.check_wrong, stats.check_answers / 5);
}

TEST(HybridThesis, OtherResolutionsAndTooLittleMemoryAreRefused) {
  const Scene scene = scene_of(8);
  RenderOptions o = thesis_options();
  o.directions = 256;
  EXPECT_THROW(render(scene, o), UsageError);
  o = thesis_options();
  o.plane = 64;
  EXPECT_THROW(render(scene, o), UsageError);
  o = thesis_options();
  o.field_memory = thesis_samples(32) - 1;
  EXPECT_THROW(render(scene, o), Error);
  o.field_memory = thesis_samples(32);
  EXPECT_NO_THROW(render(scene, o));
}

TEST(HybridThesis, BakedFilesAreThoseOfARender) {
  const Scene scene = scene_of(16);
  const test::TemporaryFolder folder;
  BakeOptions bake;
  bake.chart = Chart::thesis;
  bake.thesis_directions = 32;
  const BakeResult baked = bake_scene(scene, folder.path(), bake);
  ASSERT_EQ(baked.fields.size(), 1u);
  const ThesisFileInfo& info = std::get<ThesisFileInfo>(baked.fields[0].info);
  EXPECT_EQ(info.samples, thesis_samples(32));
  EXPECT_GT(info.misses, info.samples / 20);
  EXPECT_LT(info.misses, info.samples);
  EXPECT_FALSE(info.has_normals);
  RenderOptions o = thesis_options();
  o.field_cache = folder.path();
  EXPECT_EQ(render(scene, o).stats.bake_rays, 0u);
  const std::atomic<bool> stop = true;
  EXPECT_TRUE(bake_scene(scene, folder / "f.vdb", bake, {.progress = {}, .warning = {}, .stop = &stop}).interrupted);
}

}  // namespace
}  // namespace fieldtrace
