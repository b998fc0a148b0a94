#include "hybrid/sky/enclosed_points.h"

#include <algorithm>

#include "core/trace/rays.h"
#include "field/maps/cell_kernels.h"

namespace fieldtrace {
namespace {

// From this hidden share of the sky on, what is hidden is corrected, from twice as much fully.
constexpr float k_least_enclosed = 0.25f;

}  // namespace

void EnclosedPoints::scale(const Sky& sky, const ShadingPointBatch& points, std::span<const float> open, Isa isa,
                           const CellLightSums& hidden) {
  const auto share = [&](size_t i) { return luminance({hidden.red[i], hidden.green[i], hidden.blue[i]}) / open[i]; };
  points_.clear();
  for (uint32_t i = 0; i < points.size; ++i) {
    if (share(i) > k_least_enclosed) points_.push_back(i);
  }
  if (points_.empty()) return;
  const size_t size = padded(points_.size());
  for (auto* arrays : {normals_, sums_}) {
    for (int a = 0; a < 3; ++a) arrays[a].assign(size, 0.0f);
  }
  for (size_t k = 0; k < points_.size(); ++k) {
    const uint32_t i = points_[k];
    normals_[0][k] = points.sx[i], normals_[1][k] = points.sy[i], normals_[2][k] = points.sz[i];
  }
  cell_kernels(isa).sum_cells(sky.cells_of(points.instance[0]).lights(),
                              {normals_[0].data(), normals_[1].data(), normals_[2].data(), int32_t(size)}, 0.0f,
                              {sums_[0].data(), sums_[1].data(), sums_[2].data()});
  for (size_t k = 0; k < points_.size(); ++k) {
    const uint32_t i = points_[k];
    const float weight = std::min((share(i) - k_least_enclosed) / k_least_enclosed, 1.0f);
    const float whole = luminance(sky.radiance().irradiance(points.shading_normal(i)));
    const float scale = 1.0f + weight * (whole / luminance({sums_[0][k], sums_[1][k], sums_[2][k]}) - 1.0f);
    hidden.red[i] *= scale, hidden.green[i] *= scale, hidden.blue[i] *= scale;
  }
}

}  // namespace fieldtrace
