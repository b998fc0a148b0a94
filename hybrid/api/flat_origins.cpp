#include "hybrid/api/flat_origins.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace fieldtrace::api {
namespace {

// Where a ray goes on behind its hit, with room for what rounding moves a hit and an origin by.
float behind(const Vec3& origin, const Vec3& direction, float t) {
  const Vec3 reach = glm::abs(origin) + std::abs(t) * glm::abs(direction);
  return t + gamma_bound(8) * std::max({reach.x, reach.y, reach.z}) / glm::length(direction);
}

}  // namespace

bool is_flat(const SceneObject& s, uint32_t instance) {
  return instance != k_none && s.traits[s.scene.instances[instance].shape].is_flat;
}

void pass_flat_origins(const SceneObject& s, const RayBatch& rays, std::span<const uint32_t> from, HitBatch& hits) {
  // A line meets a plane once: more often only as triangles that meet at an edge are planes by rounding.
  constexpr int k_most_passes = 4;
  const auto meets_own = [&](uint32_t i) { return is_flat(s, from[i]) && hits.instance[i] == from[i]; };
  std::vector<uint32_t> own;
  for (uint32_t i = 0; i < rays.size; ++i) {
    if (meets_own(i)) own.push_back(i);
  }
  RayBatch beyond;
  HitBatch found;
  for (int pass = 0; pass < k_most_passes && !own.empty(); ++pass) {
    beyond.resize(own.size());
    std::vector<float> starts(own.size());
    for (size_t k = 0; k < own.size(); ++k) {
      const uint32_t i = own[k];
      const Vec3 o = rays.origin(i), d = rays.direction(i);
      starts[k] = behind(o, d, hits.t[i]);
      const float left = rays.tmax[i] - starts[k];
      beyond.set(k, o + starts[k] * d, d, left >= 0.0f ? left : -1.0f);
    }
    found.resize(own.size());
    s.accel->intersect(beyond, found, Coherence::incoherent);
    for (size_t k = 0; k < own.size(); ++k) {
      hits.copy(own[k], found, k);
      hits.t[own[k]] += starts[k];
    }
    std::erase_if(own, [&](uint32_t i) { return !meets_own(i); });
  }
  for (const uint32_t i : own) hits.instance[i] = k_none;
}

}  // namespace fieldtrace::api
