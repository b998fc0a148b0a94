#include "hybrid/visibility/median_split.h"

#include <algorithm>

namespace fieldtrace {

void order_by_median_splits(std::span<PlacedIndex> points, size_t smallest) {
  if (points.size() <= smallest || points.size() < 2) return;
  Bounds3 bounds;
  for (const PlacedIndex& p : points) bounds.extend(p.position);
  const Vec3 extent = bounds.diagonal();
  const int axis = extent.x >= extent.y && extent.x >= extent.z ? 0 : extent.y >= extent.z ? 1 : 2;
  const size_t middle = middle_of(0, points.size());
  std::nth_element(points.begin(), points.begin() + ptrdiff_t(middle), points.end(),
                   [axis](const PlacedIndex& a, const PlacedIndex& b) {
                     const float x = a.position[axis], y = b.position[axis];
                     return x != y ? x < y : a.index < b.index;
                   });
  order_by_median_splits(points.first(middle), smallest);
  order_by_median_splits(points.subspan(middle), smallest);
}

}  // namespace fieldtrace
