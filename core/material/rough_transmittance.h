// Transmittance of a rough dielectric interface, tabulated by the angle of incidence: the light that the diffuse body
// of rough plastic receives and emits.
//
// The transmittance is the fraction of singly scattered light that crosses the interface: the integral over visible
// microfacets m of (1 - F(wi.m)) G1(wo, m), wo refracted at m (Walter et al., "Microfacet Models for Refraction through
// Rough Surfaces", EGSR 2007, equation 21 with visible normals). As in Mitsuba's `roughplastic` it is interpolated
// linearly in the cosine. Thread-safety: pure functions.
#pragma once

#include <algorithm>
#include <cmath>

#include "core/material/microfacet.h"

namespace fieldtrace {

// Isotropic distributions only; relative_ior = inside / outside. Takes about 10 ms.
RoughTransmittance make_rough_transmittance(const Microfacet& microfacet, float relative_ior);

// cosine in [0, 1].
float transmittance_at(const RoughTransmittance& table, float cosine);

// CoatedBody::grazing of an interface, of its transmittance by cosine.
template <class Transmittance>
float grazing_of(const Transmittance& transmittance) {
  // Mean over cosines with weight 2 c: their squares are uniform.
  constexpr int k_nodes = 32;
  float mean = 0.0f;
  for (int i = 0; i < k_nodes; ++i) {
    mean += transmittance(std::sqrt((float(i) + 0.5f) / float(k_nodes))) / float(k_nodes);
  }
  const float normal = transmittance(1.0f);
  // The integral of 2 c (1 - c)^5 is 1/21.
  return normal > 0.0f ? std::max(21.0f * (1.0f - mean / normal), 0.0f) : 0.0f;
}

}  // namespace fieldtrace
