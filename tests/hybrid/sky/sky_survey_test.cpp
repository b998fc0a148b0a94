// What is surveyed of a scene under a sky: what is open, what meshes hide, and that rooms of meshes let no light in.

#include "hybrid/render/sky_survey.h"
#include "hybrid/render/indirect_stage.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <numeric>
#include <vector>

#include "core/mesh/mesh_procedural.h"
#include "hybrid/render/render.h"
#include "tests/support/image_statistics.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace {
namespace {

using namespace test;

constexpr int k_size = 96;

// A room of 6 x 6 x 3 with a ball in it, seen from within; its walls are meshes like boxes, or the rectangles
// that bound it.
struct Room : SceneMaker {
  explicit Room(bool of_boxes, bool has_wall = true) : of_boxes_(of_boxes) {
    scene.camera.to_world = look_at({-2.5f, 2.5f, 1.8f}, {0.5f, -0.5f, 1}, {0, 0, 1});
    scene.camera.fov_x_degrees = 70.0f;
    film(k_size, k_size);
    shape_ = of_boxes ? mesh(make_cube({.half_size = 1.0f, .divisions = 2})) : shape(ShapeKind::rectangle);
    grey_ = bsdf(BsdfKind::diffuse, Rgb(0.7f));
    scene.bsdfs[grey_].two_sided = true;
    const Vec3 x(1, 0, 0), y(0, 1, 0), z(0, 0, 1);
    wall(3.2f * x, 3.2f * y, -z, {0, 0, 0}), wall(3.2f * x, 3.2f * y, z, {0, 0, 3});
    wall(3.2f * x, 1.7f * z, -y, {0, -3, 1.5f}), wall(3.2f * x, 1.7f * z, y, {0, 3, 1.5f});
    wall(3.2f * y, 1.7f * z, -x, {-3, 0, 1.5f});
    if (has_wall) wall(3.2f * y, 1.7f * z, x, {3, 0, 1.5f});
    Affine place = scaling(Vec3(0.5f));
    place[3] = Vec3(0, 0, 0.6f);
    instance(mesh(make_sphere()), grey_, place);
    light(EmitterKind::constant, Rgb(1.0f));
  }
  // About `at`, along the half axes; boxes are .2 thick, outwards.
  void wall(const Vec3& a, const Vec3& b, const Vec3& outwards, const Vec3& at) {
    constexpr float k_half = 0.1f;
    const Vec3 normal = glm::cross(glm::normalize(a), glm::normalize(b));
    instance(shape_, grey_,
             of_boxes_ ? Affine(a, b, k_half * normal, at + k_half * outwards) : Affine(a, b, normal, at));
  }
  SkySurvey survey() const {
    const Accel accel(scene);
    return survey_sky(scene, accel, shape_traits(scene), CameraSampler(scene.camera, scene.film), scene.film.crop);
  }

