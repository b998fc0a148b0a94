#include "hybrid/direct_light.h"

#include <algorithm>

#include "hybrid/stopwatch.h"

namespace fieldtrace {
namespace {

Rgb light_value(const Light& light) { return {light.value[0], light.value[1], light.value[2]}; }

// Sum of weight x visibility over the slots of one receiver. Eight running sums let the compiler use vectors; their
// order is fixed, so the result is the same on every machine.
float visible_sum(const float* weight, const uint8_t* blocked, int n) {
  float sums[8] = {};
  int k = 0;
  for (; k + 8 <= n; k += 8) {
    for (int j = 0; j < 8; ++j) sums[j] += blocked[k + j] ? 0.0f : weight[k + j];
  }
  for (int j = 0; k < n; ++k, ++j) sums[j] += blocked[k] ? 0.0f : weight[k];
  return ((sums[0] + sums[4]) + (sums[2] + sums[6])) + ((sums[1] + sums[5]) + (sums[3] + sums[7]));
}

// The power heuristic for a light sample of density p_light x count against the material's p_bsdf x count.
float power_weight(float light_density, float bsdf_density) {
  // The quotient first: squares of densities of tiny lights overflow.
  const float ratio = bsdf_density / light_density;
  return 1.0f / (1.0f + ratio * ratio);
}

// The same sum with weights against sampling the cosine lobe. weight x pdf is the cosine.
float visible_sum_weighted(const float* weight, const float* pdf, const uint8_t* blocked, int n, float lobe_samples) {
  float sum = 0.0f;
  for (int k = 0; k < n; ++k) {
    if (blocked[k] || !(pdf[k] > 0.0f)) continue;
    const float bsdf_density = lobe_samples * weight[k] * pdf[k] / k_pi;
    sum += weight[k] * power_weight(float(n) * pdf[k], bsdf_density);
  }
  return sum;
}

// How many samples of each receiver are answered first, where whole lights may be answered at once: if they all agree,
// the rest is taken to agree too. The smallest divisor of light_samples from 2 sqrt(light_samples) on: a penumbra then
// gets about an eighth more variance, whatever the number of samples (docs/decisions/009-cones.md). 0: none.
int first_samples(int light_samples) {
  for (int n = 1; 2 * n <= light_samples; ++n) {
    if (n * n >= 4 * light_samples && light_samples % n == 0) return n;
  }
  return 0;
}

// The same sum for a light whose radiance differs from sample to sample. `begin`: the first slot.
Rgb visible_radiance(const ShadowBatch& batch, size_t begin, int n, float lobe_samples) {
  Rgb sum(0.0f);
  for (size_t k = begin; k < begin + size_t(n); ++k) {
    if (batch.blocked[k] || !(batch.pdf[k] > 0.0f)) continue;
    const float bsdf_density = lobe_samples * batch.weight[k] * batch.pdf[k] / k_pi;
    sum += Rgb(batch.red[k], batch.green[k], batch.blue[k]) *
           (batch.weight[k] * power_weight(float(n) * batch.pdf[k], bsdf_density));
  }
  return sum;
}

}  // namespace

void DirectLight::fill_receivers(std::span<const PathVertex> vertices, std::span<const PathState> paths) {
  receivers_.resize(group_.size());
  for (size_t r = 0; r < group_.size(); ++r) {
    const PathVertex& v = vertices[group_[r]];
    const Vec3& p = v.surface.position;
    receivers_.px[r] = p.x, receivers_.py[r] = p.y, receivers_.pz[r] = p.z;
    receivers_.gx[r] = v.facing.x, receivers_.gy[r] = v.facing.y, receivers_.gz[r] = v.facing.z;
    receivers_.sx[r] = v.frame.n.x, receivers_.sy[r] = v.frame.n.y, receivers_.sz[r] = v.frame.n.z;
    receivers_.error[r] = v.surface.error;
    receivers_.seed[r] = v.seed;
    receivers_.sample[r] = paths[v.path].index;
    receivers_.instance[r] = v.surface.instance;
    receivers_.transmits[r] = v.material.transmits();
  }
}

void DirectLight::accumulate(uint32_t light, std::span<const PathVertex> vertices, int light_samples,
                             std::span<Rgb> arriving) {
  const Rgb value = light_value(context_.lights.lights[light]) / float(light_samples);
  const bool varies = context_.lights.lights[light].kind == LightKind::environment;
  for (size_t r = 0; r < group_.size(); ++r) {
    const PathVertex& v = vertices[group_[r]];
    const size_t begin = r * size_t(light_samples);
    const float* weight = &shadows_.weight[begin];
    const float* pdf = &shadows_.pdf[begin];
    const uint8_t* blocked = &shadows_.blocked[begin];
    if (v.material.kind == BsdfKind::diffuse && varies) {
      const Rgb sum = visible_radiance(shadows_, begin, light_samples, v.lobe_samples);
      arriving[group_[r]] += v.material.reflectance * value * (sum / k_pi);
      continue;
    }
    if (v.material.kind == BsdfKind::diffuse) {
      const float sum = context_.closed_form[light]
                            ? visible_sum(weight, blocked, light_samples)
                            : visible_sum_weighted(weight, pdf, blocked, light_samples, v.lobe_samples);
      arriving[group_[r]] += v.material.reflectance * value * (sum / k_pi);
      continue;
    }
    Rgb sum(0.0f);
    for (int k = 0; k < light_samples; ++k) {
      if (blocked[k] || !(weight[k] > 0.0f)) continue;
      const Vec3 wo = v.frame.to_local(glm::normalize(shadows_.rays.direction(begin + k)));
      if (!(wo.z > 0.0f)) continue;
      const float mis =
          pdf[k] > 0.0f ? power_weight(float(light_samples) * pdf[k], v.lobe_samples * bsdf_pdf(v.material, v.wi, wo))
                        : 1.0f;
      // evaluate_bsdf and weight both hold the cosine.
      const Rgb reflected = evaluate_bsdf(v.material, v.wi, wo) * (weight[k] / wo.z * mis);
      const size_t slot = begin + size_t(k);
      sum += varies ? reflected * Rgb(shadows_.red[slot], shadows_.green[slot], shadows_.blue[slot]) : reflected;
    }
    arriving[group_[r]] += sum * value;
  }
}

void DirectLight::count(std::span<const PathVertex> vertices, std::span<const PathState> paths, int light_samples,
                        std::span<FirstHit> firsts, Stats& stats) {
  stats.rays_shadow += shadows_.active;
  if (firsts.empty()) return;
  for (size_t r = 0; r < group_.size(); ++r) {
    FirstHit& first = firsts[paths[vertices[group_[r]].path].slot];
    for (size_t i = r * size_t(light_samples); i < (r + 1) * size_t(light_samples); ++i) {
      const bool is_active = shadows_.rays.tmax[i] >= 0.0f;
      first.shadow_rays += is_active;
      first.shadow_clear += is_active && !shadows_.blocked[i];
      first.shadow_exact += is_active && shadows_.exact[i];
    }
  }
}

void DirectLight::check_split(uint32_t light, std::span<const PathVertex> vertices, std::span<const PathState> paths,
                              int light_samples, Stats& stats) {
  for (const bool blocked : {false, true}) {
    group_ = blocked ? dark_ : free_;
    if (group_.empty()) continue;
    sample(light, vertices, paths, light_samples);
    context_.answerer.check_whole(candidates_, blocked, shadows_, stats);
  }
}

void DirectLight::split_receivers(std::span<const PathVertex> vertices, const LightExtent& light, int light_samples,
                                  size_t begin, size_t end, Stats& stats) {
  shadowed_.clear();
  free_.clear();
  dark_.clear();
  candidates_.light = light;
  candidates_.light_samples = light_samples;
  places_.resize(end - begin);
  for (size_t r = 0; r < places_.size; ++r) {
    const SurfacePoint& s = vertices[lit_[begin + r]].surface;
    places_.px[r] = s.position.x, places_.py[r] = s.position.y, places_.pz[r] = s.position.z;
    const Vec3& facing = vertices[lit_[begin + r]].facing;
    places_.gx[r] = facing.x, places_.gy[r] = facing.y, places_.gz[r] = facing.z;
    places_.error[r] = s.error;
    places_.instance[r] = s.instance;
  }
  context_.answerer.find_candidates(places_, candidates_, stats);
  for (size_t r = 0; r < places_.size; ++r) {
    const int32_t shadow = candidates_.shadow[r];
    (shadow & k_light_blocked ? dark_ : shadow ? shadowed_ : free_).push_back(lit_[begin + r]);
  }
}

void DirectLight::sample(uint32_t light, std::span<const PathVertex> vertices, std::span<const PathState> paths,
                         int light_samples) {
  fill_receivers(vertices, paths);
  sample_light(context_.lights, light, receivers_, light_samples, context_.settings.isa, shadows_);
}

void DirectLight::sort_by_first_samples(uint32_t light, std::span<const PathVertex> vertices,
                                        std::span<const PathState> paths, int light_samples, int first_samples,
                                        Stats& stats) {
  group_.swap(shadowed_);
  shadowed_.clear();
  fill_receivers(vertices, paths);
  // The first samples of each receiver's own.
  for (size_t r = 0; r < group_.size(); ++r) receivers_.sample[r] *= uint32_t(light_samples / first_samples);
  sample_light(context_.lights, light, receivers_, first_samples, context_.settings.isa, shadows_);
  context_.answerer.answer(candidates_, shadows_, stats);
  for (size_t r = 0; r < group_.size(); ++r) {
    const size_t begin = r * size_t(first_samples), end = begin + size_t(first_samples);
    int active = 0, blocked = 0;
    for (size_t i = begin; i < end; ++i) {
      active += shadows_.rays.tmax[i] >= 0.0f;
      blocked += shadows_.blocked[i];
    }
    const bool mixed = active == 0 || (blocked != 0 && blocked != active);
    (mixed ? shadowed_ : blocked ? dark_ : free_).push_back(group_[r]);
    stats.samples_spared += mixed ? 0 : uint64_t(light_samples - first_samples);
  }
}

void DirectLight::gather_free(uint32_t light, std::span<const PathVertex> vertices, std::span<const PathState> paths,
                              int light_samples, std::span<FirstHit> firsts, std::span<Rgb> arriving, Stats& stats) {
  group_.swap(free_);
  if (group_.empty()) return;
  sample(light, vertices, paths, light_samples);
  accumulate(light, vertices, light_samples, arriving);
  count(vertices, paths, light_samples, firsts, stats);
}

void DirectLight::gather_from(uint32_t light, size_t begin, size_t end, std::span<const PathVertex> vertices,
                              std::span<const PathState> paths, int light_samples, std::span<FirstHit> firsts,
                              std::span<Rgb> arriving, Stats& stats) {
  const ShadowAnswerer& answerer = context_.answerer;
  const double bake_before = stats.time_bake;
  {
    const ScopedTimer timer(stats.time_secondary);
    split_receivers(vertices, context_.light_extents[light], light_samples, begin, end, stats);
  }
  if (answerer.checks()) check_split(light, vertices, paths, light_samples, stats);
  {
    const ScopedTimer timer(stats.time_secondary);
    const int first = answerer.answers_cones() ? first_samples(light_samples) : 0;
    if (first > 0 && !shadowed_.empty()) {
      sort_by_first_samples(light, vertices, paths, light_samples, first, stats);
    }
  }
  for (const uint32_t i : dark_) {
    if (!firsts.empty()) firsts[paths[vertices[i].path].slot].shadow_rays += uint32_t(light_samples);
  }
  gather_free(light, vertices, paths, light_samples, firsts, arriving, stats);
  group_.swap(shadowed_);
  if (!group_.empty()) {
    {
      const ScopedTimer timer(stats.time_secondary);
      sample(light, vertices, paths, light_samples);
      answerer.answer(candidates_, shadows_, stats);
    }
    accumulate(light, vertices, light_samples, arriving);
    count(vertices, paths, light_samples, firsts, stats);
  }
  stats.time_secondary -= stats.time_bake - bake_before;
}

void DirectLight::gather(std::span<const PathVertex> vertices, std::span<const PathState> paths, int light_samples,
                         std::span<FirstHit> firsts, std::span<Rgb> arriving, Stats& stats) {
  lit_.clear();
  for (uint32_t i = 0; i < vertices.size(); ++i) {
    arriving[i] = Rgb(0.0f);
    if (!vertices[i].material.delta()) lit_.push_back(i);
  }
  const size_t group_size = size_t(std::max(k_shadow_batch / light_samples, 1));
  for (size_t begin = 0; begin < lit_.size(); begin += group_size) {
    const size_t end = std::min(begin + group_size, lit_.size());
    for (uint32_t light = 0; light < context_.lights.size(); ++light) {
      if (context_.lights.lights[light].kind == LightKind::none) continue;
      gather_from(light, begin, end, vertices, paths, light_samples, firsts, arriving, stats);
    }
  }
}

}  // namespace fieldtrace
