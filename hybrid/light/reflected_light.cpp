#include "hybrid/light/reflected_light.h"

#include <cmath>

#include "core/sampling/power_heuristic.h"

namespace fieldtrace {
namespace {

// How much of what a slot stands for is visible: all or nothing here, a share in SeenShare.
struct SeenOrNot {
  const uint8_t* blocked;
  float of(float weight, size_t k) const { return blocked[k] ? 0.0f : weight; }
};
struct SeenShare {
  const float* clear;
  float of(float weight, size_t k) const { return weight * clear[k]; }
};

// Sum of weight x visibility over the slots of one shading point. Eight running sums let the compiler vectorise; their
// order is fixed, so the result is the same on every machine.
template <class Seen>
float visible_sum(const float* weight, const Seen& seen, int n) {
  float sums[8] = {};
  int k = 0;
  for (; k + 8 <= n; k += 8) {
    for (int j = 0; j < 8; ++j) sums[j] += seen.of(weight[k + j], size_t(k + j));
  }
  for (int j = 0; k < n; ++k, ++j) sums[j] += seen.of(weight[k], size_t(k));
  return ((sums[0] + sums[4]) + (sums[2] + sums[6])) + ((sums[1] + sums[5]) + (sums[3] + sums[7]));
}

// The same sum, weighted against sampling the cosine lobe; weight x pdf is the cosine.
template <class Seen>
float visible_sum_weighted(const float* weight, const float* pdf, const Seen& seen, int n, int light_samples,
                           float lobe_samples) {
  float sum = 0.0f;
  for (int k = 0; k < n; ++k) {
    const float visible = seen.of(weight[k], size_t(k));
    if (!(visible > 0.0f && pdf[k] > 0.0f)) continue;
    const float bsdf_density = lobe_samples * weight[k] * pdf[k] / k_pi;
    sum += visible * power_heuristic(float(light_samples) * pdf[k], bsdf_density);
  }
  return sum;
}

// The same sum for a light whose radiance varies from sample to sample. `begin`: the first slot.
template <class Seen>
Rgb visible_radiance(const ShadowBatch& batch, const Seen& seen, size_t begin, int n, int light_samples,
                     float lobe_samples) {
  Rgb sum(0.0f);
  for (size_t k = 0; k < size_t(n); ++k) {
    const size_t i = begin + k;
    const float visible = seen.of(batch.weight[i], k);
    if (!(visible > 0.0f && batch.pdf[i] > 0.0f)) continue;
    const float bsdf_density = lobe_samples * batch.weight[i] * batch.pdf[i] / k_pi;
    sum += Rgb(batch.red[i], batch.green[i], batch.blue[i]) *
           (visible * power_heuristic(float(light_samples) * batch.pdf[i], bsdf_density));
  }
  return sum;
}

template <class Seen>
Rgb diffuse_light(const ShadowBatch& batch, const Seen& seen, size_t begin, int count, const LightEstimate& light,
                  const Rgb& reflected, float lobe_samples) {
  if (light.varies) return reflected * visible_radiance(batch, seen, begin, count, light.light_samples, lobe_samples);
  const float* weight = &batch.weight[begin];
  if (light.closed_form) return reflected * visible_sum(weight, seen, count);
  return reflected * visible_sum_weighted(weight, &batch.pdf[begin], seen, count, light.light_samples, lobe_samples);
}

template <class Seen>
Rgb visible_light(const ShadowBatch& batch, const Seen& seen, size_t begin, int count, const LightEstimate& light,
                  const PathVertex& v) {
  if (v.material->plain_diffuse()) {
    return diffuse_light(batch, seen, begin, count, light, v.material->reflectance / k_pi, v.lobe_samples);
  }
  const bool spares = light.spares_bodies && v.material->coated_diffuse();
  const Material reflecting = spares ? without_body(*v.material) : *v.material;
  Rgb sum(0.0f);
  for (size_t i = begin; i < begin + size_t(count); ++i) {
    const float visible = seen.of(batch.weight[i], i - begin);
    if (!(visible > 0.0f)) continue;
    const Vec3 wo = v.frame.to_local(glm::normalize(batch.rays.direction(i)));
    const float cosine = v.material->transmits() ? std::abs(wo.z) : wo.z;
    if (!(cosine > 0.0f)) continue;
    const float mis = batch.pdf[i] > 0.0f ? power_heuristic(float(light.light_samples) * batch.pdf[i],
                                                            v.lobe_samples * bsdf_pdf(*v.material, v.wi, wo))
                                          : 1.0f;
    // Both evaluate_bsdf and weight include the cosine.
    const Rgb reflected = evaluate_bsdf(reflecting, v.wi, wo) * (visible / cosine * mis);
    sum += light.varies ? reflected * Rgb(batch.red[i], batch.green[i], batch.blue[i]) : reflected;
  }
  return sum;
}

}  // namespace

Rgb reflected_light(const ShadowBatch& batch, size_t begin, int count, const LightEstimate& light,
                    const PathVertex& v) {
  const Rgb value = light.value / float(count);
  if (batch.in_shares) return value * visible_light(batch, SeenShare{&batch.clear[begin]}, begin, count, light, v);
  return value * visible_light(batch, SeenOrNot{&batch.blocked[begin]}, begin, count, light, v);
}

Rgb reflected_light(const ShadowBatch& batch, size_t begin, int count, const LightEstimate& light,
                    const Rgb& reflected) {
  const Rgb value = light.value / float(count);
  const auto reflect = [&](const auto& seen) {
    return value * diffuse_light(batch, seen, begin, count, light, reflected, 1.0f);
  };
  return batch.in_shares ? reflect(SeenShare{&batch.clear[begin]}) : reflect(SeenOrNot{&batch.blocked[begin]});
}

}  // namespace fieldtrace
