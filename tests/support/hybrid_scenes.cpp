#include "tests/support/hybrid_scenes.h"

#include <gtest/gtest.h>

#include "core/math/frame.h"
#include "core/mesh/mesh_procedural.h"
#include "core/mesh/mesh_stress.h"
#include "tests/support/random_lines.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace::test {
namespace {

TriangleMesh supershape(float radius = 1.0f) { return make_supershape({.around = 64, .along = 32, .radius = radius}); }
TriangleMesh knot() { return make_knot({.along = 128, .around = 12}); }

// `linear`, turned so that its z axis points along `axis`, then moved to `at`.
Affine placed(const Vec3& at, const Mat3& linear = Mat3(1.0f), const Vec3& axis = Vec3(0, 0, 1)) {
  const Frame f = frame_about(glm::normalize(axis));
  const Mat3 m = Mat3(f.s, f.t, f.n) * linear;
  return Affine(m[0], m[1], m[2], at);
}

Mat3 scale(const Vec3& s) { return Mat3(Vec3(s.x, 0, 0), Vec3(0, s.y, 0), Vec3(0, 0, s.z)); }

// A uniform grey floor under a camera that looks down on it from the side.
struct Stage : SceneMaker {
  uint32_t grey, floor;

  explicit Stage(int size) {
    film(size, size);
    scene.sample_count = 1;
    scene.camera.to_world = look_at({0, -7, 4}, {0, 0, 0.7f}, {0, 0, 1});
    scene.camera.fov_x_degrees = 28.0f;
    grey = bsdf(BsdfKind::diffuse, Rgb(0.6f, 0.5f, 0.7f));
    floor = instance(shape(ShapeKind::rectangle), grey, scaling(Vec3(6.0f)));
  }

