// Shading points that stand for patches of diffuse surfaces. Thread-safety: pure functions.
#pragma once

#include "hybrid/path/path_batch.h"

namespace fieldtrace {

// Light samples of each patch towards every light, and paths that continue from it.
inline constexpr int k_patch_samples = 16;

// The vertex at `surface`, seen from the side that its geometric normal points away from (back) or from the other. It
// refers to `surface` and to `material`, which is resolved there. `seed` and `lobe_samples` are left to the caller.
PathVertex patch_vertex(const Scene& scene, const SurfacePoint& surface, bool back, Material& material);

// Whether Scene::bsdfs[bsdf], textured or not, is diffuse and opaque on both sides.
bool is_diffuse_and_opaque(const Scene& scene, uint32_t bsdf);

// Whether it is opaque, and diffuse or is_coated_diffuse(), on both sides: maps light it.
bool has_diffuse_body(const Scene& scene, uint32_t bsdf);

// Whether a patch's shading normal was turned over: textures are then seen from behind.
bool is_turned(const SurfacePoint& surface, bool back);

}  // namespace fieldtrace
