// An object under a placement and a sphere light, with shading points around it: for tests of whole lights and of
// strata.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <vector>

#include "core/mesh/mesh_procedural.h"
#include "core/simd/isa.h"
#include "core/trace/accel.h"
#include "hybrid/visibility/shadow_answerer.h"
#include "tests/support/random_lines.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace::test {

inline constexpr uint32_t k_object = 0;

struct ConeScene {
  SceneMaker maker;
  Sphere light;
  std::unique_ptr<Accel> accel;
  std::unique_ptr<Field> field;

  ConeScene(const TriangleMesh& mesh, const Affine& place, const Sphere& light_ball,
            const FieldParameters& parameters = {.directions = 32, .plane = 64})
      : light(light_ball) {
    const uint32_t bsdf = maker.bsdf(BsdfKind::diffuse, Rgb(0.5f));
    maker.instance(maker.mesh(mesh), bsdf, place);
    const Affine at(Vec3(light.radius, 0, 0), Vec3(0, light.radius, 0), Vec3(0, 0, light.radius), light.centre);
    maker.area_light(maker.instance(maker.shape(ShapeKind::sphere), bsdf, at), Rgb(1.0f));
    accel = std::make_unique<Accel>(maker.scene);
    field = std::make_unique<Field>(field_ball(maker.scene.shapes[0].bounds), parameters);
  }

  ShadowAnswerer answerer(Isa isa, float tolerance) const {
    return ShadowAnswerer(maker.scene, *accel, shape_traits(maker.scene), {field.get(), nullptr},
                          {.isa = resolve_isa(isa), .tolerance = tolerance});
  }
  // The shadow group of a batch, for lights of that many samples.
  ShadowGroup find(const ShadowAnswerer& from, const ShadingPointBatch& shading_points, int light_samples,
                   Stats& stats) const {
    ShadowGroup group;
    group.light = light_extent(maker.scene, 0);
    group.light_samples.assign(shading_points.size, uint32_t(light_samples));
    group.pixel_samples = light_samples;
    from.find_candidates({shading_points, group, stats});
    return group;
  }
  ShadowGroup query(const ShadingPointBatch& shading_points, Isa isa, float tolerance, Stats& stats) const {
    return find(answerer(isa, tolerance), shading_points, 256, stats);
  }

  // The number of `count` exact rays from points that next_point() gives to points of the light's ball that the object
  // blocks.
  template <class NextPoint>
  int blocked_rays(int count, TestRandom& random, const NextPoint& next_point) const {
    RayBatch rays;
    rays.resize(size_t(count));
    std::vector<uint32_t> all;
    for (int i = 0; i < count; ++i) {
      const Vec3 p = next_point();
      rays.set(size_t(i), p, light.centre + light.radius * random.in_ball() - p, 1.0f);
      all.push_back(uint32_t(i));
    }
    std::vector<uint8_t> blocked(size_t(count), 0);
    accel->occluded_by(k_object, rays, all, blocked.data());
    return int(std::count(blocked.begin(), blocked.end(), 1));
  }
};

// A rotation with a stretch along one axis by up to `stretch`, at about the given size.
inline Affine random_place(TestRandom& random, float size, float stretch) {
  const Vec3 x = random.direction(), z = glm::normalize(glm::cross(x, random.direction())), y = glm::cross(z, x);
  return Affine(x * size, y * size * random.uniform(1.0f / stretch, 1.0f), z * size, size * random.direction());
}

inline void set_shading_point(ShadingPointBatch& batch, size_t r, const Vec3& p, const Vec3& normal,
                              uint32_t instance) {
  batch.px[r] = p.x, batch.py[r] = p.y, batch.pz[r] = p.z;
  batch.gx[r] = normal.x, batch.gy[r] = normal.y, batch.gz[r] = normal.z;
  batch.sx[r] = normal.x, batch.sy[r] = normal.y, batch.sz[r] = normal.z;
  batch.error[r] = gamma_bound(3) * (std::abs(p.x) + std::abs(p.y) + std::abs(p.z));
  batch.radius[r] = 0.0f;
  batch.instance[r] = instance;
}

