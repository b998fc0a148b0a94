// Arbitrary output variables: properties of the camera samples' first hits, as extra channels of the picture.
//
// albedo.R/G/B, normal.X/Y/Z (world, shading, turned to the camera where a two-sided material was seen from behind),
// visibility.Y, exact.Y, ao.Y (ambient_occlusion.h): means over all camera samples of a pixel (a miss has albedo 0,
// normal 0, visibility 1, exact 0, ao 1). depth.Z (distance from the lens along the ray), position.X/Y/Z (the file's
// world coordinates): means over the samples that hit something; 0 if none did. object.Y: instance index + 1 of the
// pixel's first camera sample, 0 on a miss. Of the rays that leave first hits on surfaces that are not diffuse:
// reflected_depth.Z (mean length of those that hit something), reflected_object.Y (like object, of the first of them),
// glossy_exact.Y (share that was traced, 0 if there were none). Of the camera samples themselves
// (hybrid/film/film_sums.h): samples.Y (their number), variance.R/G/B (of the pixel), time.Y (nanoseconds of one
// thread). For denoisers: denoise_albedo.R/G/B and denoise_normal.X/Y/Z are albedo and normal of the first surface that
// is not smooth: a mirror, smooth glass or an open mask gives those of what its ray meets, the albedo times what the
// smooth surfaces let through (Afra, "Open Image Denoise", documentation, "Auxiliary images"); means over all camera
// samples, of which one that meets nothing has 0, and one whose path ends on a smooth surface that surface's.
// Thread-safety: values; each pixel belongs to one thread.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/math/math.h"

namespace fieldtrace {

enum class Aov : uint8_t {
  albedo,
  normal,
  depth,
  position,
  visibility,
  exact,
  object,
  ao,
  reflected_depth,
  reflected_object,
  glossy_exact,
  samples,
  variance,
  time,
  denoise_albedo,
  denoise_normal
};

// The names of all layers, as parse_aovs() takes them.
std::vector<std::string> aov_names();

// Throws UsageError for an unknown name; repeated names count once.
std::vector<Aov> parse_aovs(const std::vector<std::string>& names);

// Whether the layer is of first hits.
bool is_of_first_hits(Aov aov);

// The channels that a layer adds, in order: "albedo.R", ...
std::vector<std::string> aov_channels(Aov aov);

// One camera sample's first hit.
struct FirstHit {
  bool hit = false;
  Rgb albedo = Rgb(0.0f);
  Vec3 normal = Vec3(0.0f);
  float depth = 0.0f;
  DVec3 position = DVec3(0.0);  // the file's world coordinates
  uint32_t object = 0;          // instance index + 1
  // Shadow rays: all, those traced, those unblocked. A stratum counts for as many rays as the light has samples per
  // stratum, so that all lights weigh the same.
  float shadow_rays = 0.0f, shadow_exact = 0.0f, shadow_clear = 0.0f;
  float occlusion_rays = 0.0f, occlusion_clear = 0.0f;
  // Rays that leave the hit, if its surface is not diffuse.
  uint32_t glossy_rays = 0, glossy_exact = 0, reflected_hits = 0;
  float reflected_depth = 0.0f;   // sum over those that hit something
  uint32_t reflected_object = 0;  // what the first of them hit: instance index + 1
  // The first surface that is not smooth, and what the smooth ones before it let through.
  Rgb shown_albedo = Rgb(0.0f), let_through = Rgb(1.0f);
  Vec3 shown_normal = Vec3(0.0f);

  // Adds one such ray, which hit `instance` at `distance`, or nothing (`met` is false).
  void add_reflection(bool met, uint32_t instance, float distance, bool is_exact) {
    if (glossy_rays == 0 && met) reflected_object = instance + 1;
    ++glossy_rays;
    glossy_exact += is_exact;
    if (!met) return;
    ++reflected_hits;
    reflected_depth += distance;
  }
};

// Sums over one pixel's camera samples, added in the order of their indices.
struct AovSums {
  int samples = 0, hits = 0;
  DVec3 albedo = DVec3(0.0);
  DVec3 normal = DVec3(0.0);
  double depth = 0.0;
  DVec3 position = DVec3(0.0);
  double visibility = 0.0, exact = 0.0;
  // Of all samples together: one whose rays all leave below the surface tells nothing.
  double occlusion_rays = 0.0, occlusion_clear = 0.0;
  uint32_t object = 0;
  uint64_t glossy_rays = 0, glossy_exact = 0, reflected_hits = 0;
  double reflected_depth = 0.0;
  uint32_t reflected_object = 0;
  DVec3 denoise_albedo = DVec3(0.0);
  DVec3 denoise_normal = DVec3(0.0);

  void add(const FirstHit& first);
  void merge(const AovSums& later);  // adds the sums over later camera samples
  // Writes the channels of a layer of first hits and returns the end of the output.
  float* write(Aov aov, float* out) const;
};

}  // namespace fieldtrace
