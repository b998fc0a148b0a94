// Camera rays: pinhole and thin lens, crop windows, and sampling of the pixel filter.
//
// Conventions follow Mitsuba 3 (plugins `perspective`, `thinlens`, `hdrfilm`): the camera looks along its +z axis, +y
// is up, +x points left in the image; rays start on the near clipping plane and end on the far one.
// Filter: each camera sample belongs to one pixel and is placed by importance sampling of the reconstruction filter
// (Ernst, Stamminger and Greiner, "Filter Importance Sampling", IEEE RT 2006), with weight 1. The expected image is the
// convolution with the filter, yet no pixel depends on its neighbours: tiles, threads and crop windows cannot change
// it. Box, tent and gaussian filters are positive, so all samples have equal weight.
// Thread-safety: CameraSampler is const after construction.
#pragma once

#include <vector>

#include "core/camera/camera_samples.h"
#include "core/scene/camera_lens.h"
#include "core/scene/scene.h"
#include "core/simd/isa.h"

namespace fieldtrace {

struct CameraRay {
  Vec3 origin = Vec3(0.0f);
  Vec3 direction = Vec3(0.0f, 0.0f, 1.0f);  // unit, world space
  float tmax = k_infinity;
  float near_distance = 0.0f;  // from the lens to `origin`, along the ray
};

class CameraSampler {
 public:
  // Throws Error for a camera or film that defines no image (empty film, field of view outside (0, 180) degrees, ...).
  CameraSampler(const Camera& camera, const Film& film);

  CameraSampler(const CameraSampler&) = delete;
  CameraSampler& operator=(const CameraSampler&) = delete;

  // Generates the rays of camera samples in SIMD lanes, bit-identical for every instruction set; the members are those
  // of CameraRay. Sample points come from stream k_camera_stream of the samples' seeds. Resizes its outputs: the rays,
  // near_distance and the seeds, the latter two to whole vectors. Throws UsageError if this processor cannot run `isa`.
  void sample(const CameraSamples& samples, uint32_t picture_seed, Isa isa, RayBatch& rays,
              AlignedVector<float>& near_distance, SampleSeeds& seeds) const;

  // The ray through film position p in pixels; (0, 0) is the film's top left corner. u_lens is in [0, 1)^2.
  CameraRay ray_at(const Vec2& p, const Vec2& u_lens) const;

  // Offset from the pixel centre along one axis, in pixels, distributed as the filter.
  float filter_offset(float u) const;

 private:
  CameraLens lens_;  // points into gaussian_
  std::vector<float> gaussian_;
};

}  // namespace fieldtrace
