// Scenes far from the origin: re-centring keeps every relative position to single precision of the scene's size.

#include <cmath>
#include <random>

#include "core/loader/scene_recentre.h"
#include "tests/support/scene_test_files.h"

namespace fieldtrace {
namespace {

using SceneRecentre = SceneFiles;

std::string at(const std::string& shift) {
  return R"(<sensor type="perspective"><transform name="to_world"><lookat origin="0 -6 2" target="0 0 0" up="0 0 1"/>)" +
         shift + R"(</transform></sensor>
    <shape type="cube"><transform name="to_world"><rotate z="1" angle="20"/><translate x="1.5"/>)" +
         shift +
         R"(</transform></shape>
    <shape type="sphere"><transform name="to_world"><translate x="-1" z=".25"/>)" +
         shift + R"(</transform>
      <emitter type="area"/></shape>
    <emitter type="point"><transform name="to_world"><translate x="3" y="1" z="4"/>)" +
         shift + R"(</transform></emitter>)";
}

TEST_F(SceneRecentre, ScenesNearTheOriginStayWhereTheyAre) {
  const Scene s = load(at("<translate x=\"2\"/>"));
  EXPECT_EQ(s.origin, DVec3(0.0));
  EXPECT_EQ(s.instances[0].to_world[3], Vec3(3.5f, 0, 0));
}

TEST_F(SceneRecentre, FarScenesComeToTheOriginAndKeepTheirShape) {
  const Scene near = load(at(""));
  for (const char* shift : {"<translate x=\"1e6\" y=\"-3e6\" z=\"2e5\"/>", "<translate x=\"1e9\"/>",
                            "<translate x=\"4194304.125\" z=\"100\"/>"}) {
    const Scene far = load(at(shift));
    EXPECT_GT(glm::length(far.origin), 1e5);
    EXPECT_LT(glm::length(far.world_bounds().centre()), 1.0f);
    // Relative positions are those of the scene that was not moved, up to one rounding each way.
    const float tolerance = 10 * gamma_bound(4) + float(std::abs(far.origin.x) * 0x1p-51);
    const auto same = [&](const Vec3& a, const Vec3& b) { EXPECT_LT(glm::length(a - b), tolerance) << shift; };
    same(far.instances[1].to_world[3] - far.instances[0].to_world[3],
         near.instances[1].to_world[3] - near.instances[0].to_world[3]);
    same(far.camera.to_world[3] - far.instances[0].to_world[3],
         near.camera.to_world[3] - near.instances[0].to_world[3]);
    same(far.emitters[1].position - far.instances[0].to_world[3],
         near.emitters[1].position - near.instances[0].to_world[3]);
    same(far.camera.to_world[2], near.camera.to_world[2]);
    for (const Instance& i : far.instances) {
      const Vec3 p(0.3f, -0.7f, 0.2f);
      same(transform_point(i.to_object, transform_point(i.to_world, p)), p);
    }
  }
}

TEST_F(SceneRecentre, OriginRestoresTheFilesCoordinates) {
  const Scene s = load(at("<translate x=\"1000000.5\"/>"));
  EXPECT_NEAR(double(s.instances[0].to_world[3].x) + s.origin.x, 1000002.0, 1e-6);
}

TEST_F(SceneRecentre, FarMeshesMoveToTheirObjectsOrigin) {
  write("far.obj",
        "v 1000000 5000000 0\nv 1000001 5000000 0\nv 1000000 5000001 0\nv 1000000 5000000 1\n"
        "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n");
  const Scene s = load(k_sensor + R"(<shape type="obj"><string name="filename" value="far.obj"/>
    <transform name="to_world"><translate x="-1000000" y="-5000000"/><scale value="2"/></transform></shape>
    <shape type="obj"><string name="filename" value="far.obj"/>
    <transform name="to_world"><translate x="-1000000" y="-5000000"/><rotate z="1" angle="90"/></transform></shape>)");
  EXPECT_EQ(s.origin, DVec3(0.0));
  EXPECT_LT(glm::length(s.shapes[0].bounds.upper), 2.0f);
  // World positions as in the file: vertex 1 (0,0,0), vertex 2 (2,0,0); rotated by 90 degrees (0,1,0).
  const auto world = [&](size_t instance, const Vec3& object) {
    return transform_point(s.instances[instance].to_world, object);
  };
  float nearest = 1, nearest_turned = 1;
  for (const Vec3& p : s.shapes[0].mesh.positions) {
    nearest = std::min(nearest, glm::length(world(0, p) - Vec3(2, 0, 0)));
    nearest_turned = std::min(nearest_turned, glm::length(world(1, p) - Vec3(0, 1, 0)));
  }
  // The file's rotation is rounded at 2^-53 of 5e6, far below single precision of 2.
  EXPECT_LT(nearest, 2 * gamma_bound(4));
  EXPECT_LT(nearest_turned, 2 * gamma_bound(4));
}

TEST_F(SceneRecentre, RandomPlacementsRoundTripAtEveryScale) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> unit(-1, 1), exponent(-6, 8);
  for (int i = 0; i < 500; ++i) {
    const double size = std::pow(10, exponent(random) / 2), distance = std::pow(10, exponent(random));
    Scene scene;
    scene.shapes.resize(1);
    scene.shapes[0].kind = ShapeKind::sphere;
    scene.shapes[0].bounds = {Vec3(-1), Vec3(1)};
    scene.instances.resize(1);
    ScenePlacement placement;
    DAffine t(0.0);
    for (int c = 0; c < 3; ++c) t[c] = size * DVec3(unit(random), unit(random), unit(random));
    for (int c = 0; c < 3; ++c) t[c][c] += 4 * size;  // diagonally dominant: well conditioned
    t[3] = distance * DVec3(unit(random), unit(random), unit(random));
    placement.instances = {t};
    place_scene(scene, placement);
    const Vec3 p(0.5f, -0.25f, 0.125f);
    const DVec3 expected = t[0] * 0.5 - t[1] * 0.25 + t[2] * 0.125 + t[3];
    const DVec3 got = DVec3(transform_point(scene.instances[0].to_world, p)) + scene.origin;
    // Relative to the scene's extent or, if it was not moved, to at most k_recentre_diagonals of its diagonals. The
    // diagonal of the bounds of a sphere under t is at most 2 sqrt(3) * 3 * 5 size.
    const double diagonal = 52 * size;
    EXPECT_LT(glm::length(got - expected), (k_recentre_diagonals + 1) * diagonal * double(gamma_bound(6)));
  }
}

}  // namespace
}  // namespace fieldtrace
