// The light that reaches a path from one surface's shadow rays: weights, visibility and material put together.
//
// Multiple importance sampling against the material's lobe by the power heuristic with sample counts (Veach and Guibas,
// SIGGRAPH 1995). Thread-safety: pure functions.
#pragma once

#include "core/light/shading_points.h"
#include "hybrid/path/path_batch.h"

namespace fieldtrace {

// What the samples of one light have in common.
struct LightEstimate {
  Rgb value = Rgb(0.0f);     // Light::value
  int light_samples = 1;     // of each shading point in all, whether in one batch or in several
  int mean_of = 0;           // the samples that the mean is taken over, if not light_samples
  bool closed_form = false;  // sampled_in_closed_form: diffuse surfaces leave the light to its samples
  bool varies = false;       // each sample has its own radiance (ShadowBatch::red, green, blue)
};

// Radiance that slots [begin, begin + count) of an answered batch send towards the path by way of its vertex, path
// throughput not included: this batch's part of the mean over light_samples.
Rgb reflected_light(const ShadowBatch& batch, size_t begin, int count, const LightEstimate& light,
                    const PathVertex& vertex);

}  // namespace fieldtrace
