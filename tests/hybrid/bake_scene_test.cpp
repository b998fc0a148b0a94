// Baking ahead of rendering: what a full bake covers, and what a demand bake saves a later render.
#include "hybrid/bake/bake_scene.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <random>

#include "core/loader/scene_xml.h"
#include "core/mesh/mesh_io.h"
#include "core/mesh/mesh_procedural.h"
#include "core/trace/accel.h"
#include "field/bake/bake_full.h"
#include "field/file/field_cache.h"
#include "field/file/field_info.h"
#include "field/query/query.hd.h"
#include "hybrid/visibility/shadow_answerer.h"
#include "tests/support/field_checks.h"

namespace fieldtrace {
namespace {

namespace fs = std::filesystem;
using test::TemporaryFolder;

constexpr FieldParameters k_small = {32, 64, 4};

// Two different objects over a floor, under a light.
Scene small_scene() {
  Scene scene;
  scene.textures.emplace_back();
  scene.bsdfs.emplace_back();
  const auto add = [&](Shape shape, const Vec3& position, float scale) -> Instance& {
    shape.bounds = shape.mesh.bounds();
    scene.shapes.push_back(std::move(shape));
    Instance& instance = scene.instances.emplace_back();
    instance.shape = uint32_t(scene.shapes.size() - 1);
    instance.to_world = Affine(scale);
    instance.to_world[3] = position;
    const DAffine inverse = inverse_affine(DAffine(instance.to_world));
    instance.to_object = Affine(inverse);
    return instance;
  };
  Shape sphere, knot, floor;
  sphere.name = "ball";
  sphere.mesh = make_sphere({});
  knot.name = "knot";
  knot.mesh = make_knot({});
  floor.kind = ShapeKind::rectangle;
  floor.name = "floor";
  floor.mesh.positions = {{-1, -1, 0}, {1, -1, 0}, {1, 1, 0}, {-1, 1, 0}};
  floor.mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  add(floor, {0, 0, -2}, 8.0f);
  add(sphere, {-2, 0, 0}, 1.0f);
  add(knot, {2, 0, 0}, 1.0f);
  Emitter light;
  light.kind = EmitterKind::point;
  light.position = {0, 1, 6};
  light.value = Rgb(50.0f);
  scene.emitters.push_back(light);
  scene.camera.to_world[3] = {0, 0, 9};
  // Looks down: x and z negated, y kept.
  scene.camera.to_world[0] = {-1, 0, 0};
  scene.camera.to_world[2] = {0, 0, -1};
  scene.camera.fov_x_degrees = 60.0f;
  scene.film.width = scene.film.height = 32;
  scene.film.crop = {0, 0, 32, 32};
  return scene;
}

TEST(FullBake, ReachesEveryCellThatALineFalls) {
  std::mt19937 random(5);
  std::normal_distribution<float> normal;
  std::uniform_real_distribution<float> uniform;
  const FieldParameters p = k_small;
  uint64_t reached = 0;
  for (int i = 0; i < 20000; ++i) {
    Vec3 d = glm::normalize(Vec3(normal(random), normal(random), normal(random)));
    if (i % 8 == 0) d = glm::normalize(Vec3(d.x, d.y, d.z * 1e-6f));
    // Points in the unit ball, up to its surface.
    const Vec3 anchor = glm::normalize(Vec3(normal(random), normal(random), normal(random))) *
                        (i % 4 == 0 ? 1.0f : std::cbrt(uniform(random)));
    for (const FieldLayer layer : {FieldLayer::visibility, FieldLayer::depth}) {
      if (layer == FieldLayer::visibility && d.z < 0.0f) d = -d;
      const auto cell = scalar::address_of_line<float>({d.x, d.y, d.z}, {anchor.x, anchor.y, anchor.z},
                                                       make_axis(p.directions), make_axis(p.plane));
      EXPECT_TRUE(slice_reachable(p, layer, {cell.u, cell.v, cell.a / 4 * 4, cell.b / 8 * 8}))
          << d.x << ' ' << d.y << ' ' << d.z;
      ++reached;
    }
  }
  EXPECT_EQ(reached, 40000u);
  // Half of the directions, and the disk inside the square of the plane; slices that their rims cut count whole.
  const double full = double(p.directions) * p.directions * p.plane * p.plane;
  EXPECT_NEAR(double(reachable_cells(p, FieldLayer::depth)) / full, k_pi / 4, 0.13);
  EXPECT_NEAR(double(reachable_cells(p, FieldLayer::visibility)) / full, k_pi / 8, 0.15);
}

TEST(FullBake, MakesEveryReachableCellAndCanBeStopped) {
  const TemporaryFolder folder;
  const Scene scene = scene_of_mesh(make_sphere({}), "ball");
  BakeOptions options;
  options.full = true;
  options.fields = k_small;
  float last = 0.0f;
  RenderCallbacks callbacks;
  callbacks.progress = [&](float share, const char*) {
    EXPECT_GE(share, last);
    last = share;
  };
  const BakeResult result = bake_scene(scene, folder / "ball.vdb", options, callbacks);
  EXPECT_FALSE(result.interrupted);
  EXPECT_NEAR(last, 1.0f, 1e-5f);
  ASSERT_EQ(result.fields.size(), 1u);
  const FieldFileInfo& info = std::get<FieldFileInfo>(result.fields[0].info);
  EXPECT_EQ(info.visibility.cells_baked, info.visibility.cells_reachable);
  EXPECT_EQ(info.depth.cells_baked, info.depth.cells_reachable);
  EXPECT_EQ(info.visibility.cells_reachable, reachable_cells(k_small, FieldLayer::visibility));
  EXPECT_EQ(info.coverage.tiles_baked, info.coverage.tiles_full);
  EXPECT_GT(info.coverage.lines_hit, 0u);
  EXPECT_EQ(info.header.identity, field_identity(scene.shapes[0], k_small));

  // Stopped after a tenth: what is finished until then is written.
  std::atomic<bool> stop = false;
  callbacks.progress = [&](float share, const char*) { stop = stop || share > 0.1f; };
  callbacks.stop = &stop;
  const BakeResult part = bake_scene(scene, folder / "part.vdb", options, callbacks);
  EXPECT_TRUE(part.interrupted);
  ASSERT_EQ(part.fields.size(), 1u);
  EXPECT_GT(std::get<FieldFileInfo>(part.fields[0].info).visibility.cells_baked, 0u);
  EXPECT_LT(std::get<FieldFileInfo>(part.fields[0].info).visibility.cells_baked, info.visibility.cells_reachable);

  // Stopped before anything is finished: what is there stays.
  callbacks.progress = {};
  const BakeResult none = bake_scene(scene, folder / "ball.vdb", options, callbacks);
  EXPECT_TRUE(none.interrupted);
  EXPECT_TRUE(none.fields.empty());
  EXPECT_EQ(field_info(folder / "ball.vdb").visibility.cells_baked, info.visibility.cells_baked);
}

// A scene's loader moves such vertices, and its renders look for fields of what it has moved.
TEST(FullBake, AMeshFarFromItsOriginHasTheFieldThatScenesOfItLookFor) {
  const TemporaryFolder folder;
  TriangleMesh mesh = make_sphere({});
  for (Vec3& p : mesh.positions) p += Vec3(300.0f, 0.0f, 0.0f);
  save_ply(folder / "far.ply", mesh);
  std::ofstream(folder / "scene.xml") << R"(<scene version="3.0.0">
    <shape type="ply"><string name="filename" value="far.ply"/></shape></scene>)";
  const Scene alone = scene_of_mesh(mesh, "far.ply"), within = load_scene(folder / "scene.xml");
  EXPECT_EQ(field_identity(alone.shapes[0], k_small), field_identity(within.shapes[0], k_small));
  EXPECT_LT(glm::length(alone.shapes[0].mesh.positions[0]), 10.0f);
}

TEST(FullBake, KeepsToItsMemory) {
  const TemporaryFolder folder;
  const Scene scene = scene_of_mesh(make_sphere({}), "ball");
  BakeOptions options;
  options.full = true;
  options.fields = k_small;
  const uint64_t cells = full_brick_bytes(k_small);
  // Too small for all cells: refused before anything is traced.
  options.field_memory = cells - 1;
  RenderCallbacks callbacks;
  callbacks.progress = [](float, const char*) { ADD_FAILURE() << "work has begun"; };
  EXPECT_THROW(bake_scene(scene, folder / "a.vdb", options, callbacks), Error);
  // Large enough for them and for some of the tiles: the same ones for any number of threads.
  options.field_memory = cells + 3000 * CoverageTiles::k_tile_bytes;
  std::vector<std::string> warnings;
  callbacks.progress = {};
  callbacks.warning = [&](const std::string& line) { warnings.push_back(line); };
  uint64_t baked = 0;
  for (const int threads : {1, 3}) {
    options.threads = threads;
    const BakeResult result = bake_scene(scene, folder / "a.vdb", options, callbacks);
    ASSERT_EQ(result.fields.size(), 1u);
    const FieldFileInfo& info = std::get<FieldFileInfo>(result.fields[0].info);
    EXPECT_EQ(info.depth.cells_baked, info.depth.cells_reachable);
    EXPECT_LE(info.bytes_memory, options.field_memory);
    EXPECT_GE(info.coverage.tiles_baked, 2048u);
    EXPECT_LT(info.coverage.tiles_baked, info.coverage.tiles_full);
    EXPECT_TRUE(baked == 0 || info.coverage.tiles_baked == baked) << info.coverage.tiles_baked << " " << baked;
    baked = info.coverage.tiles_baked;
    ASSERT_EQ(warnings.size(), 1u);
    EXPECT_NE(warnings[0].find(std::to_string(info.coverage.tiles_full - baked)), std::string::npos) << warnings[0];
    warnings.clear();
  }
}

// Renders with many light samples look up whole lights first, those with one sample do not: a bake serves both.
TEST(BakeScene, ServesRendersOfAnyNumberOfLightSamples) {
  const TemporaryFolder folder;
  const Scene scene = small_scene();
  BakeOptions bake;
  bake.fields = {32, 64, 16};
  const BakeResult result = bake_scene(scene, folder.path(), bake);
  ASSERT_EQ(result.fields.size(), 2u);
  EXPECT_GT(std::get<FieldFileInfo>(result.fields[0].info).coverage.tiles_baked, 0u);
  RenderOptions options;
  options.spp = 1;
  options.directions = 32;
  options.plane = 64;
  options.field_cache = folder.path();
  EXPECT_EQ(render(scene, options).stats.bake_rays, 0u);
  options.light_samples = k_fewest_cone_samples;
  EXPECT_EQ(render(scene, options).stats.bake_rays, 0u);
}

// Where the demanded fields exceed their memory, the bake keeps the coarser ones of the render's last attempt.
TEST(BakeScene, KeepsTheFieldsThatFit) {
  const TemporaryFolder folder;
  RenderOptions roomy;
  roomy.spp = 1;
  roomy.light_samples = k_fewest_cone_samples;
  roomy.directions = 64;
  roomy.plane = 128;
  BakeOptions options;
  options.fields = {64, 128, 16};
  options.field_memory = render(small_scene(), roomy).stats.field_bytes_peak * 9 / 10;
  const BakeResult result = bake_scene(small_scene(), folder / "f.vdb", options);
  ASSERT_FALSE(result.fields.empty());
  for (const BakedField& field : result.fields)
    EXPECT_EQ(std::get<FieldFileInfo>(field.info).header.identity.parameters.directions, 32);
}

TEST(BakeScene, WritesOneFileForEachObject) {
  EXPECT_EQ(numbered_path("a/field.vdb", 0), "a/field.vdb");
  EXPECT_EQ(numbered_path("a/field.vdb", 2), "a/field.3.vdb");
  const TemporaryFolder folder;
  const Scene scene = small_scene();
  BakeOptions options;
  options.fields = {32, 64, 16};
  const BakeResult result = bake_scene(scene, folder / "f.vdb", options);
  ASSERT_EQ(result.fields.size(), 2u);
  EXPECT_EQ(result.fields[0].object, "ball");
  EXPECT_EQ(result.fields[0].path, folder / "f.vdb");
  EXPECT_EQ(result.fields[1].object, "knot");
  EXPECT_EQ(result.fields[1].path, folder / "f.2.vdb");
  for (const BakedField& field : result.fields)
    EXPECT_GT(std::get<FieldFileInfo>(field.info).visibility.cells_baked, 0u);
  // Nothing else is left behind.
  size_t files = 0;
  for ([[maybe_unused]] const auto& entry : fs::directory_iterator(folder.path())) ++files;
  EXPECT_EQ(files, 2u);
}

TEST(BakeScene, AFolderIsTheCacheOfTheRender) {
  const TemporaryFolder folder;
  const Scene scene = small_scene();
  BakeOptions bake;
  bake.fields = {32, 64, 16};
  ASSERT_EQ(bake_scene(scene, folder.path(), bake).fields.size(), 2u);
  RenderOptions options;
  options.spp = 1;
  options.directions = 32;
  options.plane = 64;
  const RenderResult cold = render(scene, options);
  options.field_cache = folder.path();
  const RenderResult warm = render(scene, options);
  EXPECT_GT(cold.stats.bake_rays, 0u);
  EXPECT_EQ(warm.stats.bake_rays, 0u);
  EXPECT_EQ(warm.image.data, cold.image.data);
  EXPECT_GE(warm.stats.field_cells_baked, cold.stats.field_cells_baked);  // also those of more light samples
  EXPECT_GT(warm.stats.field_bytes_disk, 0u);
  // Whatever is asked again after a bake counts once: which objects keep their fields depends on it.
  EXPECT_GT(cold.stats.lookups, 0u);
  EXPECT_EQ(warm.stats.lookups, cold.stats.lookups);
  // More samples demand more; the next render has them.
  options.spp = 16;
  const Stats more = render(scene, options).stats, again = render(scene, options).stats;
  EXPECT_GT(more.bake_rays, 0u);
  EXPECT_EQ(again.bake_rays, 0u);
  EXPECT_EQ(again.lookups, more.lookups);
}

TEST(BakeScene, ADamagedCacheChangesNothingButTime) {
  const TemporaryFolder folder;
  const Scene scene = small_scene();
  RenderOptions options;
  options.spp = 1;
  options.directions = 32;
  options.plane = 64;
  options.field_cache = folder.path();
  const RenderResult first = render(scene, options);
  for (const auto& entry : fs::directory_iterator(folder.path())) {
    if (entry.path().extension() == ".vdb") fs::resize_file(entry.path(), fs::file_size(entry.path()) - 9);
  }
  std::vector<std::string> warnings;
  RenderCallbacks callbacks;
  callbacks.warning = [&](const std::string& line) { warnings.push_back(line); };
  const RenderResult second = render(scene, options, callbacks);
  EXPECT_EQ(second.image.data, first.image.data);
  EXPECT_GT(second.stats.bake_rays, 0u);
  EXPECT_GE(warnings.size(), 2u);
  warnings.clear();
  EXPECT_EQ(render(scene, options, callbacks).stats.bake_rays, 0u);
  EXPECT_TRUE(warnings.empty());
}

TEST(BakeScene, ErrorsComeBeforeTheWork) {
  const TemporaryFolder folder;
  Scene flat = small_scene();
  flat.shapes.resize(1);
  flat.instances.resize(1);
  EXPECT_THROW(bake_scene(flat, folder / "a.vdb", {}), Error);
  EXPECT_THROW(bake_scene(small_scene(), folder / "no/a.vdb", {}), Error);
}

}  // namespace
}  // namespace fieldtrace
