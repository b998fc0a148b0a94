#include "hybrid/direct_light.h"

#include <algorithm>

#include "hybrid/halves.h"
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
  for (size_t r = 0; r < group_.size(); ++r) {
    const PathVertex& v = vertices[group_[r]];
    const size_t begin = r * size_t(light_samples);
    const float* weight = &shadows_.weight[begin];
    const float* pdf = &shadows_.pdf[begin];
    const uint8_t* blocked = &shadows_.blocked[begin];
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
      sum += evaluate_bsdf(v.material, v.wi, wo) * (weight[k] / wo.z * mis);
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

void DirectLight::split_receivers(std::span<const PathVertex> vertices, const LightExtent& light, size_t begin,
                                  size_t end) {
  candidates_.light = light;
  places_.resize(end - begin);
  for (size_t r = 0; r < places_.size; ++r) {
    const SurfacePoint& s = vertices[lit_[begin + r]].surface;
    places_.px[r] = s.position.x, places_.py[r] = s.position.y, places_.pz[r] = s.position.z;
    places_.error[r] = s.error;
    places_.instance[r] = s.instance;
  }
  context_.answerer.find_candidates(places_, candidates_);
  for (size_t r = 0; r < places_.size; ++r) {
    (candidates_.may_shadow[r] ? shadowed_ : free_).push_back(lit_[begin + r]);
  }
}

bool DirectLight::halve(std::span<const PathVertex> vertices, const Part& part, int light_samples) {
  const size_t smallest = size_t(std::max(k_smallest_part_rays / light_samples, 1));
  if (light_samples < k_fewest_halving_samples || part.end - part.begin <= smallest) return false;
  if (!context_.answerer.gains_by_halving(candidates_)) return false;
  if (!in_halves_) {
    // The first time: the part is the whole batch.
    placed_.clear();
    for (size_t i = part.begin; i < part.end; ++i) placed_.push_back({vertices[lit_[i]].surface.position, lit_[i]});
    order_by_halves(placed_, smallest);
    for (size_t i = part.begin; i < part.end; ++i) lit_[i] = placed_[i - part.begin].index;
    in_halves_ = true;
  }
  const size_t middle = middle_of(part.begin, part.end);
  parts_.push_back({middle, part.end});
  parts_.push_back({part.begin, middle});
  return true;
}

void DirectLight::gather_part(const Part& part, uint32_t light, std::span<const PathVertex> vertices,
                              std::span<const PathState> paths, int light_samples, std::span<FirstHit> firsts,
                              std::span<Rgb> arriving, Stats& stats) {
  shadowed_.clear();
  free_.clear();
  {
    const ScopedTimer timer(stats.time_secondary);
    split_receivers(vertices, context_.light_extents[light], part.begin, part.end);
    if (halve(vertices, part, light_samples)) return;
  }
  // Receivers that nothing can shadow send no shadow rays: their light samples are part of shading.
  group_.swap(free_);
  if (!group_.empty()) {
    fill_receivers(vertices, paths);
    sample_light(context_.lights, light, receivers_, light_samples, context_.settings.isa, shadows_);
    accumulate(light, vertices, light_samples, arriving);
    count(vertices, paths, light_samples, firsts, stats);
  }
  group_.swap(shadowed_);
  if (group_.empty()) return;
  fill_receivers(vertices, paths);
  const double bake_before = stats.time_bake;
  {
    const ScopedTimer timer(stats.time_secondary);
    sample_light(context_.lights, light, receivers_, light_samples, context_.settings.isa, shadows_);
    context_.answerer.answer(candidates_, shadows_, stats);
  }
  stats.time_secondary -= stats.time_bake - bake_before;
  accumulate(light, vertices, light_samples, arriving);
  count(vertices, paths, light_samples, firsts, stats);
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
    in_halves_ = false;
    for (uint32_t light = 0; light < context_.lights.size(); ++light) {
      if (context_.lights.lights[light].kind == LightKind::none) continue;
      parts_.assign(1, {begin, end});
      while (!parts_.empty()) {
        const Part part = parts_.back();
        parts_.pop_back();
        gather_part(part, light, vertices, paths, light_samples, firsts, arriving, stats);
      }
    }
  }
}

}  // namespace fieldtrace
