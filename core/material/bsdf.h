// Scattering functions: diffuse, conductors, dielectrics, plastics (smooth and rough), thin dielectric, principled;
// each masked or not, opaque ones on one side or both.
//
// A Material is a Bsdf with its textures evaluated and its side chosen. The functions below work on it in the local
// shading frame (normal +z), like Mitsuba's plugins of the same names. wi points back along the arriving path, wo along
// the continued one; both are unit and point away from the surface. The families are implemented in bsdf_*.cpp, with
// their sources. Thread-safety: values and pure functions; a Material points into the Scene that it was resolved from.
#pragma once

#include "core/material/microfacet.h"
#include "core/scene/scene.h"

namespace fieldtrace {

struct Material {
  BsdfKind kind = BsdfKind::diffuse;
  bool dark = false;                    // a one-sided surface seen from behind: scatters nothing
  bool turned = false;                  // a two-sided surface seen from behind: the caller flips the frame's normal
  bool nonlinear = false;               // plastics
  float opacity = 1.0f;                 // [0, 1]; the rest of the light passes straight through
  float relative_ior = 1.0f;            // dielectrics, plastics, principled: interior over exterior
  Rgb reflectance = Rgb(0.0f);          // diffuse: albedo; principled: base colour; others: specular
  Rgb transmittance = Rgb(0.0f);        // dielectrics
  Rgb diffuse_reflectance = Rgb(0.0f);  // plastics
  Rgb eta = Rgb(0.0f), k = Rgb(1.0f);   // conductors
  Microfacet microfacet;                // rough kinds and principled
  const RoughTransmittance* rough_transmittance = nullptr;                            // rough plastic
  float roughness = 0.5f, metallic = 0.0f, clearcoat = 0.0f, clearcoat_alpha = 0.1f;  // principled

  bool operator==(const Material&) const = default;

  // Scatters into discrete directions only: light samples find nothing.
  bool delta() const {
    return kind == BsdfKind::conductor || kind == BsdfKind::dielectric || kind == BsdfKind::thin_dielectric;
  }
  // Light is scattered through to the other side (not counting a mask): directions with wo.z < 0 count too.
  bool transmits() const { return fieldtrace::transmits(kind); }
  bool masked() const { return opacity < 1.0f; }
  // What is seen at the surface are other ones, without blur: mirrors, smooth glass, what a mask leaves out.
  bool shows_others() const { return opacity == 0.0f || (delta() && !masked() && !dark); }
  // Paths end here.
  bool absorbs() const { return dark && !masked(); }
  // A single cosine lobe.
  bool plain_diffuse() const { return kind == BsdfKind::diffuse && !masked(); }
  // A diffuse body under an interface that reflects as well, and that CoatedBody fits.
  bool coated_diffuse() const { return !masked() && is_coated_diffuse(kind, relative_ior, rough_transmittance); }
  // Sampling several directions at one point reduces noise beyond what light samples achieve.
  bool glossy() const { return kind != BsdfKind::diffuse && kind != BsdfKind::conductor; }
  // sample_bsdf chooses between lobes and so needs u_lobe.
  bool several_lobes() const { return masked() || (glossy() && kind != BsdfKind::rough_conductor); }
};

struct BsdfSample {
  Vec3 wo = Vec3(0.0f, 0.0f, 1.0f);
  Rgb weight = Rgb(0.0f);  // bsdf * |cos wo| / pdf; zero: nothing is scattered and the path ends
  float pdf = 0.0f;        // per solid angle; for delta lobes the probability of the lobe
  float eta = 1.0f;        // relative index of the far side if the ray crossed the surface
  bool delta = false;
  bool straight = false;  // wo = -wi, through a mask (delta too)
};

// Evaluates the material of Scene::bsdfs[index] at uv, for an arriving direction with that cosine to the shading
// normal; a two-sided Bsdf takes its back side's material where the cosine is negative.
Material resolve_material(const Scene& scene, uint32_t index, const Vec2& uv, float cos_wi);

// Whether resolve_material() depends on uv: some texture of the Bsdf or of its back side is not constant.
bool is_textured(const Scene& scene, uint32_t bsdf);

// The albedo AOV, multiplied by the opacity: diffuse albedo (plastics too), base colour, or specular reflectance (times
// Fresnel at normal incidence for conductors); zero for dark materials.
Rgb material_albedo(const Material& material);

// Roughness of the narrowest lobe across its narrower side, not counting a mask: 0 for delta lobes (smooth plastic
// included), k_diffuse_alpha for diffuse surfaces. Independent of direction.
inline constexpr float k_diffuse_alpha = 1.0f;
float lobe_alpha(const Material& material);

// bsdf(wi, wo) * |cos wo|; zero for delta lobes and for directions on the wrong side.
Rgb evaluate_bsdf(const Material& material, const Vec3& wi, const Vec3& wo);

// Solid-angle density with which sample_bsdf chooses wo; delta lobes contribute nothing.
float bsdf_pdf(const Material& material, const Vec3& wi, const Vec3& wo);

// The diffuse part of a coated_diffuse() material: reflected x T(cos wo) x |cos wo|, where T(c) = 1 - grazing (1 - c)^5
// is near the interface's transmittance relative to that at normal incidence, and has its mean over a cosine lobe. The
// exponent: Schlick, "An Inexpensive BRDF Model for Physically-based Rendering", Computer Graphics Forum 13(3), 1994.
struct CoatedBody {
  Rgb reflected = Rgb(0.0f);  // per steradian
  float grazing = 0.0f;
};
CoatedBody coated_body(const Material& material, float cos_wi);
// What that fits: the interface's transmittance at a cosine in [0, 1], relative to that at normal incidence.
float relative_transmittance(const Material& material, float cosine);
// The same material without it: what its interface reflects.
Material without_body(const Material& material);

// Samples wo. u in [0, 1)^2 chooses the direction, u_lobe in [0, 1) the lobe. Transmission scales by the inverse square
// of the index ratio, since camera paths carry radiance.
BsdfSample sample_bsdf(const Material& material, const Vec3& wi, const Vec2& u, float u_lobe);

}  // namespace fieldtrace
