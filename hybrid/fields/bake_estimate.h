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

// Estimates of cells below this many rays do not make fields coarser: such a bake takes seconds.
inline constexpr double k_costly_bake_rays = 8e6;

// By shape: rays to bake all cells that a picture of all of its instances might ask for, whether or not the shape wants
// a field. Few of them are asked for where coverage maps answer most.
std::vector<double> estimated_bake_rays(const Scene& scene, const FieldParameters& parameters);

// Lines of the coverage maps of the same directions, for each ray that their cells take. Measured bakes are within
// 1.25 times the estimate (docs/decisions/012-left-to-rays.md).
double coverage_share(const FieldParameters& parameters);

}  // namespace fieldtrace
