#include "hybrid/light/reflected_light.h"

#include <cmath>

#include "core/sampling/power_heuristic.h"

namespace fieldtrace {
namespace {

// What is visible of a slot's weight.
float visible_part(float weight, float clear) { return clear > 0.0f ? weight * clear : 0.0f; }

// Sum of weight x visibility over the slots of one shading point. Eight running sums let the compiler vectorise; their
// order is fixed, so the result is the same on every machine.
float visible_sum(const float* weight, const float* clear, int n) {
  float sums[8] = {};
  int k = 0;
  for (; k + 8 <= n; k += 8) {
    for (int j = 0; j < 8; ++j) sums[j] += visible_part(weight[k + j], clear[k + j]);
  }
  for (int j = 0; k < n; ++k, ++j) sums[j] += visible_part(weight[k], clear[k]);
  return ((sums[0] + sums[4]) + (sums[2] + sums[6])) + ((sums[1] + sums[5]) + (sums[3] + sums[7]));
}

// The same sum, weighted against sampling the cosine lobe; weight x pdf is the cosine.
float visible_sum_weighted(const float* weight, const float* pdf, const float* clear, int n, int light_samples,
                           float lobe_samples) {
  float sum = 0.0f;
  for (int k = 0; k < n; ++k) {
    const float visible = visible_part(weight[k], clear[k]);
    if (!(visible > 0.0f && pdf[k] > 0.0f)) continue;
    const float bsdf_density = lobe_samples * weight[k] * pdf[k] / k_pi;
    sum += visible * power_heuristic(float(light_samples) * pdf[k], bsdf_density);
  }
  return sum;
}

// The same sum for a light whose radiance varies from sample to sample. `begin`: the first slot.
Rgb visible_radiance(const ShadowBatch& batch, size_t begin, int n, int light_samples, float lobe_samples) {
  Rgb sum(0.0f);
  for (size_t i = begin; i < begin + size_t(n); ++i) {
    const float visible = visible_part(batch.weight[i], batch.clear[i]);
    if (!(visible > 0.0f && batch.pdf[i] > 0.0f)) continue;
    const float bsdf_density = lobe_samples * batch.weight[i] * batch.pdf[i] / k_pi;
    sum += Rgb(batch.red[i], batch.green[i], batch.blue[i]) *
           (visible * power_heuristic(float(light_samples) * batch.pdf[i], bsdf_density));
  }
  return sum;
}

Rgb diffuse_light(const ShadowBatch& batch, size_t begin, int count, const LightEstimate& light, const Rgb& reflected,
                  float lobe_samples) {
  if (light.varies) return reflected * visible_radiance(batch, begin, count, light.light_samples, lobe_samples);
  const float *weight = &batch.weight[begin], *clear = &batch.clear[begin];
  if (light.closed_form) return reflected * visible_sum(weight, clear, count);
  return reflected * visible_sum_weighted(weight, &batch.pdf[begin], clear, count, light.light_samples, lobe_samples);
}

Rgb visible_light(const ShadowBatch& batch, size_t begin, int count, const LightEstimate& light, const PathVertex& v) {
  if (v.material->plain_diffuse()) {
    return diffuse_light(batch, begin, count, light, v.material->reflectance / k_pi, v.lobe_samples);
  }
  const bool spares = light.spares_bodies && v.material->coated_diffuse();
  const Material reflecting = spares ? without_body(*v.material) : *v.material;
  Rgb sum(0.0f);
  for (size_t i = begin; i < begin + size_t(count); ++i) {
    const float visible = visible_part(batch.weight[i], batch.clear[i]);
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
  return light.value / float(count) * visible_light(batch, begin, count, light, v);
}

Rgb reflected_light(const ShadowBatch& batch, size_t begin, int count, const LightEstimate& light,
                    const Rgb& reflected) {
  return light.value / float(count) * diffuse_light(batch, begin, count, light, reflected, 1.0f);
}

}  // namespace fieldtrace
