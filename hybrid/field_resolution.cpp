#include "hybrid/field_resolution.h"

#include <algorithm>

#include "hybrid/light_extent.h"

namespace fieldtrace {

float narrowest_light_degrees(const Scene& scene, std::span<const ShapeTraits> traits) {
  float narrowest = k_infinity;
  for (uint32_t light = 0; light < scene.emitters.size(); ++light) {
    const LightExtent extent = light_extent(scene, light);
    for (const Instance& instance : scene.instances) {
      if (!traits[instance.shape].wants_field) continue;
      const Vec3 centre = transform_point(instance.to_world, scene.shapes[instance.shape].bounds.centre());
      narrowest = std::min(narrowest, angular_diameter(extent, centre));
    }
  }
  return narrowest == k_infinity ? 0.0f : narrowest;
}

FieldParameters choose_resolution(const Scene& scene, std::span<const ShapeTraits> traits, uint64_t rays_per_light) {
  FieldParameters parameters;
  if (rays_per_light < k_fine_field_rays || narrowest_light_degrees(scene, traits) >= k_wide_light_degrees) {
    parameters.directions = 32;
    parameters.plane = 64;
  }
  return parameters;
}

}  // namespace fieldtrace
