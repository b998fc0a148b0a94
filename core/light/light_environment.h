// Environment maps: the tables behind their sampling, and what the map holds in one direction.
//
// Conventions are those of Mitsuba 3 (plugin `envmap`). In the map's frame +y is up; texel (x, y) of a map of W x H
// lies at azimuth phi = 2 pi (x + 1/2) / W and polar angle theta = pi y / (H - 1), where the direction is (sin phi sin
// theta, cos theta, -cos phi sin theta). Between texels the radiance is bilinear in phi and theta; columns wrap around,
// the first and the last row are the poles. Sampling: the density per solid angle is bilinear too, in phi and in cos
// theta within each strip between two rows, with the texels' luminance at the corners. So a strip's share is luminance
// x sin(theta) integrated, there is no singularity at the poles, and no direction that shines has density 0. Source of
// the method: M. Pharr, W. Jakob, G. Humphreys, "Physically Based Rendering", 3rd ed., 13.6.7, with linear instead of
// constant pieces. Memory layout: flat float arrays that lane code gathers from by index. Thread-safety: const after
// make_environment.
#pragma once

#include <vector>

#include "core/light/light.hd.h"
#include "core/math/math.h"
#include "core/scene/scene.h"

namespace fieldtrace {

struct EnvironmentTable {
  std::vector<EnvironmentRow> rows;  // height
  // Of each row, width + 1 values: the integral of its density over the columns before x, each column counting 1, by
  // the trapezoid rule.
  std::vector<float> sums;
  std::vector<float> texels;  // width * height times red, green, blue, divided by a power of two: the largest is < 1
};

// The smallest and largest maps: Mitsuba's lower bound, and indices of lane code are 31 bits wide.
inline constexpr int k_least_environment_width = 2, k_least_environment_height = 3;
inline constexpr size_t k_most_environment_texels = size_t(1) << 29;

// Fills `table` and the members of `light` that an environment has, but for Light::value, which is multiplied by what
// the texels were divided by. A map that is black everywhere makes it 0. Negative values count as 0. Throws Error for
// maps of another size than the bounds above allow. Unchecked: the caller guarantees finite pixels and a rotation.
void make_environment(const Bitmap& map, const Mat3& rotation, EnvironmentTable& table, Light& light);

// The map's radiance along `direction` (world space, any length but 0), to multiply Light::value.
Rgb environment_radiance(const EnvironmentTable& table, const Light& light, const Vec3& direction);

// The density (1/sr) with which `direction` is sampled.
float environment_density(const EnvironmentTable& table, const Light& light, const Vec3& direction);

}  // namespace fieldtrace
