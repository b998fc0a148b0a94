// What --check compares of the sky's light with exact rays: shares of cells, what arrives at a point of the sky and of
// objects, and what was fitted.
#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/sampling/sobol.hd.h"
#include "core/sampling/warp.hd.h"
#include "field/bake/cell_lines.h"
#include "field/maps/cell_visibility.hd.h"
#include "hybrid/light/sky_light.h"
#include "hybrid/stats/check_sizes.h"

namespace fieldtrace {
namespace {

// One cluster in so many, and rays in each cell (a square number).
constexpr uint32_t k_check_interval = 256;
constexpr int k_cell_side = 4, k_cell_rays = k_cell_side * k_cell_side;

}  // namespace

void SkyLight::check_cells(const Job& job) {
  for (size_t i = 0; i < centres_.size; ++i) {
    if (scalar::hash_uint(centres_.seed[i]) % k_check_interval != 0) continue;
    check_shares(job, i);
    // Skies of both kinds in one picture would mix their units.
    if (sky_ != context_.occlusion_sky || !context_.sky) check_arrival(job, i);
  }
}

// Asks for some of the points that were fitted.
void SkyLight::check_fitted(const Job& job) {
  wanted_.clear();
  for (uint32_t i = 0; i < fitted_.size(); ++i) {
    if (fitted_[i] && scalar::hash_uint(points_.seed[i]) % k_check_interval == 0) wanted_.push_back(i);
  }
  Stats uncounted;
  const Job asking{job.receivers, job.light_samples, {}, uncounted};
  for_batches(asking, wanted_, [&](const Job& batch) {
    see_batch(batch);
    for (size_t i = 0; i < centres_.size; ++i) {
      const auto& v = arrivals_[batch.numbers[i]].values;
      const Rgb fitted = open_irradiance_[batch.numbers[i]] * Rgb(v[0], v[1], v[2]) + unit_ * Rgb(v[3], v[4], v[5]);
      const Rgb asked =
          Rgb(red_[i], green_[i], blue_[i]) + Rgb(reflected_red_[i], reflected_green_[i], reflected_blue_[i]);
      job.stats.checked(CheckedEstimate::fitted).add(double(luminance(fitted) - luminance(asked)), double(unit_));
    }
  });
}

void SkyLight::check_shares(const Job& job, size_t point) {
  const CellKernel kernel = occluders_.kernel_for(context_.settings.isa);
  const ShadingPointBatch& all = job.receivers.points;
  const CellPoints points = cell_points(centres_);
  AlignedVector<int32_t>& undecided = cell_scratch_.undecided;
  undecided.resize(size_t(points.size) + k_batch_padding);
  AlignedVector<float> red(size_t(points.size)), green(size_t(points.size)), blue(size_t(points.size));
  const CellSums sums = {red.data(), green.data(), blue.data()};
  const Vec3 n = centres_.shading_normal(point), g = centres_.geometric_normal(point);
  // Only cells that lie wholly above both horizons.
  const float least = std::sin(std::min(sky_->maps().cell_width(), 0.5f * k_pi));
  RayBatch rays;
  rays.resize(size_t(k_cell_rays));
  std::vector<uint32_t> indices(size_t(k_cell_rays), 0);
  std::iota(indices.begin(), indices.end(), 0u);
  for (size_t k = 0; k < occluders_.cells().size(); ++k) {
    const Vec3 centre = occluders_.direction(k);
    if (glm::dot(centre, n) < least || glm::dot(centre, g) < least) continue;
    float share = 1.0f;
    if (!occluders_.is_clear(k)) {
      OwnObject own;
      CellTask task = occluders_.task(k, own);
      task.reflects = false;
      task.weight[0] = 1.0f;
      std::fill(red.begin(), red.end(), 0.0f);
      const auto end = undecided.begin() + kernel(task, points, sums, undecided.data());
      if (std::find(undecided.begin(), end, int32_t(point)) != end) continue;
      const Vec3 vector(task.vector[0], task.vector[1], task.vector[2]);
      share -= red[point] / scalar::cosine_over_cell<float>(glm::dot(vector, n), task.cosine_half);
    }
    for (int i = 0; i < k_cell_rays; ++i) {
      const float x = (float(i / k_cell_side) + 0.5f) / float(k_cell_side);
      const float y = (float(i % k_cell_side) + 0.5f) / float(k_cell_side);
      const Vec3 d = direction_in(occluders_.cells()[k], x, y);
      const size_t from = start_of_ray(job, point, scalar::sample_2d(uint32_t(i), uint32_t(k), 0).x);
      rays.set(size_t(i), ray_origin(all, from, d), d, sky_->distance());
    }
    AlignedVector<uint8_t> blocked(padded(size_t(k_cell_rays)), 0);
    context_.accel.occluded(rays, indices, blocked.data());
    const auto hidden = std::accumulate(blocked.begin(), blocked.begin() + k_cell_rays, 0);
    job.stats.checked(CheckedEstimate::sky).add(double(share) - (1.0 - double(hidden) / double(k_cell_rays)));
  }
}

// Rays from all points of the cluster, distributed by the cosine.
void SkyLight::check_arrival(const Job& job, size_t point) {
  const IndirectLight* const indirect = sky_->indirect();
  const bool has_sky = open_[point] > 0.0f;
  if (!has_sky && !indirect) return;
  const ShadingPointBatch& all = job.receivers.points;
  const uint32_t seed = scalar::hash_combine(centres_.seed[point], k_sky_stream);
  RayBatch rays;
  HitBatch hits;
  rays.resize(k_arrival_rays);
  std::vector<float> cosines;
  for (uint32_t k = 0; k < k_arrival_rays; ++k) {
    const size_t from = start_of_ray(job, point, scalar::sample_2d(k, seed, 4).x);
    const auto u = scalar::sample_2d(k, seed, 2);
    const auto local = scalar::cosine_hemisphere(u.x, u.y);
    const Vec3 d = frame_about(all.shading_normal(from)).to_world({local.x, local.y, local.z});
    if (!(glm::dot(d, all.geometric_normal(from)) > 0.0f)) continue;
    rays.set(cosines.size(), ray_origin(all, from, d), d, sky_->distance());
    cosines.push_back(std::max(local.z, 1e-6f));
  }
  rays.resize(cosines.size());
  hits.resize(cosines.size());
  context_.accel.intersect(rays, hits, Coherence::incoherent);
  double of_sky = 0.0, of_objects = 0.0;
  for (size_t i = 0; i < cosines.size(); ++i) {
    const Vec3 origin = rays.origin(i), d = rays.direction(i);
    const float share = scalar::weight_of_cosine<float>(cosines[i], grazing_) / cosines[i];
    if (hits.instance[i] == k_none) {
      of_sky += double(share * luminance(sky_->radiance().radiance(d)));
    } else if (indirect) {
      of_objects += double(share * luminance(indirect->radiance(hits.instance[i], origin + d * hits.t[i], origin, d)));
    }
  }
  const double each = double(k_pi) / double(k_arrival_rays), unit = double(has_sky ? open_[point] : unit_);
  const double sky = double(luminance({red_[point], green_[point], blue_[point]}));
  if (has_sky) job.stats.checked(CheckedEstimate::arriving).add(sky - of_sky * each, unit);
  if (!indirect) return;
  const double reflected = double(luminance({reflected_red_[point], reflected_green_[point], reflected_blue_[point]}));
  job.stats.checked(CheckedEstimate::indirect).add(reflected - of_objects * each, unit);
}

}  // namespace fieldtrace
