#include "core/scene/scene.h"

namespace fieldtrace {

size_t Scene::triangle_count() const {
  size_t n = 0;
  for (const Instance& i : instances) n += shapes[i.shape].triangle_count();
  return n;
}

Bounds3 Scene::world_bounds() const {
  Bounds3 b;
  for (const Instance& i : instances) b.extend(i.to_world, shapes[i.shape].bounds);
  return b;
}

}  // namespace fieldtrace
