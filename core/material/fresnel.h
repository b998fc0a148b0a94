// Fresnel reflectance of unpolarised light at smooth interfaces.
//
// Source: Born and Wolf, "Principles of Optics", 7th ed., sections 1.5.2 and 14.2. Diffuse light: fits by
// Egan, Hilgeman and Reichman, "Determination of Absorption and Scattering Coefficients for Nonhomogeneous Media. 2",
// Applied Optics 12(8), 1973 (index below 1), and by d'Eon and Irving, "A Quantized-Diffusion Model for Rendering
// Translucent Materials", SIGGRAPH 2011 (above).
// Thread-safety: pure functions.
#pragma once

#include "core/math/math.h"

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

// Mean reflectance of diffuse light at a smooth interface: the integral of 2 F(c) c over cosines c in [0, 1]. eta =
// index of the far side / index of the near side; accurate to 0.01 up to 2.5, and to 0.03 up to 10.
float fresnel_diffuse_reflectance(float eta);

}  // namespace fieldtrace
