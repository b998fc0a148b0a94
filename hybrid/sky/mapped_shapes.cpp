#include "hybrid/sky/mapped_shapes.h"

#include <algorithm>
#include <cmath>

#include "field/store/field.h"
#include "hybrid/sky/parallelogram.h"
#include "hybrid/visibility/linear_map.h"

namespace fieldtrace {
namespace {

constexpr double k_same_stretch = 1e-3;  // relative

bool is_same(const DMat3& a, const DMat3& b) {
  double largest = 0.0, difference = 0.0;
  for (int i = 0; i < 9; ++i) {
    largest = std::max(largest, std::abs(a[i / 3][i % 3]));
    difference = std::max(difference, std::abs(a[i / 3][i % 3] - b[i / 3][i % 3]));
  }
  return difference <= k_same_stretch * largest;
}

Sphere ball_of(const Shape& shape, const DMat3& stretch) {
  Bounds3 bounds;
  const auto extend = [&](const Vec3& p) { bounds.extend(Vec3(stretch * DVec3(p))); };
  if (is_meshed(shape.kind)) {
    for (const Vec3& p : shape.mesh.positions) extend(p);
  } else {
    for (int k = 0; k < 8; ++k) extend(shape.bounds.corner(k));
  }
  return field_ball(bounds);
}

}  // namespace

MappedShapes mapped_shapes(const Scene& scene, std::span<const ShapeTraits> traits) {
  MappedShapes result;
  result.of_instance.assign(scene.instances.size(), k_none);
  const PlaneShapes planes = plane_shapes(scene, traits);
  std::vector<uint32_t> plain(scene.shapes.size(), k_none);
  std::vector<std::vector<uint32_t>> deformed(scene.shapes.size());
  size_t deformed_count = 0;
  for (size_t i = 0; i < scene.instances.size(); ++i) {
    const uint32_t s = scene.instances[i].shape;
    if (planes.has(s)) continue;
    const DMat3 linear = linear_part(scene.instances[i].to_world);
    uint32_t& of_instance = result.of_instance[i];
    if (keeps_angles(linear)) {
      if (plain[s] == k_none) {
        plain[s] = uint32_t(result.shapes.size());
        result.shapes.push_back({s, DMat3(1.0), field_ball(scene.shapes[s].bounds)});
      }
      of_instance = plain[s];
      continue;
    }
    const std::optional<DMat3> stretch = stretch_of(linear);
    if (!stretch) continue;
    for (const uint32_t other : deformed[s]) {
      if (is_same(result.shapes[other].stretch, *stretch)) of_instance = other;
    }
    if (of_instance != k_none || deformed_count == k_most_deformed) continue;
    ++deformed_count;
    of_instance = uint32_t(result.shapes.size());
    deformed[s].push_back(of_instance);
    result.shapes.push_back({s, *stretch, ball_of(scene.shapes[s], *stretch)});
  }
  return result;
}

float median_radius(const Scene& scene, const MappedShapes& mapped) {
  std::vector<float> radii;
  for (size_t i = 0; i < scene.instances.size(); ++i) {
    if (mapped.of_instance[i] == k_none) continue;
    // Stretches have the determinant 1.
    const double scale = std::cbrt(std::abs(glm::determinant(linear_part(scene.instances[i].to_world))));
    radii.push_back(float(scale) * mapped.shapes[mapped.of_instance[i]].ball.radius);
  }
  if (radii.empty()) return 0.0f;
  const auto middle = radii.begin() + ptrdiff_t(radii.size() / 2);
  std::nth_element(radii.begin(), middle, radii.end());
  return *middle;
}

}  // namespace fieldtrace
