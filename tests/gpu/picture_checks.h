// Pictures through an emulated GPU beside those of the CPU, and scenes for them.
#pragma once

#include <gtest/gtest.h>

#include <fstream>

#include "core/loader/scene_xml.h"
#include "core/mesh/mesh_io.h"
#include "core/mesh/mesh_procedural.h"
#include "tests/gpu/emulated_device.h"
#include "tests/support/field_checks.h"
#include "tests/support/random_lines.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace::test {

inline RenderOptions options_for(int spp, int light_samples) {
  RenderOptions o;
  o.spp = spp;
  o.light_samples = light_samples;
  o.threads = 2;
  o.directions = 32;
  o.plane = 64;
  o.leave_to_rays = false;
  return o;
}

// What decides a picture, beside its pixels. Look-ups are not among it: they are repeated as bakes demand.
inline void expect_equal(const RenderResult& device, const RenderResult& cpu, const std::string& name) {
  EXPECT_EQ(device.image.data, cpu.image.data) << name;
  const Stats &a = device.stats, &b = cpu.stats;
  EXPECT_EQ(a.rays_exact, b.rays_exact) << name;
  EXPECT_EQ(a.rays_crossing, b.rays_crossing) << name;
  EXPECT_EQ(a.cones_clear, b.cones_clear) << name;
  EXPECT_EQ(a.cones_blocked, b.cones_blocked) << name;
  EXPECT_EQ(a.strata_refused, b.strata_refused) << name;
  EXPECT_EQ(a.samples_spared, b.samples_spared) << name;
  EXPECT_EQ(a.check_answers, b.check_answers) << name;
  EXPECT_EQ(a.check_wrong, b.check_wrong) << name;
  EXPECT_EQ(a.field_cells_baked, b.field_cells_baked) << name;
  EXPECT_EQ(a.field_tiles_baked, b.field_tiles_baked) << name;
}

inline void expect_no_fault(const EmulatedPicture& device, const std::string& name) {
  EXPECT_TRUE(device.warnings.empty()) << name << ": " << device.warnings[0];
  EXPECT_TRUE(is_clean(device.log)) << name;
}

// Renders on the CPU and on the device, first while fields are baked, then with the fields that this has left, of which
// the device answers nearly all blocks itself. (It is also asked about whole lights that occluders before have settled,
// whose cells need not be there.)
inline void expect_same_picture(const Scene& scene, RenderOptions o, const std::string& name,
                                const gpu::EmulatedFaults& faults = {}) {
  const RenderResult cpu = render(scene, o);
  const EmulatedPicture cold = render_emulated(scene, o, faults);
  expect_equal(cold.result, cpu, name);
  expect_no_fault(cold, name);
  const TemporaryFolder folder;
  o.field_cache = folder.path();
  render(scene, o);
  const RenderResult warm_cpu = render(scene, o);
  const EmulatedPicture warm = render_emulated(scene, o, faults);
  expect_equal(warm.result, warm_cpu, name + ", baked before");
  EXPECT_EQ(warm.result.image.data, cold.result.image.data) << name;
  expect_no_fault(warm, name + ", baked before");
  const Stats& s = warm.result.stats;
  EXPECT_GT(s.device_blocks, 0u) << name;
  EXPECT_GE(double(s.device_blocks), 0.9 * double(s.device_blocks + s.device_blocks_cpu)) << name;
}

inline Scene knot_over_floor(const Mat3& shape, int size) {
  SceneMaker s;
  s.film(size, size);
  s.scene.camera.to_world = look_at({2.5f, -6, 3}, {0, 0, 0.3f}, {0, 0, 1});
  s.scene.camera.fov_x_degrees = 20.0f;
  const uint32_t grey = s.bsdf(BsdfKind::diffuse, Rgb(0.5f));
  s.instance(s.mesh(make_knot({.along = 256, .around = 24})), grey, Affine(shape[0], shape[1], shape[2], {0, 0, 1}));
  s.instance(s.shape(ShapeKind::rectangle), grey, scaling(Vec3(6.0f)));
  Affine at = scaling(Vec3(0.5f));
  at[3] = {2, -2, 4};
  s.area_light(s.instance(s.shape(ShapeKind::sphere), grey, at), Rgb(60.0f));
  const Affine turned = look_at({-2, -3, 5}, {0, 0, 0.5f}, {0, 0, 1});
  s.area_light(s.instance(s.shape(ShapeKind::rectangle), grey,
                          Affine(0.7f * turned[0], 0.4f * turned[1], 0.4f * turned[2], turned[3])),
               Rgb(60.0f));
  return s.scene;
}

