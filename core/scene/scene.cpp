#include "core/scene/scene.h"

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
    for (int c = 0; c < 8; ++c) b.extend(transform_point(i.to_world, s.corner(c)));
  }
  return b;
}

}  // namespace fieldtrace
