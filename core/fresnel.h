// Fresnel reflectance of unpolarised light at smooth interfaces.
//
// Source: Born and Wolf, "Principles of Optics", 7th ed., sections 1.5.2 and 14.2.
// Thread-safety: pure functions.
#pragma once

#include "core/math.h"

namespace fieldtrace {

struct DielectricFresnel {
  float reflectance = 1.0f;      // [0, 1]; 1 under total internal reflection
  float cos_transmitted = 0.0f;  // signed: opposite to the sign of cos_incident; 0 under total reflection
  float eta_incident_over_transmitted = 1.0f;
};

// cos_incident in [-1, 1], positive on the outside; eta = interior index / exterior index, > 0.
DielectricFresnel fresnel_dielectric(float cos_incident, float eta);

// cos_incident in [0, 1]; eta + i k = the conductor's complex index relative to the outside, per channel, k >= 0.
Rgb fresnel_conductor(float cos_incident, const Rgb& eta, const Rgb& k);

}  // namespace fieldtrace
