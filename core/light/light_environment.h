// Environment maps: the tables for sampling them, and look-ups of radiance and density.
//
// Conventions follow Mitsuba 3 (plugin `envmap`). In the map's frame +y is up; texel (x, y) of a map of W x H lies at
// azimuth phi = 2 pi (x + 1/2) / W and polar angle theta = pi y / (H - 1), in direction (sin phi sin theta, cos theta,
// -cos phi sin theta). Between texels the radiance is bilinear in phi and theta; columns wrap around, the first and
// last rows are the poles.
//
// Sampling: the density per solid angle is bilinear as well, but in phi and in cos theta within each strip between two
// rows, with the texels' luminance at the corners. A strip's probability is thus luminance times sin(theta),
// integrated; there is no singularity at the poles, and no direction of non-zero radiance has density 0. Method: M.
// Pharr, W. Jakob, G. Humphreys, "Physically Based Rendering", 3rd ed., 13.6.7, with linear instead of constant pieces.
//
// Memory layout: flat float arrays that lane code gathers from by index. Thread-safety: const after make_environment.
#pragma once

#include <vector>

#include "core/light/light.hd.h"
#include "core/math/math.h"
#include "core/scene/scene.h"

namespace fieldtrace {

struct EnvironmentTable {
  std::vector<EnvironmentRow> rows;  // height
  // width + 1 values per row: the integral of its density over the columns before x by the trapezoid rule, with columns
  // of width 1.
  std::vector<float> sums;
  std::vector<float> texels;  // width * height * RGB, divided by a power of two so that the largest is < 1
};

// Size limits: the lower ones are Mitsuba's; the upper one keeps lane code's indices within 31 bits.
inline constexpr int k_least_environment_width = 2, k_least_environment_height = 3;
inline constexpr size_t k_most_environment_texels = size_t(1) << 29;

// Fills `table` and the environment members of `light`. Light::value must be set: it is multiplied by the power of two
// that the texels were divided by, or set to 0 if the map is black everywhere. Negative pixels count as 0. Throws Error
// for maps outside the size limits above. Unchecked: the caller guarantees finite pixels and a rotation.
void make_environment(const Bitmap& map, const Mat3& rotation, EnvironmentTable& table, Light& light);

// The map's radiance along `direction` (world space, any non-zero length), to be multiplied by Light::value.
Rgb environment_radiance(const EnvironmentTable& table, const Light& light, const Vec3& direction);

// The density (1/sr) of sampling `direction`.
float environment_density(const EnvironmentTable& table, const Light& light, const Vec3& direction);

}  // namespace fieldtrace
