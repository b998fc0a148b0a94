#include "hybrid/reflected_light.h"

namespace fieldtrace {
namespace {

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
float visible_sum_weighted(const float* weight, const float* pdf, const uint8_t* blocked, int n, int light_samples,
                           float lobe_samples) {
  float sum = 0.0f;
  for (int k = 0; k < n; ++k) {
    if (blocked[k] || !(pdf[k] > 0.0f)) continue;
    const float bsdf_density = lobe_samples * weight[k] * pdf[k] / k_pi;
    sum += weight[k] * power_weight(float(light_samples) * pdf[k], bsdf_density);
  }
  return sum;
}

// The same sum for a light whose radiance differs from sample to sample. `begin`: the first slot.
Rgb visible_radiance(const ShadowBatch& batch, size_t begin, int n, int light_samples, float lobe_samples) {
  Rgb sum(0.0f);
  for (size_t k = begin; k < begin + size_t(n); ++k) {
    if (batch.blocked[k] || !(batch.pdf[k] > 0.0f)) continue;
    const float bsdf_density = lobe_samples * batch.weight[k] * batch.pdf[k] / k_pi;
    sum += Rgb(batch.red[k], batch.green[k], batch.blue[k]) *
           (batch.weight[k] * power_weight(float(light_samples) * batch.pdf[k], bsdf_density));
  }
  return sum;
}

Rgb diffuse_light(const ShadowBatch& batch, size_t begin, int count, const LightEstimate& light, const PathVertex& v) {
  const Rgb albedo = v.material.reflectance / k_pi;
  if (light.varies) return albedo * visible_radiance(batch, begin, count, light.light_samples, v.lobe_samples);
  const float* weight = &batch.weight[begin];
  const uint8_t* blocked = &batch.blocked[begin];
  if (light.closed_form) return albedo * visible_sum(weight, blocked, count);
  return albedo * visible_sum_weighted(weight, &batch.pdf[begin], blocked, count, light.light_samples, v.lobe_samples);
}

}  // namespace

Rgb reflected_light(const ShadowBatch& batch, size_t begin, int count, const LightEstimate& light,
                    const PathVertex& v) {
  const Rgb value = light.value / float(light.light_samples);
  if (v.material.kind == BsdfKind::diffuse) return value * diffuse_light(batch, begin, count, light, v);
  Rgb sum(0.0f);
  for (size_t i = begin; i < begin + size_t(count); ++i) {
    if (batch.blocked[i] || !(batch.weight[i] > 0.0f)) continue;
    const Vec3 wo = v.frame.to_local(glm::normalize(batch.rays.direction(i)));
    if (!(wo.z > 0.0f)) continue;
    const float mis = batch.pdf[i] > 0.0f ? power_weight(float(light.light_samples) * batch.pdf[i],
                                                         v.lobe_samples * bsdf_pdf(v.material, v.wi, wo))
                                          : 1.0f;
    // evaluate_bsdf and weight both hold the cosine.
    const Rgb reflected = evaluate_bsdf(v.material, v.wi, wo) * (batch.weight[i] / wo.z * mis);
    sum += light.varies ? reflected * Rgb(batch.red[i], batch.green[i], batch.blue[i]) : reflected;
  }
  return sum * value;
}

}  // namespace fieldtrace
