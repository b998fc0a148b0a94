#include "core/scene.h"

namespace fieldtrace {

size_t Scene::triangle_count() const {
  size_t n = 0;
  for (const Instance& i : instances) n += shapes[i.shape].triangle_count();
  return n;
}

Bounds3 Scene::world_bounds() const {
  Bounds3 b;
  for (const Instance& i : instances) {
    const Bounds3& s = shapes[i.shape].bounds;
    for (int c = 0; c < 8; ++c) {
      const Vec3 corner(c & 1 ? s.upper.x : s.lower.x, c & 2 ? s.upper.y : s.lower.y, c & 4 ? s.upper.z : s.lower.z);
      b.extend(transform_point(i.to_world, corner));
    }
  }
  return b;
}

}  // namespace fieldtrace
