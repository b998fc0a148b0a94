// Arbitrary output variables: what the camera samples' first hits were like, as extra channels of the picture.
//
// albedo.R/G/B, normal.X/Y/Z (world, shading, turned to the camera where a two-sided material was seen from behind),
// visibility.Y, exact.Y, ao.Y (ambient_occlusion.h): means over all camera samples of a pixel (a miss has albedo 0,
// normal 0, visibility 1, exact 0, ao 1). depth.Z (distance from the lens along the ray), position.X/Y/Z (the file's
// world coordinates): means over the samples that hit something; 0 if none did. object.Y: instance index + 1 of the
// pixel's first camera sample, 0 on a miss. Thread-safety: values; each pixel belongs to one thread.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/math.h"

namespace fieldtrace {

enum class Aov : uint8_t { albedo, normal, depth, position, visibility, exact, object, ao };

// Throws UsageError for an unknown name; a name given twice counts once.
std::vector<Aov> parse_aovs(const std::vector<std::string>& names);

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
  // Shadow rays, those that were traced, and those that got through. A part of a light counts for as many rays as its
  // light has samples for each part, so that lights weigh the same.
  float shadow_rays = 0.0f, shadow_exact = 0.0f, shadow_clear = 0.0f;
  uint32_t occlusion_rays = 0, occlusion_clear = 0;
};

// Sums over one pixel's camera samples, added in the order of their indices.
struct AovSums {
  int samples = 0, hits = 0;
  Rgb albedo = Rgb(0.0f);
  Vec3 normal = Vec3(0.0f);
  double depth = 0.0;
  DVec3 position = DVec3(0.0);
  double visibility = 0.0, exact = 0.0, occlusion = 0.0;
  uint32_t object = 0;

  void add(const FirstHit& first);
  // Writes the channels of `aovs` in order, and returns the end.
  float* write(const std::vector<Aov>& aovs, float* out) const;
};

}  // namespace fieldtrace
