#include "hybrid/path/patch_vertex.h"

#include <algorithm>
#include <initializer_list>

namespace fieldtrace {
namespace {

// Whether both sides are opaque and of one of the kinds.
bool is_opaque(const Scene& scene, uint32_t first, std::initializer_list<BsdfKind> kinds) {
  for (uint32_t b = first; b != k_none; b = scene.bsdfs[b].two_sided ? scene.bsdfs[b].back : k_none) {
    const Bsdf& bsdf = scene.bsdfs[b];
    if (std::find(kinds.begin(), kinds.end(), bsdf.kind) == kinds.end()) return false;
    if (bsdf.opacity == k_none) continue;
    const Texture& opacity = scene.textures[bsdf.opacity];
    if (opacity.kind != TextureKind::constant || opacity.color0 != Rgb(1.0f)) return false;
  }
  return true;
}

}  // namespace

bool is_diffuse_and_opaque(const Scene& scene, uint32_t bsdf) { return is_opaque(scene, bsdf, {BsdfKind::diffuse}); }

bool has_diffuse_body(const Scene& scene, uint32_t bsdf) {
  return is_opaque(scene, bsdf, {BsdfKind::diffuse, BsdfKind::plastic, BsdfKind::rough_plastic});
}

bool is_turned(const SurfacePoint& surface, bool back) {
  return (glm::dot(surface.geometric_normal, surface.shading_normal) < 0.0f) != back;
}

PathVertex patch_vertex(const Scene& scene, const SurfacePoint& surface, bool back, Material& material) {
  const bool turned = is_turned(surface, back);
  material = resolve_material(scene, scene.instances[surface.instance].bsdf, surface.uv, turned ? -1.0f : 1.0f);
  PathVertex v;
  v.surface = &surface;
  v.facing = back ? -surface.geometric_normal : surface.geometric_normal;
  v.material = &material;
  v.frame = frame_about(turned ? -surface.shading_normal : surface.shading_normal);
  return v;
}

}  // namespace fieldtrace
