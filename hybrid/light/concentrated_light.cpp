#include "hybrid/light/concentrated_light.h"

#include <algorithm>

#include "core/material/bsdf.h"
#include "hybrid/light/group_light.h"
#include "hybrid/sky/cell_occluders.h"

namespace fieldtrace {
namespace {

Sphere ball_about_clusters(const ShadingPointBatch& centres) {
  Sphere ball = ball_about(centres);
  ball.radius += *std::max_element(centres.radius.begin(), centres.radius.begin() + ptrdiff_t(centres.size));
  return ball;
}

}  // namespace

void ConcentratedLight::trace(Stats& stats) {
  active_.clear();
  for (uint32_t i = 0; i < shadows_.rays.size; ++i) {
    if (shadows_.rays.tmax[i] >= 0.0f) active_.push_back(i);
  }
  context_.accel.occluded(shadows_.rays, active_, shadows_.blocked.data());
  for (const uint32_t i : active_) shadows_.exact[i] = 1;
  stats.rays_exact += active_.size();
  stats.rays_crossing += active_.size();
}

void ConcentratedLight::gather_some(const Job& job, std::span<const ShadingCluster> clusters, bool may_be_hidden) {
  const LightTable& table = *sky_->radiance().concentrated();
  const Light& light = table.lights[0];
  const int most_samples = std::max(job.light_samples, context_.settings.open_sun_samples);
  const int samples = may_be_hidden ? most_samples : job.light_samples;
  const Rgb value = Rgb(light.value[0], light.value[1], light.value[2]) / float(samples);
  // So that all shading points count alike.
  const float count = sky_->radiance().concentrated_share() * float(job.light_samples) / float(samples);
  const size_t m = size_t(samples), most = std::max(size_t(k_shadow_batch) / m, size_t(1));
  LightReceivers& r = job.receivers;
  for (size_t begin = 0, end = 0; begin < clusters.size(); begin = end) {
    size_t points = 0;
    for (end = begin; end < clusters.size() && points < most; ++end) points += clusters[end].size();
    selected_.resize(points);
    points = 0;
    for (size_t i = begin; i < end; ++i) {
      const ShadingCluster& c = clusters[i];
      selected_.copy(points, r.points, c.begin, c.size());
      points += c.size();
    }
    sample_light(table, 0, selected_, samples, context_.settings.isa, shadows_);
    job.stats.samples += points * m;
    job.stats.rays_shadow += shadows_.active;
    if (may_be_hidden) trace(job.stats);
    size_t slot = 0;
    for (size_t i = begin; i < end; ++i) {
      const ShadingCluster& c = clusters[i];
      for (size_t k = c.begin; k < c.end; ++k) {
        // What is diffuse may have no vertex.
        const Material* const coated =
            r.kind[k] == ReceiverKind::diffuse ? nullptr : job.vertices[r.vertex[k]].material;
        Rgb sum(0.0f);
        for (const size_t last = slot + m; slot < last; ++slot) {
          if (shadows_.rays.tmax[slot] < 0.0f) continue;
          const bool is_clear = !shadows_.blocked[slot];
          if (is_clear) {
            const Vec3 n = r.points.shading_normal(k);
            const float cosine = glm::dot(n, glm::normalize(shadows_.rays.direction(slot)));
            const float passed = coated ? relative_transmittance(*coated, std::clamp(cosine, 0.0f, 1.0f)) : 1.0f;
            sum +=
                Rgb(shadows_.red[slot], shadows_.green[slot], shadows_.blue[slot]) * (shadows_.weight[slot] * passed);
          }
          if (job.firsts.empty()) continue;
          FirstHit& first = job.firsts[r.path[k]];
          first.shadow_rays += count;
          first.shadow_clear += is_clear ? count : 0.0f;
          first.shadow_exact += shadows_.exact[slot] ? count : 0.0f;
        }
        sum *= value;
        r.arriving_red[k] += sum.x * r.red[k];
        r.arriving_green[k] += sum.y * r.green[k];
        r.arriving_blue[k] += sum.z * r.blue[k];
      }
    }
  }
}

bool ConcentratedLight::may_hide(const SkyOccluder& o, const Sphere& from) const {
  const SkyRadiance& sky = sky_->radiance();
  return meets_cone(o.ball, from, sky.concentrated_axis(), sky.concentrated_angle());
}

void ConcentratedLight::begin(const ShadingPointBatch& points) {
  const Sphere ball = ball_about_clusters(points);
  near_.clear();
  for (const SkyOccluder& o : sky_->maps().occluders()) {
    if (may_hide(o, ball)) near_.push_back(&o);
  }
}

void ConcentratedLight::gather(std::span<const ShadingCluster> clusters, const ShadingPointBatch& centres,
                               std::span<const PathVertex> vertices, int light_samples, LightReceivers& receivers,
                               std::span<FirstHit> firsts, Stats& stats) {
  const Sphere ball = ball_about_clusters(centres);
  hiding_.clear();
  for (const SkyOccluder* o : near_) {
    if (o->instance == centres.instance[0] && o->is_flat) continue;
    if (may_hide(*o, ball)) hiding_.push_back(o);
  }
  open_.clear(), hidden_.clear();
  for (size_t i = 0; i < clusters.size(); ++i) {
    const Sphere from = {centres.position(i), centres.radius[i]};
    const bool may_be_hidden =
        std::any_of(hiding_.begin(), hiding_.end(), [&](const SkyOccluder* o) { return may_hide(*o, from); });
    (may_be_hidden ? hidden_ : open_).push_back(clusters[i]);
  }
  const Job job{vertices, light_samples, receivers, firsts, stats};
  gather_some(job, open_, false);
  gather_some(job, hidden_, true);
}

}  // namespace fieldtrace
