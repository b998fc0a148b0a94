// What a field will cost to bake, from the scene alone: instances, lights and resolution.
//
// Every instance sees a light in other directions of its own, so a field that thousands of turned instances share is
// baked nearly whole, whatever the picture. Thread-safety: pure.
#pragma once

#include <cstdint>
#include <vector>

#include "core/scene/scene.h"
#include "field/store/field.h"

namespace fieldtrace {

// Estimates below this many rays decide nothing: such a bake takes seconds, and a cache or a larger picture pays it
// back.
inline constexpr double k_costly_bake_rays = 8e6;

// By shape: rays that a picture of all instances will have baked for its field, whether or not it wants one. Within a
// factor of two for one instance under one light (docs/decisions/012-left-to-rays.md).
std::vector<double> estimated_bake_rays(const Scene& scene, const FieldParameters& parameters);
// The same for the layer `ao`, whose rays go everywhere.
std::vector<double> estimated_occlusion_bake_rays(const Scene& scene, const FieldParameters& parameters);

}  // namespace fieldtrace
