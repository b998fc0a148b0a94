#include "hybrid/field_resolution.h"

#include <algorithm>

#include "hybrid/bake_estimate.h"
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

namespace {

// Whether fine cells of the scene's costliest field would take more rays to bake than they are worth.
bool is_costly(const Scene& scene, std::span<const ShapeTraits> traits, uint64_t rays_per_light) {
  const std::vector<double> rays = estimated_bake_rays(scene, FieldParameters());
  double most = 0.0;
  for (size_t s = 0; s < rays.size(); ++s) most = std::max(most, traits[s].wants_field ? rays[s] : 0.0);
  const double light_samples = double(rays_per_light) * double(scene.emitters.size());
  return most > std::max(k_costly_bake_rays, k_most_bake_share * light_samples);
}

}  // namespace

FieldParameters choose_resolution(const Scene& scene, std::span<const ShapeTraits> traits, uint64_t rays_per_light) {
  FieldParameters parameters;
  const bool is_fine = rays_per_light >= k_fine_field_rays &&
                       narrowest_light_degrees(scene, traits) < k_wide_light_degrees &&
                       !is_costly(scene, traits, rays_per_light);
  if (!is_fine) {
    parameters.directions = 32;
    parameters.plane = 64;
  }
  return parameters;
}

}  // namespace fieldtrace
