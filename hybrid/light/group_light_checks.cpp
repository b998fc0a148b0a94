// What --check compares of a group's light with exact rays: whole lights, strata, and the irradiance of clusters.
#include <algorithm>

#include "core/sampling/sobol.hd.h"
#include "hybrid/light/group_light.h"
#include "hybrid/stats/check_sizes.h"

namespace fieldtrace {
namespace {

// One cluster in so many, whatever the groups.
constexpr uint32_t k_strata_interval = 16, k_irradiance_interval = 64;

}  // namespace

void GroupLight::check_whole() {
  for (const bool blocked : {false, true}) {
    sampled_.clear();
    std::vector<uint32_t> clusters;
    for (const uint32_t cluster : blocked ? dark_ : clear_) push_sampled(cluster);
    if (sampled_.empty()) continue;
    for (const Sampled& s : sampled_) clusters.insert(clusters.end(), s.size(), s.cluster);
    Batch& batch = next_batch();
    laid_out_ = 0;
    select(sampled_, batch.selected);
    sample_light(context_.lights, light_, batch.selected, shared_->light_samples, context_.settings.isa, batch.shadows);
    context_.answerer.check_whole(candidates_, blocked, clusters, shared_->light_samples, batch.shadows,
                                  shared_->stats);
  }
}

// 64 rays to each stratum, from the cluster's points in turn.
void GroupLight::check_strata(uint32_t cluster, const StrataSeen& seen) const {
  const int columns = grid_.columns * k_check_side;
  const ShadingCluster& c = cluster_of(cluster);
  const ShadingPointBatch& points = shared_->receivers.points;
  if (scalar::hash_uint(points.seed[c.begin]) % k_strata_interval != 0) return;
  ShadingPointBatch centre;
  const uint32_t only[] = {cluster};
  copy_points(centres_, only, centre);
  ShadowBatch by_rows, rays;
  constexpr int k_all = k_strata * k_check_rays;
  sample_light(context_.lights, light_, centre, {k_all, 0, k_all, columns}, context_.settings.isa, by_rows);
  rays.resize(size_t(k_all));
  const Vec3 middle = centre.position(0);
  for (int i = 0; i < k_all; ++i) {
    const int row = i / columns, column = i % columns;
    const int stratum = row / k_check_side * grid_.columns + column / k_check_side;
    const int ray = row % k_check_side * k_check_side + column % k_check_side;
    const uint32_t from = c.begin + uint32_t(ray) % c.size();
    const Vec3 aside = points.position(from) - middle;
    rays.rays.set(size_t(stratum * k_check_rays + ray), by_rows.rays.origin(size_t(i)) + aside,
                  by_rows.rays.direction(size_t(i)) - aside, by_rows.rays.tmax[size_t(i)]);
  }
  context_.answerer.check_shares(candidates_, k_check_rays, rays, seen.share, shared_->stats);
}

// Rays from all of a cluster's points, of which those in decided strata count; all of the light, if `seen` is null.
void GroupLight::check_irradiance(uint32_t cluster, const Vec3& irradiance, const StrataSeen* seen) const {
  const ShadingCluster& c = cluster_of(cluster);
  const ShadingPointBatch& all = shared_->receivers.points;
  if (scalar::hash_uint(all.seed[c.begin]) % k_irradiance_interval != 0) return;
  ShadingPointBatch points;
  points.resize(c.size());
  points.copy(0, all, c.begin, c.size());
  const int each = int(std::max(k_arrival_rays / c.size(), 1u));
  LightSampleRange range = {each, 0, each};
  if (seen) range.cell_columns = grid_.columns, range.cell_rows = grid_.rows;
  ShadowBatch rays;
  sample_light(context_.lights, light_, points, range, context_.settings.isa, rays);
  std::vector<uint32_t> counted;
  double open = 0.0, exact = 0.0, estimate = 0.0;
  for (uint32_t i = 0; i < rays.rays.size; ++i) {
    if (rays.rays.tmax[i] < 0.0f) continue;
    open += double(rays.weight[i]);
    if (!seen || seen->share[rays.cell[i]] >= 0.0f) counted.push_back(i);
  }
  if (!(open > 0.0)) return;
  context_.accel.occluded(rays.rays, counted, rays.blocked.data());
  for (const uint32_t i : counted) exact += rays.blocked[i] ? 0.0 : double(rays.weight[i]);
  for (size_t i = 0; i < points.size; ++i) {
    estimate += double(std::max(glm::dot(points.shading_normal(i), irradiance), 0.0f)) * double(each);
  }
  // Per ray, and of all lights in the same unit.
  const double scale = double(luminance(light_value())) / double(rays.rays.size);
  shared_->stats.checked(CheckedEstimate::irradiance).add((estimate - exact) * scale, open * scale);
}

}  // namespace fieldtrace
