#include "hybrid/fields/bake_estimate.h"

#include <algorithm>
#include <cmath>
#include <span>

#include "field/store/coverage.h"
#include "hybrid/culling/light_extent.h"

namespace fieldtrace {
namespace {

std::vector<double> bake_rays_towards(std::span<const LightExtent> lights, const Scene& scene,
                                      const FieldParameters& parameters) {
  const double pi = double(k_pi);
  const double directions = double(parameters.directions) * parameters.directions;
  // Cells of the plane inside the disc of the ball; each takes its own line and those that certify it.
  const double rays_per_direction = double(parameters.plane) * parameters.plane * pi / 4.0 * (parameters.lines + 1);
  std::vector<double> rays(scene.shapes.size(), 0.0);
  for (const Instance& instance : scene.instances) {
    const Vec3 centre = transform_point(instance.to_world, scene.shapes[instance.shape].bounds.centre());
    for (const LightExtent& light : lights) {
      const double half = double(angular_diameter(light, centre)) * pi / 360.0;
      // Direction cells in the light's disc, including those that its rim cuts.
      const double across = std::sqrt((1.0 - std::cos(half)) / 2.0 * directions) + 1.0;
      rays[instance.shape] += std::min(across * across, directions) * rays_per_direction;
    }
  }
  for (double& r : rays) r = std::min(r, directions * rays_per_direction);
  return rays;
}

}  // namespace

double coverage_share(const FieldParameters& parameters) {
  const double across = double(CoverageTiles::lines_for(parameters.plane)) / double(parameters.plane);
  return across * across / double(parameters.lines + 1);
}

std::vector<double> estimated_bake_rays(const Scene& scene, const FieldParameters& parameters) {
  std::vector<LightExtent> lights;
  for (uint32_t i = 0; i < scene.emitters.size(); ++i) lights.push_back(light_extent(scene, i));
  return bake_rays_towards(lights, scene, parameters);
}

}  // namespace fieldtrace
