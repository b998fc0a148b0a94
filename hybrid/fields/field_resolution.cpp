#include "hybrid/fields/field_resolution.h"

#include <algorithm>
#include <cmath>

#include "hybrid/culling/light_extent.h"
#include "hybrid/fields/bake_estimate.h"
#include "hybrid/visibility/linear_map.h"

namespace fieldtrace {

namespace {

// How much wider the object's field sees a light than the scene does.
float widening(const Instance& instance, const LightExtent& light, const Vec3& centre) {
  const DMat3 to_object = linear_part(instance.to_object);
  if (light.kind == LightExtent::Kind::everywhere || keeps_angles(to_object)) return 1.0f;
  const bool bounded = light.kind == LightExtent::Kind::bounded;
  const DVec3 direction(bounded ? light.ball.centre - centre : light.towards);
  return glm::length(direction) > 0.0 ? float(angle_stretch(to_object, direction)) : 1.0f;
}

}  // namespace

float narrowest_light_degrees(const Scene& scene, std::span<const ShapeTraits> traits) {
  float narrowest = k_infinity;
  for (uint32_t light = 0; light < scene.emitters.size(); ++light) {
    const LightExtent extent = light_extent(scene, light);
    for (const Instance& instance : scene.instances) {
      if (!traits[instance.shape].wants_field) continue;
      const Vec3 centre = transform_point(instance.to_world, scene.shapes[instance.shape].bounds.centre());
      const float degrees = angular_diameter(extent, centre) * widening(instance, extent, centre);
      narrowest = std::min(narrowest, degrees);
    }
  }
  return narrowest == k_infinity ? 0.0f : narrowest;
}

namespace {

// Rays to bake all fields of the scene at these parameters.
double all_bake_rays(const FieldParameters& parameters, const Scene& scene, std::span<const ShapeTraits> traits) {
  const std::vector<double> rays = estimated_bake_rays(scene, parameters);
  double sum = 0.0;
  for (size_t s = 0; s < rays.size(); ++s) sum += traits[s].wants_field ? rays[s] : 0.0;
  return sum;
}

// Whether fine cells would take more rays to bake than they save.
bool is_costly(const Scene& scene, std::span<const ShapeTraits> traits, uint64_t rays_per_light) {
  const double light_samples = double(rays_per_light) * double(scene.emitters.size());
  return all_bake_rays(FieldParameters(), scene, traits) >
         std::max(k_costly_bake_rays, k_most_bake_share * light_samples);
}

// Approximate number of light samples taken on objects with fields.
double samples_on_objects(const Scene& scene, std::span<const ShapeTraits> traits, uint64_t rays_per_light) {
  double share = 0.0;
  for (const Instance& instance : scene.instances) {
    if (traits[instance.shape].wants_field) share += double(projected_share(scene, instance));
  }
  return double(rays_per_light) * double(scene.emitters.size()) * std::min(share, 1.0);
}

}  // namespace

float projected_share(const Scene& scene, const Instance& instance) {
  const Bounds3 bounds = world_bounds(scene.shapes[instance.shape].bounds, instance.to_world);
  const Affine& camera = scene.camera.to_world;
  const Vec3 to_centre = bounds.centre() - camera[3];
  const float radius = 0.5f * glm::length(bounds.diagonal()), distance = glm::length(to_centre);
  if (distance <= radius) return 1.0f;
  if (glm::dot(to_centre, glm::normalize(camera[2])) < -radius) return 0.0f;
  const float disc = k_pi * radius * radius / (distance * distance - radius * radius);
  const float half_width = std::tan(scene.camera.fov_x_degrees * (k_pi / 360.0f));
  const float film = 4.0f * half_width * half_width * float(scene.film.height) / float(scene.film.width);
  return std::min(disc / film, 1.0f);
}

FieldParameters choose_resolution(const Scene& scene, std::span<const ShapeTraits> traits, uint64_t rays_per_light) {
  FieldParameters parameters;
  const bool is_fine = rays_per_light >= k_fine_field_rays &&
                       narrowest_light_degrees(scene, traits) < k_wide_light_degrees &&
                       !is_costly(scene, traits, rays_per_light);
  if (!is_fine) {
    parameters.directions = 32;
    parameters.plane = 64;
  }
  if (rays_per_light < k_fine_field_rays) return parameters;
  const double most = k_finer_bake_share * samples_on_objects(scene, traits, rays_per_light);
  for (const FieldParameters& finer : {FieldParameters{64, 128}, FieldParameters{64, 256}, FieldParameters{128, 256}}) {
    const double bake_rays = all_bake_rays(finer, scene, traits);
    if (!(bake_rays > 0.0 && bake_rays <= most)) break;  // finer ones cost more still
    parameters.directions = finer.directions;
    parameters.plane = finer.plane;
  }
  return parameters;
}

}  // namespace fieldtrace
