// The thesis' pipeline with fields and with exact rays: errors, shadows, mirrors, instances, determinism.
#include "tools/thesis/render.h"

#include <gtest/gtest.h>
#include <tbb/task_arena.h>

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

TEST(ThesisRender, ErrorFallsWithFinerDirections) {
  const PhongScene scene = thesis_growing_scene(16128);
  const Accel accel(scene.geometry);
  const PhongPicture reference = exact_picture(scene, accel);
  double before = 255.0;
  for (const int m : {8, 16, 32, 64}) {
    const double rms = rms_255(field_picture(scene, accel, m), reference);
    EXPECT_LT(rms, before) << m;
    before = rms;
  }
  EXPECT_LT(before, 12.0);
  EXPECT_GT(before, 1.0);  // else the reference was compared with itself
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

// A mirror facing the camera and a glowing ball behind the camera, visible only in the mirror.
PhongScene mirror_scene() {
  PhongScene scene;
  const uint32_t plate =
      add_phong_shape(scene, "plate", make_hyperboloid({.waist = 0.98f, .rim = 1.0f, .half_height = 1.0f}));
  const uint32_t ball = add_phong_shape(scene, "ball", make_sphere({.radius = 0.5f}));
  PhongMaterial mirror, glow;
  mirror.mirror = 1.0f;
  mirror.ambient = mirror.diffuse = mirror.specular = Rgb(0.0f);
  glow.emission = Rgb(0.0f, 1.0f, 0.0f);
  glow.ambient = Rgb(0.0f);
  add_phong_instance(scene, plate, mirror);
  add_phong_instance(scene, ball, glow, {0.0f, -5.0f, 0.6f});
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
  const double exact = green(exact_picture(scene, accel)), fields = green(field_picture(scene, accel, 64));
  EXPECT_GT(exact, 20.0);
  EXPECT_NEAR(fields / exact, 1.0, 0.4);
  const double polished = green(exact_picture(scene, accel, 4));
  EXPECT_NEAR(polished / exact, 1.0, 0.1);
  EXPECT_NE(polished, exact);
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
  EXPECT_LT(rms_255(fields, exact), 12.0);
  // The small ball is visible where it covers the second.
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