// Shading points behind the object as seen from the light, so that some lie in its shadow.
inline ShadingPointBatch shadowed_shading_points(const ConeScene& s, const Sphere& world, int count,
                                                 TestRandom& random) {
  ShadingPointBatch batch;
  batch.resize(size_t(count));
  for (int r = 0; r < count; ++r) {
    const Vec3 through = world.centre + world.radius * random.in_ball();
    const Vec3 away = glm::normalize(through - s.light.centre);
    const Vec3 p = through + away * (world.radius * random.uniform(0.2f, 3.0f));
    set_shading_point(batch, size_t(r), p, -away, k_none);
  }
  return batch;
}

// Which triangles of the object have shading points: of a solid, those whose fronts face the light have them outside,
// those whose backs do inside.
enum class OwnSide { either, front, back };

// Shading points on the object's triangles, turned to the light. `corners`, if given, receives the triangles.
inline ShadingPointBatch self_shading_points(const ConeScene& s, int count, TestRandom& random,
                                             OwnSide side = OwnSide::either,
                                             std::vector<std::array<Vec3, 3>>* corners = nullptr) {
  const TriangleMesh& mesh = s.maker.scene.shapes[0].mesh;
  const Affine& place = s.maker.scene.instances[k_object].to_world;
  ShadingPointBatch batch;
  batch.resize(size_t(count));
  for (int r = 0; r < count;) {
    const UVec3 t = mesh.triangles[random.index(uint32_t(mesh.triangles.size()))];
    const Vec3 a = transform_point(place, mesh.positions[t.x]), b = transform_point(place, mesh.positions[t.y]),
               c = transform_point(place, mesh.positions[t.z]);
    const Vec3 cross = glm::cross(b - a, c - a);
    const Vec3 p = (a + b + c) / 3.0f;
    const bool is_front = glm::dot(cross, s.light.centre - p) > 0.0f;
    if (side != OwnSide::either && is_front != (side == OwnSide::front)) continue;
    const Vec3 normal = is_front ? glm::normalize(cross) : -glm::normalize(cross);
    // Where the light is cut by the horizon, rays below it leave no shadow ray.
    if (glm::dot(normal, s.light.centre - p) < 1.5f * s.light.radius) continue;
    set_shading_point(batch, size_t(r++), p + normal * gamma_bound(64) * glm::length(p), normal, k_object);
    if (corners) corners->push_back({a, b, c});
  }
  return batch;
}

inline Sphere world_ball(const ConeScene& s) {
  const Sphere ball = field_ball(s.maker.scene.shapes[0].bounds);
  const Affine& m = s.maker.scene.instances[k_object].to_world;
  return {transform_point(m, ball.centre),
          ball.radius * std::max({glm::length(m[0]), glm::length(m[1]), glm::length(m[2])})};
}

// A knot and a light that may lie around the shading points, within the object or behind them: cases that a field
// cannot judge.
inline ConeScene tangled_scene(TestRandom& random) {
  const Affine place = random_place(random, random.log_uniform(1e-2f, 1e2f), 4.0f);
  const float size = glm::length(place[0]);
  const Sphere light = {Vec3(place[3]) + size * random.log_uniform(1e-3f, 3.0f) * random.direction(),
                        size * random.log_uniform(1e-3f, 3.0f)};
  return ConeScene(make_knot({.along = 96, .around = 12}), place, light);
}

// Shading points around such a scene's object and within it, with random normals.
inline ShadingPointBatch tangled_shading_points(const ConeScene& s, int count, TestRandom& random) {
  const Affine& place = s.maker.scene.instances[k_object].to_world;
  const float size = glm::length(place[0]);
  ShadingPointBatch batch;
  batch.resize(size_t(count));
  for (size_t r = 0; r < batch.size; ++r) {
    set_shading_point(batch, r, Vec3(place[3]) + size * random.uniform(0.0f, 2.0f) * random.direction(),
                      random.direction(), k_none);
  }
  return batch;
}

inline std::vector<TriangleMesh> solid_meshes() {
  return {make_sphere({.around = 96, .along = 48}), make_knot({.along = 256, .around = 24}), make_supershape({})};
}

}  // namespace fieldtrace::test
