// Scenes of the thesis: meshes and their instances, Phong materials, point lights, a pinhole camera.
//
// Geometry is a fieldtrace::Scene, so that Embree and the fields see the same triangles. Its cameras, emitters and
// materials are not used: the thesis' lighting model has no falloff and conserves no energy.
// Space: world. Colours are display values in [0, 1], shown without a transfer curve (as 0 ... 255).
// Thread-safety: values, const during rendering.
#pragma once

#include <string>
#include <vector>

#include "core/scene/scene.h"

namespace fieldtrace {

// Phong's light equation: emission + ambient * scene ambient + sum over lights of diffuse (N.L) + specular (R.V)^n.
struct PhongMaterial {
  Rgb emission = Rgb(0.0f);
  Rgb ambient = Rgb(0.1f);
  Rgb diffuse = Rgb(0.7f);
  Rgb specular = Rgb(0.2f);
  float shininess = 20.0f;
  float mirror = 0.0f;  // [0, 1]: share of the reflected ray's colour, the rest is the material's own
};

struct PhongLight {
  Vec3 position = Vec3(0.0f);  // outside every object's bounding sphere
  Rgb colour = Rgb(1.0f);
};

struct PhongCamera {
  Vec3 eye = Vec3(0.0f, -4.0f, 0.0f), target = Vec3(0.0f), up = Vec3(0.0f, 0.0f, 1.0f);
  float fov_degrees = 40.0f;  // horizontal and vertical: images are square
};

struct PhongScene {
  std::string name;   // for file names and CSV: lower case, no spaces
  std::string title;  // for people
  Scene geometry;
  std::vector<PhongMaterial> materials;  // one per instance of `geometry`
  std::vector<PhongLight> lights;
  Rgb ambient = Rgb(1.0f);
  Rgb background = Rgb(0.0f);
  PhongCamera camera;
  int reflections = 0;          // maximum depth of reflections
  float polish_radius = 0.04f;  // tangent of the cone of a polished reflection's four rays
};

// Adds a shape, and an instance of a shape (scaled, then rotated about z, then translated). Both return the index.
uint32_t add_phong_shape(PhongScene& scene, const std::string& name, TriangleMesh mesh);
uint32_t add_phong_instance(PhongScene& scene, uint32_t shape, const PhongMaterial& material,
                            const Vec3& shift = Vec3(0.0f), float scale = 1.0f, float turn_degrees = 0.0f);

}  // namespace fieldtrace
