// Closed-form irradiance of whole, unoccluded lights, for diffuse surfaces.
//
// Thread-safety: pure functions.
#pragma once

#include <optional>

#include "core/light/light.hd.h"
#include "core/math/math.h"

namespace fieldtrace {

// Irradiance (integral of the cosine over solid angle, sr) at a surface with unit normal `shading` from an unoccluded
// light of radiance 1. For spheres seen from outside and for rectangles (Lambert, "Photometria", 1760; Baum et al.,
// "Improving Radiosity Solutions Through the Use of Analytically Determined Form-Factors", SIGGRAPH 1989). Empty for
// other kinds, and where the light is not wholly above the horizons of both normals. `geometric` and `shading` point to
// the side facing the light. Relative error below 1e-5.
std::optional<float> whole_irradiance(const Light& light, const Vec3& point, const Vec3& geometric,
                                      const Vec3& shading);

}  // namespace fieldtrace
