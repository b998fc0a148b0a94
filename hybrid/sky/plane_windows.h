// Which parts of a parallelogram know the light that they send on by pyramids of their own. Thread-safety: pure
// functions.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "hybrid/sky/sky_maps.h"
#include "hybrid/sky/surfels.h"

namespace fieldtrace {

// World positions, in the order (-1, -1), (1, -1), (-1, 1), (1, 1) of its coordinates.
using PlaneCorners = std::array<Vec3, 4>;
PlaneCorners plane_corners(const SkyOccluder& plane);

// The whole of a plane, of texels x texels, and at most one window: where others stand on it or reach through it along
// its axes, the part between them over which most of `seen` lies, so that no texel mixes the light of two rooms. Where
// that is a large part of the plane, or there is none, the part of it about objects and smaller planes. seen: points in
// the room that the camera sees, world space.
std::vector<PlaneWindow> plane_windows(std::span<const SkyOccluder> all, const SkyOccluder& plane,
                                       std::span<const Vec3> seen, int texels);

}  // namespace fieldtrace
