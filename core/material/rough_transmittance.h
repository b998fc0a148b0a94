// Transmittance of a rough dielectric interface, tabulated by the angle of incidence: the light that the diffuse body
// of rough plastic receives and emits.
//
// The transmittance is the fraction of singly scattered light that crosses the interface: the integral over visible
// microfacets m of (1 - F(wi.m)) G1(wo, m), wo refracted at m (Walter et al., "Microfacet Models for Refraction through
// Rough Surfaces", EGSR 2007, equation 21 with visible normals). As in Mitsuba's `roughplastic` it is interpolated
// linearly in the cosine. Thread-safety: pure functions.
#pragma once

#include "core/material/microfacet.h"

namespace fieldtrace {

// Isotropic distributions only; relative_ior = inside / outside. Takes about 10 ms.
RoughTransmittance make_rough_transmittance(const Microfacet& microfacet, float relative_ior);

// cosine in [0, 1].
float transmittance_at(const RoughTransmittance& table, float cosine);

}  // namespace fieldtrace
