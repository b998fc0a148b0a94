// The light that one surface reflects towards its path: combines an answered batch's sample weights, visibility and the
// material.
//
// Multiple importance sampling against the material's lobe by the power heuristic with sample counts (Veach and Guibas,
// SIGGRAPH 1995). Thread-safety: pure functions.
#pragma once

#include "core/light/shading_points.h"
#include "hybrid/path/path_batch.h"

namespace fieldtrace {

// What all samples of one light share.
struct LightEstimate {
  Rgb value = Rgb(0.0f);       // Light::value
  int light_samples = 1;       // of each shading point, as multiple importance sampling counts them
  bool closed_form = false;    // sampled_in_closed_form(): on diffuse surfaces light samples alone count
  bool varies = false;         // each sample has its own radiance (ShadowBatch::red, green, blue)
  bool spares_bodies = false;  // what the diffuse bodies of plastics reflect is known already
};

// Radiance that slots [begin, begin + count) of an answered batch, all samples of a shading point, send towards the
// path through its vertex, without path throughput.
Rgb reflected_light(const ShadowBatch& batch, size_t begin, int count, const LightEstimate& light,
                    const PathVertex& vertex);
// The same through a plainly diffuse point that reflects `reflected` (albedo / pi) and sends one path on at most.
Rgb reflected_light(const ShadowBatch& batch, size_t begin, int count, const LightEstimate& light,
                    const Rgb& reflected);

}  // namespace fieldtrace
