// Rays that leave flat meshes, which do not hide them.
//
// Thread-safety: pure.
#pragma once

#include <cstdint>
#include <span>

#include "hybrid/api/scene_object.h"

namespace fieldtrace::api {

bool is_flat(const SceneObject& s, uint32_t instance);  // of k_none: not

// Sends rays that hit the flat mesh that they leave (`from`, by ray, or k_none) on behind it. `hits`: of `rays`; gets
// what they meet there, with t from the rays' own origins.
void pass_flat_origins(const SceneObject& s, const RayBatch& rays, std::span<const uint32_t> from, HitBatch& hits);

}  // namespace fieldtrace::api
