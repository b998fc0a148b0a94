#include "tools/thesis/scene.h"

#include <cmath>
#include <utility>

namespace fieldtrace {

uint32_t add_phong_shape(PhongScene& scene, const std::string& name, TriangleMesh mesh) {
  Shape shape;
  shape.name = name;
  shape.mesh = std::move(mesh);
  shape.bounds = shape.mesh.bounds();
  scene.geometry.shapes.push_back(std::move(shape));
  return uint32_t(scene.geometry.shapes.size() - 1);
}

uint32_t add_phong_instance(PhongScene& scene, uint32_t shape, const PhongMaterial& material, const Vec3& shift,
                            float scale, float turn_degrees) {
  const double angle = double(turn_degrees) * double(k_pi) / 180.0, s = scale;
  const DAffine to_world(DVec3(s * std::cos(angle), s * std::sin(angle), 0.0),
                         DVec3(-s * std::sin(angle), s * std::cos(angle), 0.0), DVec3(0.0, 0.0, s), DVec3(shift));
  Instance instance;
  instance.shape = shape;
  instance.to_world = Affine(to_world);
  instance.to_object = Affine(inverse_affine(to_world));
  scene.geometry.instances.push_back(instance);
  scene.materials.push_back(material);
  return uint32_t(scene.geometry.instances.size() - 1);
}

}  // namespace fieldtrace
