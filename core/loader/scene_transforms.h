// Mitsuba's <transform> blocks in double precision.
//
// Source: Mitsuba 3 documentation, "Transformations": operations apply in the order in which they are written, so each
// one multiplies from the left. Thread-safety: pure functions.
#pragma once

#include <string>

#include "core/loader/scene_tree.h"
#include "core/math/math.h"
#include "core/platform/error.h"

namespace fieldtrace {

// The product of a <transform>'s operations. Throws Error for malformed or missing numbers, a rotation about a null
// axis, a degenerate lookat, or a projective matrix. The result is finite but may be singular.
DAffine parse_transform(const SceneNode& transform, const Diagnostics& diagnostics);

DAffine translation(const DVec3& offset);
DAffine scaling(const DVec3& factors);
// By `degrees` about `axis` (any length but 0), counter-clockwise seen from its tip.
DAffine rotation(const DVec3& axis, double degrees);
// Camera frame at `origin` with +z towards `target` and +y as close to `up` as possible. Unchecked: the caller
// guarantees that `up` is not parallel to the viewing direction.
DAffine look_at(const DVec3& origin, const DVec3& target, const DVec3& up);

// Throws Error unless `transform` and its inverse are finite in single precision and its linear part has full rank.
void require_invertible(const DAffine& transform, const SourceLocation& where);

// `transform` without its uniform scale, which is dropped with a warning; it may mirror. `owner` ("the camera") is the
// subject of messages. Throws Error if the transform is singular, non-uniformly scaled or sheared.
DAffine rigid_part(const DAffine& transform, const std::string& owner, const SourceLocation& where,
                   const Diagnostics& diagnostics);

// `transform` with those axes made orthogonal, and as long as each other, that are so but for the digits of a file that
// gives six decimals.
DAffine without_digits_lost(const DAffine& transform);

// Whether the linear part's determinant is negative.
bool is_mirrored(const DAffine& transform);

}  // namespace fieldtrace
