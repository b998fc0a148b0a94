// Chooses D and N of a scene's fields from the angular sizes of lights, the objects' size in the picture and the number
// of rays that will be looked up.
//
// A cell costs about 16 rays to bake. Wide lights touch many cells, and a small or quick picture sends few rays to
// each; coarser cells then take less time in all, though they leave more rays undecided. Objects that fill the picture
// under many samples justify finer cells, which also err less (docs/decisions/007-field-resolution.md). The choice uses
// counts and the scene only, never clocks or the state of a cache, so that pictures are reproducible. Thread-safety:
// pure.
#pragma once

#include <cstdint>
#include <span>

#include "core/scene/scene.h"
#include "field/store/field.h"
#include "hybrid/visibility/shape_traits.h"

namespace fieldtrace {

// Lights narrower than this (angular diameter in degrees, from the centre of an object with a field) get fine cells.
inline constexpr float k_wide_light_degrees = 12.0f;
// Fewer light samples than this of each light get coarse cells: a picture of 512 x 512 at 8 samples has 2.1 million.
inline constexpr uint64_t k_fine_field_rays = 2'000'000;
// Fine cells give way to coarse ones where their bake is costly (hybrid/fields/bake_estimate.h) and takes more than
// this share of the picture's light samples: a narrow light beside wide ones, or many lights.
inline constexpr double k_most_bake_share = 0.05;
// Finer cells are taken where their bake takes at most this share of the light samples that fall on the objects.
inline constexpr double k_finer_bake_share = 0.1;

// The angular diameter in degrees of the narrowest light, seen from the centre of any instance whose shape wants a
// field; 0 for point and directional lights, 180 for a constant one. 0 if there is no light or no such instance.
float narrowest_light_degrees(const Scene& scene, std::span<const ShapeTraits> traits);

// The approximate share of the film that the bounding ball of an instance covers: 0 behind the camera, 1 around it.
float projected_share(const Scene& scene, const Instance& instance);

// `rays_per_light`: pixels of the film (by rounds: of the window) x camera samples x light samples.
FieldParameters choose_resolution(const Scene& scene, std::span<const ShapeTraits> traits, uint64_t rays_per_light);

}  // namespace fieldtrace
