#include "hybrid/light/light_strata.h"

#include <algorithm>

#include "core/math/math.h"

namespace fieldtrace {
namespace {

// Strata are at most this many times as long as wide.
constexpr float k_longest_stratum = 2.0f;

float length_of(const float v[3]) { return glm::length(Vec3(v[0], v[1], v[2])); }

}  // namespace

StrataGrid strata_grid(const Light& light) {
  constexpr StrataGrid k_grids[] = {{4, 4}, {8, 2}, {2, 8}, {16, 1}, {1, 16}};
  if (light.kind == LightKind::sphere) return k_grids[0];
  const bool is_plane =
      light.kind == LightKind::rectangle || light.kind == LightKind::parallelogram || light.kind == LightKind::disk;
  if (!is_plane) return {};
  const float x = length_of(light.axis[0]), y = length_of(light.axis[1]);
  StrataGrid best;
  float least = k_longest_stratum * (1.0f + gamma_bound(4));
  for (const StrataGrid& grid : k_grids) {
    const float width = x / float(grid.columns), height = y / float(grid.rows);
    const float length = std::max(width, height) / std::min(width, height);
    if (length < least) best = grid, least = length;
  }
  return best;
}

}  // namespace fieldtrace
