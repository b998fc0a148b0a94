// The irradiance of whole lights in closed form: what diffuse surfaces need to know of a light that nothing hides.
//
// Thread-safety: pure functions.
#pragma once

#include <optional>

#include "core/light/light.hd.h"
#include "core/math/math.h"

namespace fieldtrace {

// Irradiance (sr, times the cosine) at a surface of unit normal `shading` from a light of radiance 1 that nothing
// hides. Spheres seen from outside and rectangles (Lambert, "Photometria", 1760; Baum et al.,
// "Improving Radiosity Solutions Through the Use of Analytically Determined Form-Factors", SIGGRAPH 1989). Nothing for
// other kinds, and where a light is not wholly above both the surface's and the shading normal's horizon.
// `geometric` and `shading` lie on the side that looks at the light. Relative error below 1e-5.
std::optional<float> whole_irradiance(const Light& light, const Vec3& point, const Vec3& geometric,
                                      const Vec3& shading);

}  // namespace fieldtrace
