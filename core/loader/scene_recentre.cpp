#include "core/loader/scene_recentre.h"

#include <limits>

namespace fieldtrace {
namespace {

struct DBounds {
  DVec3 lower = DVec3(std::numeric_limits<double>::infinity());
  DVec3 upper = DVec3(-std::numeric_limits<double>::infinity());

  void extend(const DVec3& p) {
    lower = glm::min(lower, p);
    upper = glm::max(upper, p);
  }
  bool empty() const { return !(lower.x <= upper.x); }
  DVec3 centre() const { return 0.5 * lower + 0.5 * upper; }
  bool far_off() const { return !empty() && glm::length(centre()) > k_recentre_diagonals * glm::length(upper - lower); }
};

DBounds world_bounds(const Scene& scene, const ScenePlacement& placement) {
  DBounds result;
  for (size_t i = 0; i < scene.instances.size(); ++i) {
    const Bounds3& b = scene.shapes[scene.instances[i].shape].bounds;
    const DAffine& t = placement.instances[i];
    for (int c = 0; c < 8; ++c) result.extend(transform_point(t, DVec3(b.corner(c))));
  }
  return result;
}

}  // namespace

void recentre_meshes(Scene& scene, ScenePlacement& placement) {
  for (size_t s = 0; s < scene.shapes.size(); ++s) {
    Shape& shape = scene.shapes[s];
    if (shape.kind != ShapeKind::mesh) continue;
    DBounds bounds;
    bounds.extend(DVec3(shape.bounds.lower));
    bounds.extend(DVec3(shape.bounds.upper));
    if (!bounds.far_off()) continue;
    const Vec3 centre(bounds.centre());
    for (Vec3& p : shape.mesh.positions) p -= centre;
    shape.bounds = shape.mesh.bounds();
    for (size_t i = 0; i < scene.instances.size(); ++i)
      if (scene.instances[i].shape == s) {
        DAffine& t = placement.instances[i];
        t[3] += t[0] * double(centre.x) + t[1] * double(centre.y) + t[2] * double(centre.z);
      }
  }
}

void place_scene(Scene& scene, const ScenePlacement& placement) {
  const DBounds bounds = world_bounds(scene, placement);
  scene.origin = bounds.far_off() ? bounds.centre() : DVec3(0.0);
  for (size_t i = 0; i < scene.instances.size(); ++i) {
    DAffine t = placement.instances[i];
    t[3] -= scene.origin;
    scene.instances[i].to_world = Affine(t);
    scene.instances[i].to_object = Affine(inverse_affine(t));
  }
  for (size_t i = 0; i < scene.emitters.size(); ++i)
    if (scene.emitters[i].kind == EmitterKind::point)
      scene.emitters[i].position = Vec3(placement.emitters[i] - scene.origin);
  DAffine camera = placement.camera;
  camera[3] -= scene.origin;
  scene.camera.to_world = Affine(camera);
}

}  // namespace fieldtrace
