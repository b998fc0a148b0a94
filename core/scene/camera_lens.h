// A camera and its film as plain numbers for host and device code: the input of core/camera/camera_rays.hd.h.
// Thread-safety: a value.
#pragma once

#include <cstdint>

namespace fieldtrace {

enum class FilterKind : uint8_t { box, tent, gaussian };

struct CameraLens {
  float to_world[4][3] = {};  // columns
  float width = 1.0f, height = 1.0f;
  float principal_offset[2] = {};
  float tan_x = 1.0f, tan_y = 1.0f;  // half the image's size at distance 1
  float near_clip = 1e-2f, far_clip = 1e4f;
  float aperture_radius = 0.0f, focus_distance = 1.0f;
  float scale = 1.0f;  // world length of a camera-space unit
  FilterKind filter = FilterKind::box;
  float filter_radius = 0.5f;
  const float* gaussian = nullptr;  // inverse CDF at k / gaussian_steps, gaussian_steps + 1 values
  int gaussian_steps = 0;
};

}  // namespace fieldtrace
