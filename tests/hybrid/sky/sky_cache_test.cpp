// Direction maps between renders: the cache changes neither the picture nor whether there is one.
#include <gtest/gtest.h>

#include <filesystem>

#include "core/mesh/mesh_procedural.h"
#include "field/file/maps_file.h"
#include "hybrid/render/render.h"
#include "tests/support/field_checks.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace {
namespace {

namespace fs = std::filesystem;

class SkyCache : public testing::Test {
 protected:
  // A torus knot over a floor, under a sky. At this tolerance maps have D 16, which so many light samples are worth.
  SkyCache() {
    test::SceneMaker m;
    m.film(32, 32);
    m.scene.camera.to_world = test::look_at({0, -6, 3}, {0, 0, 0.5f}, {0, 0, 1});
    const uint32_t grey = m.bsdf(BsdfKind::diffuse, Rgb(0.5f));
    m.instance(m.shape(ShapeKind::rectangle), grey, test::scaling(Vec3(5.0f)));
    m.instance(m.mesh(make_knot({})), grey, test::translation({0, 0, 1.5f}));
    m.light(EmitterKind::constant, Rgb(1.0f));
    scene_ = std::move(m.scene);
    options_.spp = 4;
    options_.light_samples = 640;
    options_.tolerance = 0.4f;
    options_.threads = 2;
    options_.seed = 1;
    options_.field_cache = folder_.path();
  }

  RenderResult run() {
    warnings_.clear();
    RenderCallbacks callbacks;
    callbacks.warning = [this](const std::string& line) { warnings_.push_back(line); };
    return render(scene_, options_, callbacks);
  }
  RenderResult run_without_cache() {
    RenderOptions o = options_;
    o.field_cache.clear();
    return render(scene_, o);
  }
  std::string path() const {
    return folder_ / maps_identity(scene_.shapes[scene_.instances[1].shape], DMat3(1.0), {16, 64}).file_name();
  }

  const test::TemporaryFolder folder_;
  Scene scene_;
  RenderOptions options_;
  std::vector<std::string> warnings_;
};

TEST_F(SkyCache, AWarmRenderBakesNothingAndGivesTheSamePicture) {
  const RenderResult none = run_without_cache(), cold = run();
  ASSERT_GT(none.stats.bake_rays, 100'000u);  // else no maps were made
  EXPECT_EQ(none.stats.field_bytes_disk, 0u);
  EXPECT_EQ(cold.stats.bake_rays, none.stats.bake_rays);
  EXPECT_EQ(cold.stats.field_bytes_disk, fs::file_size(path()));
  const RenderResult warm = run();
  EXPECT_EQ(warm.stats.bake_rays, 0u);
  EXPECT_EQ(warm.stats.time_bake, 0.0);
  EXPECT_GT(warm.stats.time_cache, 0.0);
  EXPECT_EQ(warm.stats.field_bytes_disk, fs::file_size(path()));
  EXPECT_EQ(cold.image.data, none.image.data);
  EXPECT_EQ(warm.image.data, none.image.data);
  EXPECT_TRUE(warnings_.empty());
}

TEST_F(SkyCache, ADamagedFileIsToldAboutAndBakedAnew) {
  const RenderResult cold = run();
  fs::resize_file(path(), fs::file_size(path()) / 2);
  const RenderResult again = run();
  EXPECT_EQ(again.stats.bake_rays, cold.stats.bake_rays);
  EXPECT_EQ(again.image.data, cold.image.data);
  ASSERT_EQ(warnings_.size(), 1u);
  EXPECT_EQ(warnings_[0].rfind(path() + ": is cut short", 0), 0u) << warnings_[0];
  EXPECT_EQ(run().stats.bake_rays, 0u);
  EXPECT_TRUE(warnings_.empty());
}

TEST_F(SkyCache, WhatCannotBeKeptIsAWarning) {
  const RenderResult none = run_without_cache();
  fs::create_directory(path() + ".lock");
  EXPECT_EQ(run().image.data, none.image.data);
  ASSERT_EQ(warnings_.size(), 1u);
  EXPECT_NE(warnings_[0].find("not kept: the direction maps of"), std::string::npos) << warnings_[0];
  EXPECT_FALSE(fs::exists(path()));
  options_.if_unkept = IfUnkept::fail;
  EXPECT_THROW(run(), Error);
}

TEST_F(SkyCache, MapsInUseOutliveTheLimit) {
  options_.field_cache_limit = 1;
  run();
  EXPECT_TRUE(fs::exists(path()));
  ASSERT_EQ(warnings_.size(), 1u);
  EXPECT_NE(warnings_[0].find("--field-cache-limit"), std::string::npos) << warnings_[0];
}

TEST_F(SkyCache, NoFolderIsMadeWithoutMapsOrFields) {
  options_.field_cache = folder_ / "unused";
  options_.light_samples = 1;
  EXPECT_EQ(run().stats.bake_rays, 0u);
  EXPECT_FALSE(fs::exists(options_.field_cache));
}

}  // namespace
}  // namespace fieldtrace
