#include "hybrid/path/patch_vertex.h"

namespace fieldtrace {
namespace {

// Whether both sides are opaque, and such that is_wanted(bsdf).
template <class Wanted>
bool is_opaque(const Scene& scene, uint32_t first, const Wanted& is_wanted) {
  for (uint32_t b = first; b != k_none; b = scene.bsdfs[b].two_sided ? scene.bsdfs[b].back : k_none) {
    const Bsdf& bsdf = scene.bsdfs[b];
    if (!is_wanted(bsdf)) return false;
    if (bsdf.opacity == k_none) continue;
    const Texture& opacity = scene.textures[bsdf.opacity];
    if (opacity.kind != TextureKind::constant || opacity.color0 != Rgb(1.0f)) return false;
  }
  return true;
}

}  // namespace

bool is_diffuse_and_opaque(const Scene& scene, uint32_t bsdf) {
  return is_opaque(scene, bsdf, [](const Bsdf& b) { return b.kind == BsdfKind::diffuse; });
}

bool has_diffuse_body(const Scene& scene, uint32_t bsdf) {
  return is_opaque(scene, bsdf, [&](const Bsdf& b) {
    const RoughTransmittance* const rough =
        b.kind == BsdfKind::rough_plastic ? &scene.rough_transmittances[b.rough_transmittance] : nullptr;
    return b.kind == BsdfKind::diffuse || is_coated_diffuse(b.kind, b.int_ior / b.ext_ior, rough);
  });
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
