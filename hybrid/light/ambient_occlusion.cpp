#include "hybrid/light/ambient_occlusion.h"

#include <algorithm>
#include <optional>

#include "core/platform/parallel.h"
#include "core/sampling/sobol.hd.h"
#include "hybrid/light/direct_light.h"
#include "hybrid/stats/secondary_timer.h"

namespace fieldtrace {
namespace {

// A sample stream separate from that of the scene's lights, which use the vertex seeds unchanged.
constexpr uint32_t k_occlusion_stream = 0x414f0000u;

}  // namespace

Scene white_sky() {
  Scene scene;
  Emitter emitter;
  emitter.kind = EmitterKind::constant;
  scene.emitters.push_back(emitter);
  return scene;
}

AmbientOcclusion::AmbientOcclusion(const TransportContext& context)
    : context_(context),
      by_maps_(context, context.occlusion_sky),
      sky_(context.settings.occlusion ? make_lights(white_sky()) : LightTable{}) {}

void AmbientOcclusion::clear(size_t most) {
  if (!context_.settings.occlusion) return;
  receivers_.clear(most);
  for (auto* sum : {&receivers_.arriving_red, &receivers_.arriving_green, &receivers_.arriving_blue}) {
    sum->assign(most, 0.0f);
  }
}

void AmbientOcclusion::add(const PathVertex& vertex, uint32_t slot, uint32_t pixel, uint32_t index) {
  // A shading normal that points away from the camera spans the wrong hemisphere.
  const bool turned = glm::dot(vertex.frame.n, vertex.facing) < 0.0f;
  LightReceivers& r = receivers_;
  const size_t i = r.add_point(*vertex.surface, vertex.facing, turned ? -vertex.frame.n : vertex.frame.n);
  r.points.seed[i] = scalar::hash_combine(vertex.seed, k_occlusion_stream);
  r.points.sample[i] = index, r.points.transmits[i] = 0;
  r.reflect(i, Rgb(1.0f));
  r.kind[i] = ReceiverKind::diffuse;
  r.path[i] = slot, r.cluster[i] = pixel;
}

LightExtent AmbientOcclusion::reach() const {
  LightExtent extent;
  extent.kind = LightExtent::Kind::everywhere;
  const float distance = context_.settings.occlusion_distance;
  if (!(distance < k_infinity)) return extent;
  float error = 0.0f;
  Bounds3 bounds;
  for (size_t r = 0; r < shading_points_.size; ++r) {
    bounds.extend(shading_points_.position(r));
    error = std::max(error, shading_points_.error[r]);
  }
  // Rays start up to `error` away from their points, rounded once more (light_kernels.h), and unit directions are off
  // by a few roundings.
  const Vec3 largest = glm::max(glm::abs(bounds.lower), glm::abs(bounds.upper));
  const float slack = error + gamma_bound(16) * (largest.x + largest.y + largest.z + distance + error);
  extent.kind = LightExtent::Kind::bounded;
  extent.ball = {bounds.centre(), 0.5f * glm::length(bounds.diagonal()) + distance + slack};
  extent.bounds = {extent.ball.centre - extent.ball.radius, extent.ball.centre + extent.ball.radius};
  return extent;
}

void AmbientOcclusion::count(size_t begin, std::span<FirstHit> firsts, Stats& stats) const {
  stats.rays_shadow += rays_.active;
  const size_t samples = size_t(context_.settings.light_samples);
  for (size_t r = 0; r < shading_points_.size; ++r) {
    FirstHit& first = firsts[receivers_.path[begin + r]];
    for (size_t i = r * samples; i < (r + 1) * samples; ++i) {
      const bool is_active = rays_.rays.tmax[i] >= 0.0f;
      first.occlusion_rays += float(is_active);
      first.occlusion_clear += float(is_active && !rays_.blocked[i]);
    }
  }
}

void AmbientOcclusion::gather(const Request& r) {
  AmbientOcclusion& o = r.occlusion;
  if (!o.context_.occlusion_sky) return o.gather_by_rays(r.firsts, r.stats);
  SkyLight::gather(o.sky_request(r));
  o.take_irradiance(r);
}

void AmbientOcclusion::gather_waves(std::span<const Request> requests) {
  if (requests.empty()) return;
  const TransportContext& context = requests[0].occlusion.context_;
  const auto for_all = [&](const auto& work) {
    parallel_for_isolated(requests.size(), [&](size_t i) { work(i, requests[i]); });
  };
  // A device does not know what lies within a distance.
  if (!context.occlusion_sky || context.occlusion_sky->distance() < k_infinity)
    return for_all([](size_t, const Request& r) { gather(r); });
  std::vector<std::optional<SkyLight::Request>> made(requests.size());
  for_all([&](size_t i, const Request& r) { made[i].emplace(r.occlusion.sky_request(r)); });
  std::vector<SkyLight::Request> skies;
  for (const auto& sky : made) skies.push_back(*sky);
  SkyLight::gather_waves(skies, *context.answerer.device());
  for_all([](size_t, const Request& r) { r.occlusion.take_irradiance(r); });
}

// Under a white sky a surface of albedo 1 sends on the unoccluded share.
SkyLight::Request AmbientOcclusion::sky_request(const Request& r) {
  clusters_.build(receivers_, {}, k_shadow_batch, context_.settings.pixel_samples == 1);
  before_ = {r.stats.samples, r.stats.samples_spared, r.stats.samples_by_strata};
  return {by_maps_, clusters_, receivers_, {}, context_.settings.light_samples, r.pixels, {}, r.stats};
}

void AmbientOcclusion::take_irradiance(const Request& r) {
  r.stats.samples = before_.all, r.stats.samples_spared = before_.spared, r.stats.samples_by_strata = before_.by_strata;
  const auto rays = float(context_.settings.light_samples);
  for (size_t i = 0; i < receivers_.size(); ++i) {
    FirstHit& first = r.firsts[receivers_.path[i]];
    // Rays below the surface do not count: of a hemisphere about the shading normal, (1 + cos) / 2 lies above both.
    const ShadingPointBatch& p = receivers_.points;
    const float cosine = p.sx[i] * p.gx[i] + p.sy[i] * p.gy[i] + p.sz[i] * p.gz[i];
    first.occlusion_rays += rays * std::min(0.5f * (1.0f + cosine), 1.0f);
    first.occlusion_clear += rays * receivers_.arriving_red[i];
  }
}

void AmbientOcclusion::gather_by_rays(std::span<FirstHit> firsts, Stats& stats) {
  const TransportSettings& settings = context_.settings;
  const size_t group_size = size_t(std::max(k_shadow_batch / settings.light_samples, 1));
  for (size_t begin = 0; begin < receivers_.size(); begin += group_size) {
    shading_points_.resize(std::min(group_size, receivers_.size() - begin));
    shading_points_.copy(0, receivers_.points, begin, shading_points_.size);
    const SecondaryTimer timer(stats);
    candidates_.light = reach();
    candidates_.light_samples.assign(shading_points_.size, 1);
    candidates_.pixel_samples = 1;  // no cone answers for so wide a light
    context_.occlusion_answerer->find_candidates({shading_points_, candidates_, stats});
    sample_light(sky_, 0, shading_points_, settings.light_samples, settings.isa, rays_);
    for (size_t i = 0; i < rays_.rays.size; ++i) {
      if (rays_.rays.tmax[i] >= 0.0f) rays_.rays.tmax[i] = settings.occlusion_distance;
      rays_.source = {};  // not those of a light any more
    }
    context_.occlusion_answerer->answer({candidates_, rays_, stats});
    count(begin, firsts, stats);
  }
}

}  // namespace fieldtrace