// The same without the lights, under a constant sky.
inline Scene knot_under_sky(int size) {
  Scene scene = knot_over_floor(Mat3(1.0f), size);
  Emitter sky;
  sky.kind = EmitterKind::constant;
  scene.emitters = {sky};
  for (Instance& i : scene.instances) i.emitter = k_none;
  return scene;
}

// The demo, with a knot in the place of its bunny: under its two lights, or under its sky.
inline Scene demo(int width, bool sky) {
  const TemporaryFolder folder;
  const auto save = [&](const char* name, const TriangleMesh& mesh) {
    std::string path = folder.path() + "/" + name;
    save_ply(path, mesh);
    return path;
  };
  SceneLoadOptions options;
  options.strict = true;
  options.parameters = {{"width", std::to_string(width)}, {"height", std::to_string(width * 9 / 16)}};
  if (sky) options.parameters["lights"] = "demo_sky.xml";
  options.parameters["bunny"] = folder.path() + "/knot.obj";
  {
    const TriangleMesh knot = make_knot({.along = 256, .around = 24});
    std::ofstream obj(options.parameters["bunny"]);
    for (const Vec3& p : knot.positions) obj << "v " << p.x << " " << p.y << " " << p.z << "\n";
    for (const auto& t : knot.triangles) obj << "f " << t[0] + 1 << " " << t[1] + 1 << " " << t[2] + 1 << "\n";
  }
  options.parameters["shape1"] =
      save("shape1.ply", make_supershape({.longitude = {.m = 7, .n1 = 0.6, .n2 = 1.2, .n3 = 1.2},
                                          .latitude = {.m = 3, .n1 = 1.2, .n2 = 1.6, .n3 = 1.6}}));
  options.parameters["shape2"] =
      save("shape2.ply", make_supershape({.longitude = {.m = 5, .n1 = 0.4, .n2 = 1.7, .n3 = 1.7},
                                          .latitude = {.m = 4, .n1 = 10, .n2 = 10, .n3 = 10}}));
  return load_scene(std::string(FIELDTRACE_SOURCE_DIR) + "/scenes/demo.xml", options);
}

// A rough metal floor under a diffuse object, whose radiance maps answer glossy rays; lit
// by a lamp and, if `sky`, by the sky.
inline Scene glossy_floor(int size, bool sky) {
  SceneMaker m;
  m.film(size, size);
  m.scene.camera.to_world = look_at({3, 3, 5}, {0, 0.4f, 0}, {0, 1, 0});
  m.scene.integrator.max_depth = 3;
  const uint32_t clay = m.bsdf(BsdfKind::diffuse, Rgb(0.5f, 0.4f, 0.3f));
  m.scene.bsdfs[clay].two_sided = true;
  const uint32_t metal = m.metal(0.15f);
  m.instance(m.mesh(make_knot({.along = 256, .around = 24})), clay, translation({0, 1.2f, 0}));
  m.lit_floor(metal, clay);
  if (sky) m.light(EmitterKind::constant, Rgb(0.3f));
  return m.scene;
}

// A crop of a film of 128 x 128 pixels; radiance maps by request.
inline RenderOptions glossy_options() {
  RenderOptions o = options_for(1, 4);
  o.lobe_samples = 256;
  o.crop = Rect{44, 60, 16, 16};
  return o;
}

// Instances of three meshes, more than single rays are tested against.
inline Scene crowd(int size) {
  SceneMaker maker;
  TestRandom random(1);
  maker.film(size, size);
  maker.scene.camera.to_world = look_at({0, -9, 5}, {0, 0, 0}, {0, 0, 1});
  maker.scene.camera.fov_x_degrees = 35.0f;
  const uint32_t grey = maker.bsdf(BsdfKind::diffuse, Rgb(0.5f));
  maker.instance(maker.shape(ShapeKind::rectangle), grey, scaling(Vec3(8.0f)));
  std::vector<uint32_t> shapes;
  for (int i = 0; i < 3; ++i) {
    SupershapeParams p;
    p.longitude.m = 3.0 + i;
    p.around = 32;
    p.along = 16;
    shapes.push_back(maker.mesh(make_supershape(p)));
  }
  for (int n = 0; n < 49; ++n) {
    const float scale = random.uniform(0.25f, 0.5f);
    Affine a = scaling(Vec3(scale));
    a[3] = {float(n % 7 - 3) + random.uniform(-0.2f, 0.2f), float(n / 7 - 3) + random.uniform(-0.2f, 0.2f), scale};
    maker.instance(shapes[random.index(3)], grey, a);
  }
  Affine light = scaling(Vec3(0.7f));
  light[3] = {4, -4, 6};
  maker.area_light(maker.instance(maker.shape(ShapeKind::sphere), grey, light), Rgb(100.0f));
  return maker.scene;
}

}  // namespace fieldtrace::test
