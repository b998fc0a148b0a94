#include "tools/thesis/cases.h"

#include <cmath>
#include <filesystem>

#include "core/mesh/mesh_io.h"
#include "core/mesh/mesh_normals.h"
#include "core/mesh/mesh_procedural.h"

namespace fieldtrace {
namespace {

PhongMaterial coloured(const Rgb& colour) {
  PhongMaterial m;
  m.ambient = 0.15f * colour;
  m.diffuse = 0.7f * colour;
  m.specular = Rgb(0.25f);
  m.shininess = 24.0f;
  return m;
}

PhongMaterial mirror(const Rgb& colour, float share) {
  PhongMaterial m = coloured(colour);
  m.mirror = share;
  return m;
}

constexpr Rgb k_red{0.95f, 0.45f, 0.35f}, k_green{0.45f, 0.85f, 0.5f}, k_blue{0.45f, 0.6f, 0.95f};
constexpr Rgb k_sand{0.9f, 0.8f, 0.6f}, k_grey{0.75f, 0.75f, 0.78f};

// The background seen in mirrors.
constexpr Rgb k_sky{0.3f, 0.36f, 0.45f};

const PhongLight k_key = {{3.0f, -4.0f, 4.0f}, Rgb(1.0f)};

// A case without objects, under the key light.
ThesisCase empty_case(const char* name, const char* title, const Vec3& eye, float fov_degrees) {
  ThesisCase c;
  c.scene.name = name;
  c.scene.title = title;
  c.scene.camera.eye = eye;
  c.scene.camera.fov_degrees = fov_degrees;
  c.scene.lights = {k_key};
  return c;
}

// Adds a new shape and its only instance. The name identifies the mesh.
void add_object(ThesisCase& c, const char* name, TriangleMesh mesh, const PhongMaterial& material,
                const Vec3& shift = Vec3(0.0f), float scale = 1.0f) {
  add_phong_instance(c.scene, add_phong_shape(c.scene, name, std::move(mesh)), material, shift, scale);
}

// One object, seen from slightly above. From higher up, the open ends of the hyperboloid would show its inside and both
// rims, and its error would be dominated by outlines (docs/thesis.md).
ThesisCase single(const char* name, const char* title, const char* object, TriangleMesh mesh, const Rgb& colour) {
  ThesisCase c = empty_case(name, title, {0.6f, -3.0f, 0.7f}, 36.0f);
  add_object(c, object, std::move(mesh), coloured(colour));
  return c;
}

// Two objects under a sky, some of them mirrors.
ThesisCase mirror_case(const char* name, const char* title, const Vec3& eye) {
  ThesisCase c = empty_case(name, title, eye, 38.0f);
  c.scene.background = k_sky;
  c.scene.reflections = 2;
  return c;
}

// The bunny file has +y up: rotated to z up and scaled into the unit ball.
TriangleMesh upright_bunny(const std::string& path) {
  TriangleMesh mesh = load_mesh(path);
  if (mesh.normals.empty()) compute_vertex_normals(mesh);
  const Vec3 centre = mesh.bounds().centre();
  float radius = 0.0f;
  for (const Vec3& p : mesh.positions) radius = std::max(radius, glm::length(p - centre));
  const auto turned = [](const Vec3& v) { return Vec3(v.x, -v.z, v.y); };
  for (Vec3& p : mesh.positions) p = turned((p - centre) / radius);
  for (Vec3& n : mesh.normals) n = turned(n);
  return mesh;
}

ThesisCase bunny_case(const std::string& path, bool two_lights) {
  const bool found = std::filesystem::exists(path);
  const char* name = two_lights ? "bunny_two_lights" : "bunny";
  ThesisCase c = single(name, two_lights ? "Bunny, two lights" : "Bunny", "bunny",
                        found ? upright_bunny(path) : make_knot({.along = 1088, .around = 32}), k_sand);
  if (!found) c.scene.title = std::string("Torus knot in place of the bunny") + (two_lights ? ", two lights" : "");
  if (two_lights) {
    c.scene.lights.push_back({{-4.0f, -2.0f, 2.0f}, Rgb(0.5f, 0.55f, 0.7f)});
  } else {
    c.figures = {{32, 38.38, 36.35, 40}, {64, 31.31, 27.18, 40}, {128, 25.82, 21.88, 44}};
  }
  return c;
}

ThesisCase hyperboloid_case() {
  ThesisCase c = single("hyperboloid", "Hyperboloid", "hyperboloid", make_hyperboloid(), k_blue);
  c.thesis_triangles = 16384;
  c.figures = {{32, 12.38, 11.30, 37}, {64, 8.58, 7.18, 37}, {128, 6.68, 5.28, 40}};
  return c;
}

ThesisCase reflection_1() {
  ThesisCase c = mirror_case("reflection_1", "Reflection scene 1", {-0.4f, -4.2f, 1.2f});
  c.thesis_triangles = 32512;
  add_object(c, "hyperboloid", make_hyperboloid(), mirror(k_grey, 0.6f), {-0.6f, 0.3f, 0.0f});
  add_object(c, "supershape 1", thesis_supershape_1(), coloured(k_red), {0.55f, -0.6f, -0.1f}, 0.75f);
  return c;
}

// Two mirrors that see each other, for recursive reflection.
ThesisCase reflection_2() {
  ThesisCase c = mirror_case("reflection_2", "Reflection scene 2", {0.2f, -4.2f, 1.3f});
  c.thesis_triangles = 19384;
  c.polished = true;
  add_object(c, "hyperboloid", make_hyperboloid(), mirror(k_blue, 0.5f), {-0.6f, 0.0f, 0.0f});
  add_object(c, "sphere of 3,000", make_sphere({.around = 50, .along = 31}), mirror(k_sand, 0.4f), {0.6f, -0.4f, -0.1f},
             0.6f);
  c.figures = {{64, 7.15, 5.79, 62}};
  c.polished_figures = {{64, 6.76, 5.19, 62}};
  c.thesis_gpu_ms = 4024;
  c.thesis_cpu_ms = 5097;
  c.polished_gpu_ms = 67324;
  c.polished_cpu_ms = 92192;
  return c;
}

// 56,317 triangles: two supershapes, a hyperboloid, a sphere of 6,110, and a floor of 1,568 minus one at its corner.
ThesisCase shadow_scene() {
  ThesisCase c = empty_case("shadow", "Shadow scene", {0.3f, -4.6f, 3.0f}, 40.0f);
  c.thesis_triangles = 56317;
  TriangleMesh floor = make_plane({.half_size = 2.0f, .columns = 28, .rows = 28});
  floor.triangles.pop_back();
  add_object(c, "floor", std::move(floor), coloured(k_grey), {0.0f, 0.0f, -0.75f});
  add_object(c, "supershape 1", thesis_supershape_1(), coloured(k_red), {-0.8f, 0.5f, 0.0f}, 0.65f);
  add_object(c, "supershape 2", thesis_supershape_2(), coloured(k_green), {0.85f, 0.6f, 0.05f}, 0.7f);
  add_object(c, "hyperboloid", make_hyperboloid(), coloured(k_blue), {0.05f, -0.7f, -0.3f}, 0.5f);
  add_object(c, "sphere of 6,110", make_sphere({.around = 65, .along = 48}), coloured(k_sand), {-0.95f, -0.8f, -0.4f},
             0.35f);
  c.scene.camera.target = {0.0f, 0.0f, -0.3f};
  c.scene.lights = {
      {{3.0f, -3.0f, 4.0f}, Rgb(0.55f)}, {{-4.0f, -1.0f, 4.0f}, Rgb(0.4f)}, {{0.5f, 4.0f, 4.5f}, Rgb(0.35f)}};
  return c;
}

}  // namespace

ThesisFigures figures_at(const std::vector<ThesisFigures>& all, int m) {
  for (const ThesisFigures& f : all) {
    if (f.m == m) return f;
  }
  return {};
}

TriangleMesh thesis_supershape_1(int around, int along) {
  return make_supershape({.longitude = {.m = 6.0, .n1 = 1.0, .n2 = 1.0, .n3 = 1.0},
                          .latitude = {.m = 3.0, .n1 = 1.0, .n2 = 1.0, .n3 = 1.0},
                          .around = around,
                          .along = along});
}

TriangleMesh thesis_supershape_2(int around, int along) {
  return make_supershape({.longitude = {.m = 5.0, .n1 = 1.5, .n2 = 1.7, .n3 = 1.7},
                          .latitude = {.m = 4.0, .n1 = 10.0, .n2 = 10.0, .n3 = 10.0},
                          .around = around,
                          .along = along});
}

std::vector<ThesisCase> thesis_cases(const std::string& bunny) {
  std::vector<ThesisCase> cases;
  cases.push_back(single("supershape_1", "Supershape 1", "supershape 1", thesis_supershape_1(), k_red));
  cases.back().thesis_triangles = 16128;
  cases.push_back(hyperboloid_case());
  cases.push_back(bunny_case(bunny, false));
  cases.push_back(bunny_case(bunny, true));
  cases.push_back(single("supershape_2", "Supershape 2", "supershape 2", thesis_supershape_2(), k_green));
  cases.back().thesis_triangles = 16128;
  cases.back().scene.lights = {{{3.0f, -4.0f, 4.0f}, Rgb(0.6f)},
                               {{-4.0f, -2.0f, 2.0f}, Rgb(0.5f, 0.3f, 0.3f)},
                               {{0.0f, -2.0f, -4.0f}, Rgb(0.3f, 0.3f, 0.5f)}};
  cases.push_back(reflection_1());
  cases.push_back(reflection_2());
  cases.push_back(shadow_scene());
  return cases;
}

PhongScene thesis_growing_scene(size_t triangles) {
  // 2 * around * (along - 1) triangles with around = 2 * along.
  int along = 64;
  while (4 * size_t(along) * size_t(along - 1) < triangles) ++along;
  return single("growing", "Supershape 1, finer", "supershape 1, finer", thesis_supershape_1(2 * along, along), k_red)
      .scene;
}

}  // namespace fieldtrace
