// A scene of the C interface with its own copy of the triangles, for tests.
#pragma once

#include <gtest/gtest.h>

#include <utility>
#include <vector>

#include "core/mesh/mesh.h"
#include "core/mesh/mesh_procedural.h"
#include "fieldtrace/fieldtrace.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace::test {

inline void columns_of(const Affine& a, float* columns) {
  for (int c = 0; c < 4; ++c) {
    for (int r = 0; r < 3; ++r) columns[3 * c + r] = a[c][r];
  }
}

// Two turned and squashed knots over a floor of two triangles; small fields.
struct ApiScene {
  FTDevice device = nullptr;
  FTScene scene = nullptr;
  SceneMaker same;  // for oracles

  explicit ApiScene(bool commits = true) {
    EXPECT_EQ(ftNewDevice(2, &device), FT_ERROR_NONE);
    EXPECT_EQ(ftNewScene(device, &scene), FT_ERROR_NONE);
    EXPECT_EQ(ftSetSceneInt(scene, "directions", 32), FT_ERROR_NONE);
    EXPECT_EQ(ftSetSceneInt(scene, "plane", 64), FT_ERROR_NONE);
    TriangleMesh floor;
    floor.positions = {{-4, 0, -4}, {-4, 0, 4}, {4, 0, 4}, {4, 0, -4}};
    floor.triangles = {{0, 1, 2}, {0, 2, 3}};
    const uint32_t grey = same.bsdf(BsdfKind::diffuse, Rgb(0.5f));
    const std::vector<TriangleMesh> meshes = {make_knot({.along = 128, .around = 16}), floor};
    for (const TriangleMesh& mesh : meshes) {
      same.mesh(mesh);
      EXPECT_EQ(ftAddMesh(scene, &mesh.positions[0].x, sizeof(Vec3), mesh.positions.size(), &mesh.triangles[0].x,
                          sizeof(UVec3), mesh.triangles.size(), nullptr),
                FT_ERROR_NONE);
    }
    add(0, grey, translation({-1.2f, 1.3f, 0}));
    add(0, grey, Affine(Vec3(0.5f, 0.3f, 0), Vec3(-0.3f, 0.8f, 0), Vec3(0, 0.1f, 0.6f), Vec3(1.5f, 1.2f, 0.3f)));
    add(1, grey, Affine(1.0f));
    if (commits) {
      EXPECT_EQ(ftCommitScene(scene), FT_ERROR_NONE);
    }
  }
  ~ApiScene() {
    if (scene) {
      EXPECT_EQ(ftReleaseScene(scene), FT_ERROR_NONE);
    }
    if (device) {
      EXPECT_EQ(ftReleaseDevice(device), FT_ERROR_NONE);
    }
  }
  // The handles, with the references that this held.
  std::pair<FTDevice, FTScene> take() { return {std::exchange(device, nullptr), std::exchange(scene, nullptr)}; }

  ApiScene(const ApiScene&) = delete;
  ApiScene& operator=(const ApiScene&) = delete;

  void add(uint32_t mesh, uint32_t bsdf, const Affine& to_world) {
    float columns[12];
    columns_of(to_world, columns);
    EXPECT_EQ(ftAddInstance(scene, mesh, columns, nullptr), FT_ERROR_NONE);
    same.instance(mesh, bsdf, to_world);
  }
};

}  // namespace fieldtrace::test
