// The thesis' pipeline with fields and with exact rays: errors, shadows, mirrors, instances, determinism.
#include "tools/thesis/render.h"

#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>

#include "core/mesh/mesh_procedural.h"
#include "tools/thesis/cases.h"
#include "tools/thesis/picture.h"

namespace fieldtrace {
namespace {

constexpr int k_size = 96;

// A scene's fields, one per shape.
struct SceneFields {
  std::vector<ThesisField> fields;
  std::vector<const ThesisField*> pointers;

  SceneFields(const PhongScene& scene, const Accel& accel, int m) {
    for (uint32_t s = 0; s < scene.geometry.shapes.size(); ++s) {
      fields.push_back(*bake_thesis_field(accel, scene.geometry, s, m));
    }
    for (const ThesisField& f : fields) pointers.push_back(&f);
  }
};

PhongPicture exact_picture(const PhongScene& scene, const Accel& accel, int rays = 1) {
  return render_phong(scene, *make_exact_tracer(scene, accel), {k_size, rays});
}

PhongPicture field_picture(const PhongScene& scene, const Accel& accel, int m, Isa isa = Isa::automatic) {
  const SceneFields fields(scene, accel, m);
  return render_phong(scene, *make_field_tracer(scene, fields.pointers, isa), {k_size, 1});
}

float brightness(const PhongPicture& p, int x, int y) {
  const Rgb c = p.pixels[size_t(y) * size_t(p.size) + size_t(x)];
  return (c.r + c.g + c.b) / 3.0f;
}

// A ray is answered by the sample nearest to it, which may lie so far beside it, in radii of the object's ball: the
// farthest that an entry point lies from the nearest of the 4,226, and half the diagonal of a cell of directions.
float reach_of(int m) { return 0.0427f + std::sqrt(2.0f) / float(m); }

// The same in pixels, of an object whose nearest point lies at this distance from the camera.
int pixels_of_reach(const PhongCamera& camera, float radius, float distance, int m) {
  const float pixels_a_unit = 0.5f * k_size / std::tan(0.5f * camera.fov_degrees * k_pi / 180.0f) / distance;
  return int(std::ceil(reach_of(m) * radius * pixels_a_unit));
}

// Normals are stored in 127 steps along each axis: off by sqrt(3) halves of one at most. Of the materials here that
// changes the diffuse and the specular term by so much.
float shade_of_a_step() {
  const PhongMaterial material;
  const float turn = std::sqrt(3.0f) / 254.0f;
  return turn * (material.diffuse.x + 2.0f * material.shininess * material.specular.x);
}

// Pixels that no pixel of the exact picture within `reach` accounts for, up to `shade`: below the darkest of them or
// above the brightest.
int strayed_pixels(const PhongPicture& picture, const PhongPicture& exact, int reach, float shade) {
  int strayed = 0;
  for (int i = 0; i < k_size * k_size; ++i) {
    Rgb least(k_infinity), most(-k_infinity);
    for (int y = std::max(i / k_size - reach, 0); y <= std::min(i / k_size + reach, k_size - 1); ++y) {
      for (int x = std::max(i % k_size - reach, 0); x <= std::min(i % k_size + reach, k_size - 1); ++x) {
        const Rgb& c = exact.pixels[size_t(y) * k_size + size_t(x)];
        least = glm::min(least, c), most = glm::max(most, c);
      }
    }
    const Rgb& c = picture.pixels[size_t(i)];
    strayed += glm::any(glm::lessThan(c, least - shade)) || glm::any(glm::greaterThan(c, most + shade));
  }
  return strayed;
}

TEST(ThesisRender, ErrorFallsWithFinerDirections) {
  const PhongScene scene = thesis_growing_scene(16128);
  const Accel accel(scene.geometry);
  const PhongPicture reference = exact_picture(scene, accel);
  double before = 255.0;
  const Sphere ball = thesis_ball(scene.geometry.shapes[0].mesh);
  const float distance = glm::length(scene.camera.eye - ball.centre) - ball.radius;
  for (const int m : {8, 16, 32, 64}) {
    const PhongPicture fields = field_picture(scene, accel, m);
    const double rms = rms_255(fields, reference);
    EXPECT_LT(rms, before) << m;
    before = rms;
    if (m < 32) continue;  // whose samples may lie an eighth of the radius and more beside a ray
    EXPECT_EQ(
        strayed_pixels(fields, reference, pixels_of_reach(scene.camera, ball.radius, distance, m), shade_of_a_step()),
        0)
        << m;
  }
  EXPECT_GT(before, 0.0);  // else the reference was compared with itself
}

TEST(ThesisRender, PicturesDoNotDependOnThreadsOrInstructionSet) {
  const PhongScene scene = thesis_growing_scene(16128);
  const Accel accel(scene.geometry);
  const PhongPicture reference = field_picture(scene, accel, 16, Isa::scalar);
  for (const Isa isa : supported_isas()) EXPECT_EQ(field_picture(scene, accel, 16, isa).pixels, reference.pixels);
  tbb::task_arena(1).execute([&] { EXPECT_EQ(field_picture(scene, accel, 16).pixels, reference.pixels); });
}

// A ball over a floor with the light above: a shadow in the middle.
PhongScene ball_over_floor() {
  PhongScene scene;
  const uint32_t floor = add_phong_shape(scene, "floor", make_plane({.half_size = 1.0f}));
  const uint32_t ball = add_phong_shape(scene, "ball", make_sphere({.radius = 0.3f}));
  add_phong_instance(scene, floor, {});
  add_phong_instance(scene, ball, {}, {0.0f, 0.0f, 0.7f});
  scene.camera.eye = {0.0f, -2.5f, 3.0f};
  scene.lights = {{{0.0f, 0.0f, 5.0f}, Rgb(1.0f)}};
  return scene;
}

TEST(ThesisRender, LookUpsFromTheLightCastShadows) {
  PhongScene scene = ball_over_floor();
  const Accel accel(scene.geometry);
  const PhongPicture exact = exact_picture(scene, accel), fields = field_picture(scene, accel, 64);
  // The floor's middle lies on the camera's axis: in the ball's shadow, but not hidden by the ball.
  const int middle = k_size / 2;
  EXPECT_LT(brightness(exact, middle, middle + 4), 0.2f);
  EXPECT_LT(brightness(fields, middle, middle + 4), 0.2f);
  EXPECT_GT(brightness(exact, middle + 25, middle), 0.4f);
  EXPECT_GT(brightness(fields, middle + 25, middle), 0.4f);
  // A light below the floor reaches nothing that the camera sees.
  scene.lights[0].position.z = -5.0f;
  const PhongPicture dark = field_picture(scene, accel, 32);
  EXPECT_LT(brightness(dark, middle + 25, middle), 0.11f);
}

TEST(ThesisRender, LightsAddUp) {
  PhongScene scene = ball_over_floor();
  const Accel accel(scene.geometry);
  const PhongLight first = {{2.0f, -1.0f, 4.0f}, Rgb(0.4f)}, second = {{-2.0f, -1.0f, 4.0f}, Rgb(0.3f)};
  const SceneFields fields(scene, accel, 32);
  const auto with = [&](const std::vector<PhongLight>& lights) {
    scene.lights = lights;
    return render_phong(scene, *make_field_tracer(scene, fields.pointers), {k_size, 1});
  };
  const PhongPicture none = with({}), one = with({first}), two = with({second}), both = with({first, second});
  for (size_t i = 0; i < none.pixels.size(); ++i) {
    for (int c = 0; c < 3; ++c) {
      const float sum = one.pixels[i][c] + two.pixels[i][c] - none.pixels[i][c];
      ASSERT_NEAR(both.pixels[i][c], std::min(sum, 1.0f), 1e-5f);
    }
  }
}

TEST(ThesisRender, EmissionAndAmbientNeedNoLight) {
  PhongScene scene = ball_over_floor();
  scene.lights.clear();
  scene.ambient = Rgb(0.5f);
  scene.materials[1].emission = Rgb(0.25f, 0.0f, 0.0f);
  scene.materials[1].ambient = Rgb(0.5f);
  scene.background = Rgb(0.0f, 0.0f, 1.0f);
  scene.camera.eye = {0.0f, -3.0f, 0.7f};
  scene.camera.target = {0.0f, 0.0f, 0.7f};
  const Accel accel(scene.geometry);
  for (const PhongPicture& p : {exact_picture(scene, accel), field_picture(scene, accel, 32)}) {
    const Rgb middle = p.pixels[size_t(k_size / 2) * k_size + k_size / 2];
    EXPECT_NEAR(middle.r, 0.5f, 1e-6f);
    EXPECT_NEAR(middle.g, 0.25f, 1e-6f);
    EXPECT_EQ(p.pixels[0], Rgb(0.0f, 0.0f, 1.0f));
  }
}

constexpr float k_mirrored_ball = 0.5f, k_mirror_ball_height = 0.4f;

// A flat mirror facing the camera, a glowing ball behind the camera: seen only in the mirror.
PhongScene mirror_scene() {
  PhongScene scene;
  const uint32_t block = add_phong_shape(scene, "block", make_cube({.half_size = 1.0f}));
  const uint32_t ball =
      add_phong_shape(scene, "ball", make_sphere({.radius = k_mirrored_ball, .around = 256, .along = 128}));
  PhongMaterial mirror, glow;
  mirror.mirror = 1.0f;
  mirror.ambient = mirror.diffuse = mirror.specular = Rgb(0.0f);
  glow.emission = Rgb(0.0f, 1.0f, 0.0f);
  glow.ambient = Rgb(0.0f);
  add_phong_instance(scene, block, mirror);
  add_phong_instance(scene, ball, glow, {0.0f, -5.0f, k_mirror_ball_height});
  scene.camera.eye = {0.0f, -3.5f, 0.0f};
  scene.camera.fov_degrees = 20.0f;
  scene.reflections = 1;
  return scene;
}

TEST(ThesisRender, MirrorsShowWhatLiesBehindTheCamera) {
  PhongScene scene = mirror_scene();
  const Accel accel(scene.geometry);
  const auto green = [](const PhongPicture& p) {
    double sum = 0.0;
    for (const Rgb& c : p.pixels) sum += double(c.g);
    return sum;
  };
  // The mirror image of the ball lies behind the mirror at y = -1 as far as the ball before it: a sphere, seen in
  // perspective as an ellipse.
  const double towards = 2.0 * (-1.0) + 5.0 + 3.5, distance = std::hypot(towards, double(k_mirror_ball_height));
  const double focal = 0.5 * k_size / std::tan(10.0 * double(k_pi) / 180.0);
  const double cosine = towards / distance, sine = double(k_mirrored_ball) / distance;
  const double area =
      double(k_pi) * focal * focal * sine * sine * cosine / std::pow(cosine * cosine - sine * sine, 1.5);
  // A pixel at the rim is in or out by its middle: off by 1/12 in variance each, five deviations of all of them.
  const double rounding = 5.0 * std::sqrt(2.0 * std::sqrt(double(k_pi) * area) / 12.0);
  const PhongPicture exact = exact_picture(scene, accel), fields = field_picture(scene, accel, 64);
  EXPECT_NEAR(green(exact), area, rounding);
  // Four rays a pixel turned by a little show the same in four places.
  const double polished = green(exact_picture(scene, accel, 4));
  EXPECT_NEAR(polished, area, rounding + area * double(scene.polish_radius * scene.polish_radius));
  EXPECT_NE(polished, green(exact));
  // A flat mirror's normals are exact: what is left is the reach of the ball's own samples, at the nearest as far away
  // as its image.
  const int reach = pixels_of_reach(scene.camera, k_mirrored_ball, float(distance) - k_mirrored_ball, 64);
  EXPECT_LE(reach, 2);
  EXPECT_EQ(strayed_pixels(fields, exact, reach, 0.0f), 0);
  EXPECT_EQ(strayed_pixels(exact, fields, reach, 0.0f), 0);
  scene.reflections = 0;
  EXPECT_EQ(green(exact_picture(scene, accel)), 0.0);
  EXPECT_EQ(green(field_picture(scene, accel, 32)), 0.0);
}

TEST(ThesisRender, InstancesShareAField) {
  PhongScene scene;
  const uint32_t ball = add_phong_shape(scene, "ball", make_sphere({.radius = 0.5f}));
  for (const float x : {-0.8f, 0.8f}) add_phong_instance(scene, ball, {}, {x, 0.0f, 0.0f}, 0.8f);
  // In front of the second: the nearest of several hits wins.
  PhongMaterial red;
  red.emission = Rgb(1.0f, 0.0f, 0.0f);
  add_phong_instance(scene, ball, red, {0.8f, -1.0f, 0.0f}, 0.3f);
  scene.camera.eye = {0.0f, -4.0f, 0.0f};
  const Accel accel(scene.geometry);
  const PhongPicture exact = exact_picture(scene, accel), fields = field_picture(scene, accel, 64);
  // The nearest points: of the first two balls, and of the small one.
  const int reach =
      std::max(pixels_of_reach(scene.camera, 0.4f, 3.6f, 64), pixels_of_reach(scene.camera, 0.15f, 2.85f, 64));
  EXPECT_EQ(strayed_pixels(fields, exact, reach, shade_of_a_step()), 0);
  EXPECT_EQ(strayed_pixels(exact, fields, reach, shade_of_a_step()), 0);
  // The small ball is seen where it covers the second.
  const auto at = [&](const PhongPicture& p, int x) { return p.pixels[size_t(k_size / 2) * k_size + size_t(x)]; };
  for (const PhongPicture* p : {&exact, &fields}) {
    EXPECT_EQ(at(*p, 83).r, 1.0f);
    EXPECT_LT(at(*p, 22).r, 0.9f);
  }
}

TEST(ThesisPicture, RmsIsThatOfBytes) {
  PhongPicture a;
  a.size = 2;
  a.pixels.assign(4, Rgb(0.0f));
  PhongPicture b = a;
  b.pixels[0] = Rgb(1.0f);
  EXPECT_NEAR(rms_255(a, b), 127.5, 1e-9);
  b.pixels.assign(4, Rgb(0.001f));  // rounds to the same byte
  EXPECT_EQ(rms_255(a, b), 0.0);
}

TEST(ThesisPicture, BlurKeepsTheSumAndSpreads) {
  PhongPicture a;
  a.size = 9;
  a.pixels.assign(81, Rgb(0.0f));
  a.pixels[40] = Rgb(1.0f);
  const PhongPicture b = blurred(a);
  float sum = 0.0f;
  for (const Rgb& c : b.pixels) sum += c.r;
  EXPECT_NEAR(sum, 1.0f, 1e-5f);
  EXPECT_NEAR(b.pixels[41].r / b.pixels[40].r, std::exp(-0.5f), 1e-5f);
  EXPECT_EQ(b.pixels[0].r, 0.0f);
}

}  // namespace
}  // namespace fieldtrace
