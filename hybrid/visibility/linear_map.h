// What an instance's linear map does to lengths, areas and angles. Pure functions.
#pragma once

#include <optional>

#include "core/math/math.h"

namespace fieldtrace {

// Relative error of lengths that is allowed for: far above that of matrices given to six digits, far below what shows.
inline constexpr double k_stretch_slack = 0x1p-10;

// The linear part of a 3 x 4 matrix, column-major; of the array, the first 9 values are read.
DMat3 linear_part(const float* m);
inline DMat3 linear_part(const Affine& m) { return {DVec3(m[0]), DVec3(m[1]), DVec3(m[2])}; }

// Bound on how much `a` lengthens a vector: largest_stretch() plus the slack.
float stretch_bound(const DMat3& a);

// Bound on how much `a` enlarges an area, plus the slack.
float area_bound(const DMat3& a);

// Whether `a` is a similarity (rotation, reflection, even scaling), up to the slack.
bool keeps_angles(const DMat3& a);

// The symmetric S of determinant 1 in a = c R S, c a number and R a rotation that may mirror: how `a` deforms, up to
// turns and even scaling (polar decomposition by Newton's iteration: Higham, "Computing the polar decomposition - with
// applications", SIAM J. Sci. Stat. Comput. 7(4), 1986). Nothing if `a` is singular or nearly so.
std::optional<DMat3> stretch_of(const DMat3& a);

// How much wider `a` makes a narrow cone about a direction: the square root of the ratio of the solid angles.
double angle_stretch(const DMat3& a, const DVec3& direction);

}  // namespace fieldtrace