  bool of_boxes_;
  uint32_t shape_ = 0, grey_ = 0;
};

RenderOptions options(Method method) {
  RenderOptions o;
  o.method = method;
  o.spp = 32;
  o.max_depth = 3;
  o.threads = 2;
  return o;
}

TEST(SkySurvey, TellsWhatMeshesAloneHide) {
  const SkySurvey boxes = Room(true).survey(), rectangles = Room(false).survey();
  for (const SkySurvey& s : {boxes, rectangles}) EXPECT_EQ(s.open, 0.0);
  EXPECT_EQ(boxes.diffuse, 1.0);
  EXPECT_EQ(boxes.hidden_by_maps, 1.0);
  EXPECT_TRUE(boxes.is_enclosed());
  EXPECT_EQ(rectangles.hidden_by_maps, 0.0);  // there is a wall behind the ball
  // A whole wall is open: a tenth of what the others see, or so.
  const SkySurvey open = Room(true, false).survey();
  EXPECT_NEAR(open.open + open.hidden_by_maps, 1.0, 1e-9);
  EXPECT_GT(open.open, 0.05);
  EXPECT_LT(open.open, 0.2);
}

TEST(SkySurvey, TellsWhatIsMetNext) {
  const Room room(false, false);
  const SkySurvey s = room.survey();
  const size_t count = room.scene.instances.size();
  EXPECT_NEAR(std::accumulate(s.met_next.begin(), s.met_next.end(), 0.0), 1.0 - s.open, 1e-9);
  EXPECT_NEAR(s.share_of_met_next(std::vector<uint8_t>(count, 1)), 1.0, 1e-9);
  EXPECT_EQ(s.share_of_met_next(std::vector<uint8_t>(count, 0)), 0.0);
  std::vector<uint8_t> walls(count, 1);
  walls.back() = 0;  // the ball
  EXPECT_GT(s.share_of_met_next(walls), 0.8);
  EXPECT_LT(s.share_of_met_next(walls), 0.999);
  EXPECT_EQ(SkySurvey().share_of_met_next({}), 1.0);
}

TEST(SkySurvey, LeavesToRaysWhatLittleLightComesTo) {
  const auto survey = [](double open, double hidden_by_maps) {
    SkySurvey s;
    s.open = open, s.hidden_by_maps = hidden_by_maps;
    return s;
  };
  EXPECT_TRUE(survey(0.02, 0.0).is_enclosed());
  EXPECT_FALSE(survey(0.05, 0.0).is_enclosed());
  EXPECT_FALSE(survey(0.2, 0.3).is_enclosed());
  EXPECT_TRUE(survey(0.2, 0.8).is_enclosed());
  EXPECT_FALSE(survey(0.4, 0.6).is_enclosed());
}

TEST(SkySurvey, APlaneIsOpen) {
  SceneMaker s;
  s.scene.camera.to_world = look_at({0, 0, 5}, {0, 0, 0}, {0, 1, 0});
  s.film(k_size, k_size);
  s.instance(s.shape(ShapeKind::rectangle), s.bsdf(BsdfKind::diffuse, Rgb(0.5f)), scaling(Vec3(100.0f)));
  s.light(EmitterKind::constant, Rgb(1.0f));
  const Accel accel(s.scene);
  const SkySurvey survey =
      survey_sky(s.scene, accel, shape_traits(s.scene), CameraSampler(s.scene.camera, s.scene.film), s.scene.film.crop);
  EXPECT_EQ(survey.open, 1.0);
  EXPECT_FALSE(survey.is_enclosed());
  EXPECT_GT(survey.seen.size(), 500u);
  for (const Vec3& p : survey.seen) EXPECT_NEAR(p.z, 0.05f, 5e-4f);  // a hundredth of the way to the camera
}

// Half of the picture is background, a quarter a mirror: maps are asked for the rest.
TEST(SkySurvey, CountsWhatAsksMaps) {
  SceneMaker s;
  s.scene.camera.to_world = look_at({0, 0, 5}, {0, 0, 0}, {0, 1, 0});
  s.film(k_size, k_size);
  const uint32_t square = s.shape(ShapeKind::rectangle);
  s.instance(square, s.bsdf(BsdfKind::diffuse, Rgb(0.5f)), Affine({50, 0, 0}, {0, 50, 0}, {0, 0, 1}, {-50, 50, 0}));
  s.instance(square, s.bsdf(BsdfKind::conductor, Rgb(0.5f)), Affine({50, 0, 0}, {0, 50, 0}, {0, 0, 1}, {-50, -50, 0}));
  s.light(EmitterKind::constant, Rgb(1.0f));
  const Accel accel(s.scene);
  const auto survey = [&](const Rect& window) {
    return survey_sky(s.scene, accel, shape_traits(s.scene), CameraSampler(s.scene.camera, s.scene.film), window);
  };
  const SkySurvey whole = survey(s.scene.film.crop);
  EXPECT_EQ(whole.met, 0.5);
  EXPECT_EQ(whole.diffuse, 0.25);
  double met = 0.0, diffuse = 0.0;
  for (int quarter = 0; quarter < 4; ++quarter) {
    const int half = k_size / 2;
    const SkySurvey part = survey({quarter % 2 * half, quarter / 2 * half, half, half});
    EXPECT_TRUE(part.met == 1.0 || part.met == 1.0 / 1024.0);  // none is like one
    met += part.met, diffuse += part.diffuse;
  }
  EXPECT_NEAR(met, 2.0, 0.01);
  EXPECT_NEAR(diffuse, 1.0, 0.01);
}

// Each further surface is met by what does not leave: a geometric series, of a path and rays to each light.
TEST(RaysAPath, AreThoseOfALengthAndAnOpening) {
  EXPECT_EQ(rays_a_path(3, 1.0, 5), 1.0);           // leaves at once
  EXPECT_EQ(rays_a_path(3, 0.75, 2), 1.5);          // a quarter of it asks two lights
  EXPECT_EQ(rays_a_path(4, 0.5, 1), 1.5 + 0.75);    // half goes on
  EXPECT_EQ(rays_a_path(5, 0.0, 1), 2.0 * 3);       // a closed room
  EXPECT_EQ(rays_a_path(2, 0.5, 1), 0.0);           // no path has a second surface
  EXPECT_NEAR(rays_a_path(-1, 0.5, 0), 2.0, 0.05);  // endless
}

// Maps let in what stands between the texels of adjoining boxes.
TEST(SkySurvey, ClosedRoomsAreDark) {
  for (const bool of_boxes : {false, true}) {
    const RenderResult r = render(Room(of_boxes).scene, options(Method::hybrid));
    EXPECT_EQ(test::mean(r.image), 0.0);
    EXPECT_EQ(r.stats.sky_directions, 0);
  }
}

// Maps know how bright a wall is on the mean, and not that its brightest part is hidden: a lamp behind a panel.
TEST(SkySurvey, RoomsUnderLampsAreLeftToPaths) {
  Room room(false);
  room.scene.emitters.clear();
  const Vec3 x(1, 0, 0), y(0, 1, 0), z(0, 0, 1);
  room.instance(room.shape_, room.grey_, Affine(y, z, x, {2.8f, 0, 1.5f}));
  const uint32_t lamp = room.shape(ShapeKind::rectangle);
  room.area_light(room.instance(lamp, room.grey_, Affine(0.5f * y, 0.5f * z, x, {2.85f, 0, 1.5f})), Rgb(10.0f));
  RenderOptions o = options(Method::hybrid);
  o.spp = 96;  // enough that maps may cost what they do
  EXPECT_EQ(render(room.scene, o).stats.sky_directions, 0);
  o.directions = 32;  // at any cost
  EXPECT_EQ(render(room.scene, o).stats.sky_directions, 32);
}

}  // namespace
}  // namespace fieldtrace
