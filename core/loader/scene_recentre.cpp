#include "core/loader/scene_recentre.h"

namespace fieldtrace {

DBounds world_bounds(const Scene& scene, const ScenePlacement& placement) {
  DBounds result;
  for (size_t i = 0; i < scene.instances.size(); ++i) {
    result.extend(placement.instances[i], scene.shapes[scene.instances[i].shape].bounds);
  }
  return result;
}

void recentre_meshes(Scene& scene, ScenePlacement& placement) {
  std::vector<DVec3> moved_by(scene.shapes.size(), DVec3(0.0));
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
    moved_by[s] = DVec3(centre);
  }
  for (size_t i = 0; i < scene.instances.size(); ++i) {
    const DVec3& d = moved_by[scene.instances[i].shape];
    DAffine& t = placement.instances[i];
    t[3] += t[0] * d.x + t[1] * d.y + t[2] * d.z;
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
