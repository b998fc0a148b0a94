// What --check compares of radiance maps' answers: the mean radiance of the part of a lobe that a glossy ray stands
// for.
#include <algorithm>
#include <cmath>
#include <map>

#include "core/math/frame.h"
#include "core/sampling/sobol.hd.h"
#include "field/query/task_answers.hd.h"
#include "hybrid/glossy/lobe_answerer.h"
#include "hybrid/glossy/radiance_maps.h"
#include "hybrid/stats/check_sizes.h"

namespace fieldtrace {
namespace {

// One ray in so many.
constexpr uint32_t k_check_interval = 1024;
constexpr uint32_t k_check_stream = 0x4c4f4245u;

}  // namespace

void LobeAnswerer::check_filtered(const Request& r) const {
  RayBatch rays;
  HitBatch hits;
  std::map<uint32_t, Rgb> answered;  // by ray: of those that maps were asked about, and that they did not refuse
  for (const uint32_t ray : r.work.queried) answered[ray] = Rgb(0.0f);
  for (const uint32_t ray : r.work.exact) answered.erase(ray);
  for (const FilteredRay& filtered : r.work.filtered) answered[filtered.ray] = filtered.radiance;
  for (const auto& [ray, radiance] : answered) {
    const PathState& path = r.paths[ray];
    const uint32_t seed = scalar::hash_combine(path.pixel_seed, k_check_stream + path.index);
    if (scalar::hash_uint(seed) % k_check_interval != 0) continue;
    const Vec3 origin = r.rays.origin(ray);
    const Frame frame = frame_about(r.rays.direction(ray));
    const float half = std::min(scalar::k_lobe_share / std::sqrt(r.work.density[ray]), scalar::k_widest_lobe);
    rays.resize(size_t(k_check_rays));
    hits.resize(size_t(k_check_rays));
    const auto within = [&](int k) { return (2.0f * (float(k) + 0.5f) / float(k_check_side) - 1.0f) * half; };
    for (int k = 0; k < k_check_rays; ++k) {
      const Vec3 local(within(k % k_check_side), within(k / k_check_side), 1.0f);
      rays.set(size_t(k), origin, glm::normalize(frame.to_world(local)), k_infinity);
    }
    shading_.accel.intersect(rays, hits, Coherence::incoherent);
    double found = 0.0;
    for (size_t k = 0; k < size_t(k_check_rays); ++k) {
      RadianceMaps* const maps = hits.instance[k] == k_none ? nullptr : maps_of(hits.instance[k]);
      if (maps) found += double(luminance(maps->radiance_at(hits, k, rays.direction(k)))) / double(k_check_rays);
    }
    r.stats.checked(CheckedEstimate::lobes).add(double(luminance(radiance)) - found, found);
  }
}

}  // namespace fieldtrace
