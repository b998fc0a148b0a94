// Whether direction maps pay for the crowds under a sky (docs/decisions/026-crowds-under-skies.md), from counts.
// Thread-safety: pure functions; one of them is parallel.
#pragma once

#include <atomic>
#include <span>

#include "core/scene/scene.h"
#include "core/trace/accel.h"
#include "hybrid/sky/mapped_shapes.h"

namespace fieldtrace {

// Rays for each instance in view that the maps of a crowd must replace: what is set up for a few points on each costs
// more than it saves.
inline constexpr uint64_t k_crowd_rays = 1200;
// More light samples of a pixel do not count: what rays err by falls with them, what maps err by does not.
inline constexpr uint64_t k_most_crowd_samples = 16;

// Instances that the camera may see.
uint64_t instances_in_view(const Scene& scene);

// Whether maps show what the objects are: none is foliage, and few can have no maps. Traces 65,536 rays a shape. `stop`
// may be null.
bool suits_maps(const Scene& scene, const Accel& accel, std::span<const ShapeTraits> traits, const MappedShapes& shapes,
                const std::atomic<bool>* stop);

}  // namespace fieldtrace
