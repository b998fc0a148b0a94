// Camera rays: pinhole and thin lens, crop windows, and sampling of the pixel filter.
//
// Conventions are Mitsuba 3's (plugins `perspective`, `thinlens`, `hdrfilm`): the camera looks along its +z, +y is up,
// +x points to the left of the picture; rays start on the near clipping plane and end on the far one.
// Filter: every camera sample belongs to one pixel and is placed by importance sampling of the reconstruction filter
// (Ernst, Stamminger and Greiner, "Filter Importance Sampling", IEEE RT 2006), with weight 1. The expected picture is
// the convolution with the filter, and a pixel depends on nothing outside it: tiles, threads and crop windows cannot
// change it. Box, tent and gaussian are positive, so every sample counts alike.
// Thread-safety: CameraSampler is const after construction.
#pragma once

#include <vector>

#include "core/scene.h"

namespace fieldtrace {

struct CameraRay {
  Vec3 origin = Vec3(0.0f);
  Vec3 direction = Vec3(0.0f, 0.0f, 1.0f);  // unit, world space
  float tmax = k_infinity;
  float near_distance = 0.0f;  // from the lens to `origin`, along the ray
};

class CameraSampler {
 public:
  // Throws Error for a camera or film that defines no picture (empty film, field of view outside (0, 180) degrees,
  // ...).
  CameraSampler(const Camera& camera, const Film& film);

  // A ray through pixel (x, y) of the whole film. u_film and u_lens lie in [0, 1)^2.
  CameraRay ray(int x, int y, const Vec2& u_film, const Vec2& u_lens) const;

  // The ray through the film position p in pixels: (0, 0) is the film's top left corner.
  CameraRay ray_at(const Vec2& p, const Vec2& u_lens) const;

  // Offset from the pixel's centre in pixels, distributed as the filter along one axis.
  float filter_offset(float u) const;

 private:
  Camera camera_;
  Film film_;
  float tan_x_ = 1.0f, tan_y_ = 1.0f;  // half the picture's size at distance 1
  float scale_ = 1.0f;                 // length of a camera-space unit in the world
  std::vector<float> gaussian_;        // inverse distribution function at k / k_gaussian_steps
};

}  // namespace fieldtrace
