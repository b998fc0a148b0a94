#include "hybrid/sky/sky_crowd.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "field/maps/direction_maps.h"
#include "field/store/field.h"
#include "hybrid/culling/light_extent.h"
#include "hybrid/sky/cell_occluders.h"
#include "hybrid/sky/parallelogram.h"

namespace fieldtrace {
namespace {

// Shapes are foliage if more than this share of neighbouring depths of their maps differ by more than so many texels.
constexpr float k_foliage_share = 0.4f, k_foliage_step = 2.0f;
constexpr MapSize k_foliage_size = {4, 64};

// Whether a shape's depths show no surface: maps say little about leaves to each other.
bool is_foliage(const Scene& scene, const Accel& accel, uint32_t shape, const std::atomic<bool>* stop) {
  DirectionMaps maps(field_ball(scene.shapes[shape].bounds), k_foliage_size);
  BakeCounters counters;
  if (!bake_maps(maps, accel, shape, DMat3(1.0), stop, counters)) return false;
  const int row = k_foliage_size.texels, step = int(k_foliage_step * k_depth_codes / float(row));
  const uint16_t* const depths = maps.depths(0);
  uint64_t pairs = 0, steps = 0;
  for (uint64_t k = 1; k < k_foliage_size.lines(); ++k) {
    if (k % uint64_t(row) == 0 || depths[k - 1] == 0 || depths[k] == 0) continue;
    ++pairs;
    steps += std::abs(int(depths[k - 1]) - int(depths[k])) > step;
  }
  return float(steps) > k_foliage_share * float(pairs);
}

}  // namespace

uint64_t instances_in_view(const Scene& scene) {
  const Camera& camera = scene.camera;
  const float tangent = std::tan(0.5f * camera.fov_x_degrees * k_pi / 180.0f);
  const float aspect = float(scene.film.height) / float(scene.film.width);
  const float offset = 2.0f * glm::length(camera.principal_offset);
  const float angle = std::atan(tangent * std::sqrt(1.0f + aspect * aspect) * (1.0f + offset));
  const Sphere lens{camera.to_world[3], camera.aperture_radius};
  const auto is_in_view = [&](const Instance& i) {
    const Bounds3 box = world_bounds(scene.shapes[i.shape].bounds, i.to_world);
    const Sphere ball{box.centre(), 0.5f * glm::length(box.diagonal())};
    return meets_cone(ball, lens, glm::normalize(camera.to_world[2]), angle);
  };
  return uint64_t(std::count_if(scene.instances.begin(), scene.instances.end(), is_in_view));
}

bool suits_maps(const Scene& scene, const Accel& accel, std::span<const ShapeTraits> traits, const MappedShapes& shapes,
                const std::atomic<bool>* stop) {
  std::vector<uint8_t> needs_map;
  for (size_t s = 0; s < scene.shapes.size(); ++s) needs_map.push_back(!parallelogram(scene.shapes[s], traits[s]));
  size_t without = 0;
  for (size_t i = 0; i < scene.instances.size(); ++i) {
    without += shapes.of_instance[i] == k_none && needs_map[scene.instances[i].shape];
  }
  if (without > k_crowd) return false;
  return std::none_of(shapes.shapes.begin(), shapes.shapes.end(), [&](const MappedShape& of) {
    return !of.is_deformed() && is_foliage(scene, accel, of.shape, stop);
  });
}

}  // namespace fieldtrace