  // One-sided lights face downwards.
  void sphere_light(const Vec3& at, float radius) {
    area_light(instance(shape(ShapeKind::sphere), grey, placed(at, scale(Vec3(radius)))), Rgb(40.0f));
  }
  void flat_light(ShapeKind kind, const Vec3& at, float half_size) {
    area_light(instance(shape(kind), grey, placed(at, scale(Vec3(half_size)), -at)), Rgb(20.0f));
  }
};

Scene object_over_floor(int size) {
  Stage s(size);
  s.instance(s.mesh(supershape()), s.grey, placed({0, 0, 1.05f}));
  s.sphere_light({2.0f, -1.5f, 5.0f}, 0.6f);
  return s.scene;
}

Scene overlapping(int size) {
  Stage s(size);
  TestRandom random(7);
  const uint32_t shapes[2] = {s.mesh(knot()), s.mesh(supershape())};
  for (int i = 0; i < 10; ++i) {
    const Vec3 at = Vec3(0, 0, 1.3f) + random.in_ball() * 0.8f;
    s.instance(shapes[i % 2], s.grey, placed(at, scale(Vec3(random.uniform(0.3f, 0.9f))), random.direction()));
  }
  s.flat_light(ShapeKind::rectangle, {-2.0f, -2.0f, 5.0f}, 0.7f);
  s.light(EmitterKind::point, Rgb(10.0f), {3.0f, -2.0f, 3.5f});
  return s.scene;
}

// More objects than the candidates that a group tests one by one.
Scene crowd(int size) {
  Stage s(size);
  TestRandom random(8);
  const uint32_t shape = s.mesh(supershape());
  for (int i = 0; i < 80; ++i) {
    const Vec3 at(random.uniform(-2.5f, 2.5f), random.uniform(-2.5f, 2.5f), random.uniform(0.2f, 1.5f));
    s.instance(shape, s.grey, placed(at, scale(Vec3(random.uniform(0.1f, 0.3f))), random.direction()));
  }
  s.flat_light(ShapeKind::disk, {1.0f, -2.0f, 5.0f}, 0.8f);
  return s.scene;
}

Scene lights_within(int size) {
  Stage s(size);
  s.instance(s.mesh(make_holy_sphere({.holes = 16, .hole_radius_degrees = 16.0f, .around = 48, .along = 24})), s.grey,
             placed({0, 0, 1.1f}));
  s.sphere_light({0.1f, -0.2f, 1.3f}, 0.2f);
  s.light(EmitterKind::point, Rgb(2.0f), {-0.3f, 0.2f, 0.9f});
  return s.scene;
}

// Shading points inside the balls of objects that they do not lie on: a knot in the waist of a hyperboloid.
Scene nested_balls(int size) {
  Stage s(size);
  s.instance(s.mesh(make_hyperboloid({.waist = 0.5f, .rim = 0.8f, .around = 48, .along = 24})), s.grey,
             placed({0, 0, 1.2f}, scale(Vec3(1.4f))));
  s.instance(s.mesh(knot()), s.grey, placed({0.1f, 0, 1.4f}, scale(Vec3(0.5f)), {1, 0, 1}));
  s.flat_light(ShapeKind::rectangle, {1.0f, -1.0f, 5.0f}, 0.9f);
  return s.scene;
}

Scene open_sheet(int size) {
  Stage s(size);
  s.instance(s.mesh(make_wavy_sheet({.cells = 32})), s.grey, placed({0, 0, 1.0f}, scale(Vec3(2.0f)), {0.2f, -0.5f, 1}));
  s.light(EmitterKind::directional, Rgb(2.0f), glm::normalize(Vec3(0.5f, 0.8f, -1.5f)));
  s.flat_light(ShapeKind::disk, {0.0f, -1.0f, 4.5f}, 0.8f);
  return s.scene;
}

// Mirrored, stretched and sheared; lit by a mesh that is itself an object with a field.
Scene odd_transforms(int size) {
  Stage s(size);
  const uint32_t shape = s.mesh(supershape()), other = s.mesh(knot());
  s.instance(shape, s.grey, placed({-1.2f, 0, 0.9f}, scale({-0.8f, 0.8f, 0.8f}), {1, 2, 3}));
  s.instance(shape, s.grey, placed({1.2f, 0, 0.8f}, scale({1.3f, 0.4f, 0.7f}), {-1, 0.5f, 1}));
  s.instance(other, s.grey, placed({0, 1.2f, 1.2f}, Mat3(Vec3(1, 0, 0), Vec3(0.7f, 0.8f, 0), Vec3(-0.4f, 0.5f, 1))));
  s.area_light(s.instance(s.mesh(make_sphere({.radius = 1.0f, .around = 24, .along = 12})), s.grey,
                          placed({1.5f, -1.5f, 4.5f}, Mat3(Vec3(0.5f, 0, 0), Vec3(0.2f, 0.4f, 0), Vec3(0, 0, 0.6f)))),
               Rgb(40.0f));
  return s.scene;
}

// Equal sizes in the world, from meshes a thousand times larger and smaller.
Scene resized_meshes(int size) {
  Stage s(size);
  s.instance(s.mesh(supershape(1e3f)), s.grey, placed({-0.9f, 0, 0.9f}, scale(Vec3(0.8e-3f)), {1, 1, 3}));
  s.instance(s.mesh(supershape(1e-3f)), s.grey, placed({0.9f, 0, 0.9f}, scale(Vec3(0.8e3f)), {-1, 1, 2}));
  s.sphere_light({2.0f, -1.5f, 5.0f}, 0.6f);
  return s.scene;
}

Scene environment(int size) {
  Stage s(size);
  s.instance(s.mesh(knot()), s.grey, placed({0, 0, 1.0f}, scale(Vec3(1.1f)), {0, -1, 1}));
  s.light(EmitterKind::constant, Rgb(0.8f));
  return s.scene;
}

// A sky with a sun over dark ground, with its up axis turned to +z.
Scene environment_map(int size) {
  Stage s(size);
  s.instance(s.mesh(supershape()), s.grey, placed({0, 0, 1.05f}));
  const auto sky = [](int x, int y) {
    return x / 2 == 9 && y / 2 == 3 ? Rgb(30.0f, 28.0f, 25.0f) : y < 9 ? Rgb(0.3f, 0.4f, 0.6f) : Rgb(0.1f);
  };
  s.environment(32, 17, sky, Mat3(Vec3(1, 0, 0), Vec3(0, 0, 1), Vec3(0, -1, 0)));
  return s.scene;
}

// Glass, metal, and objects without fields beside one with.
Scene materials(int size) {
  Stage s(size);
  const uint32_t metal = s.bsdf(BsdfKind::rough_conductor, Rgb(0.9f));
  const uint32_t glass = s.bsdf(BsdfKind::dielectric, Rgb(1.0f));
  s.instance(s.mesh(supershape()), metal, placed({-1.0f, 0.3f, 1.0f}));
  s.instance(s.shape(ShapeKind::sphere), glass, placed({1.1f, -0.5f, 0.8f}, scale(Vec3(0.7f))));
  s.instance(s.mesh(make_cube()), s.grey, placed({0.8f, 1.2f, 0.8f}, Mat3(1.0f), {1, 2, 3}));
  s.sphere_light({2.0f, -1.5f, 5.0f}, 0.5f);
  s.flat_light(ShapeKind::rectangle, {-2.0f, -1.0f, 4.0f}, 0.5f);
  return s.scene;
}

// Rough glass, which is lit from both sides, a mask and rough plastic, all with fields.
Scene coatings(int size) {
  Stage s(size);
  const uint32_t glass = s.bsdf(BsdfKind::rough_dielectric, Rgb(1.0f));
  s.scene.bsdfs[glass].alpha_u = s.scene.bsdfs[glass].alpha_v = 0.4f;
  s.instance(s.mesh(supershape()), glass, placed({-1.1f, 0.2f, 1.0f}));
  s.instance(s.mesh(knot()), s.masked(s.grey, 0.6f), placed({1.2f, -0.6f, 0.9f}, scale(Vec3(0.8f)), {0, -1, 1}));
  s.instance(s.mesh(supershape()), s.bsdf(BsdfKind::rough_plastic, Rgb(0.5f)),
             placed({0.8f, 1.6f, 0.9f}, scale(Vec3(0.8f)), {1, 0, 2}));
  s.sphere_light({2.0f, -1.5f, 5.0f}, 0.5f);
  s.flat_light(ShapeKind::rectangle, {-2.0f, -1.0f, 4.0f}, 0.5f);
  return s.scene;
}

// A scene scaled as a whole: the picture changes only by rounding and by the fall-off of point lights.
Scene resized(Scene scene, float factor) {
  for (Instance& i : scene.instances) {
    i.to_world *= factor;
    i.to_object = Affine(inverse_affine(DAffine(i.to_world)));
  }
  for (Emitter& e : scene.emitters) e.position *= factor;
  scene.camera.to_world[3] *= factor;
  scene.camera.near_clip *= factor;
  scene.camera.far_clip *= factor;
  return scene;
}

}  // namespace

