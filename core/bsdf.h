// Scattering functions: diffuse, smooth and rough conductor, smooth dielectric, two-sided.
//
// A Material is a Bsdf with its textures evaluated and its side chosen; the functions below work on that in the local
// shading frame (normal +z), as Mitsuba's plugins `diffuse`, `conductor`, `roughconductor`, `dielectric`, `twosided`.
// wi points back along the arriving path, wo along the continued one; both are unit and point away from the surface.
// Thread-safety: values and pure functions.
#pragma once

#include "core/microfacet.h"
#include "core/scene.h"

namespace fieldtrace {

struct Material {
  BsdfKind kind = BsdfKind::diffuse;
  bool dark = false;    // an opaque one-sided surface seen from behind: scatters nothing
  bool turned = false;  // a two-sided surface seen from behind: the caller turns the frame's normal round
  Rgb reflectance = Rgb(0.0f), transmittance = Rgb(0.0f);
  Rgb eta = Rgb(0.0f), k = Rgb(1.0f);  // conductors
  float relative_ior = 1.0f;           // dielectric: interior over exterior
  Microfacet microfacet;               // rough conductor

  bool delta() const { return kind == BsdfKind::conductor || kind == BsdfKind::dielectric; }
  bool transmits() const { return kind == BsdfKind::dielectric; }
};

struct BsdfSample {
  Vec3 wo = Vec3(0.0f, 0.0f, 1.0f);
  Rgb weight = Rgb(0.0f);  // bsdf * |cos wo| / pdf; zero: nothing is scattered, the path ends
  float pdf = 0.0f;        // per solid angle; for delta lobes the probability of the lobe
  float eta = 1.0f;        // relative index on the far side, if the ray crossed the surface
  bool delta = false;
};

// Evaluates the material of Scene::bsdfs[bsdf] at uv, for an arriving direction with that cosine to the shading
// normal; a two-sided Bsdf takes its back side's material where the cosine is negative.
Material resolve_material(const Scene& scene, uint32_t bsdf, const Vec2& uv, float cos_wi);

// The albedo shown as an AOV: diffuse albedo, specular reflectance (times Fresnel at normal incidence for
// conductors); for dielectrics specular reflectance.
Rgb material_albedo(const Material& material);

// bsdf(wi, wo) * |cos wo|; zero for delta lobes and for directions on the wrong side.
Rgb evaluate_bsdf(const Material& material, const Vec3& wi, const Vec3& wo);

// Solid-angle density with which sample_bsdf chooses wo; zero for delta lobes.
float bsdf_pdf(const Material& material, const Vec3& wi, const Vec3& wo);

// Chooses wo. u in [0, 1)^2 picks the direction, u_lobe in [0, 1) the lobe. Transmission scales radiance by the
// inverse square of the index ratio, as radiance is what camera paths carry.
BsdfSample sample_bsdf(const Material& material, const Vec3& wi, const Vec2& u, float u_lobe);

}  // namespace fieldtrace
