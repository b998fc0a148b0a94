// Estimates what fields cost to bake, from the scene alone: instances, lights and resolution.
//
// In object space every instance sees a light in other directions, so a field shared by thousands of rotated instances
// is baked almost completely, whatever the picture. Thread-safety: pure.
#pragma once

#include <cstdint>
#include <vector>

#include "core/scene/scene.h"
#include "field/store/field.h"

namespace fieldtrace {

// Estimates below this many rays decide nothing: such a bake takes seconds, and a cache or a larger picture pays it
// back.
inline constexpr double k_costly_bake_rays = 8e6;

// By shape: rays to bake for its field if a picture showed all of its instances, whether or not the shape wants a
// field. Within a factor of two for one instance under one light (docs/decisions/012-left-to-rays.md).
std::vector<double> estimated_bake_rays(const Scene& scene, const FieldParameters& parameters);

}  // namespace fieldtrace