std::vector<HybridScene> hybrid_scenes(int size) {
  std::vector<HybridScene> scenes;
  scenes.push_back({"object_over_floor", object_over_floor(size)});
  scenes.push_back({"overlapping", overlapping(size)});
  scenes.push_back({"crowd", crowd(size), true, false});
  scenes.push_back({"lights_within", lights_within(size), false});
  scenes.push_back({"nested_balls", nested_balls(size), false});
  scenes.push_back({"open_sheet", open_sheet(size), false, false});
  scenes.push_back({"odd_transforms", odd_transforms(size)});
  scenes.push_back({"resized_meshes", resized_meshes(size)});
  scenes.push_back({"tiny_world", resized(odd_transforms(size), 1e-3f)});
  scenes.push_back({"huge_world", resized(odd_transforms(size), 1e3f)});
  scenes.push_back({"environment", environment(size), true, false});
  scenes.push_back({"environment_map", environment_map(size), true, false});
  scenes.push_back({"materials", materials(size), true, false});
  scenes.push_back({"coatings", coatings(size)});
  return scenes;
}

HybridScene hybrid_scene(const std::string& name, int size) {
  for (HybridScene& s : hybrid_scenes(size)) {
    if (s.name == name) return s;
  }
  ADD_FAILURE() << "no scene is named " << name;
  return {};
}

}  // namespace fieldtrace::test
